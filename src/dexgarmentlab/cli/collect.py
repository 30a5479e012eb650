"""Verb `dgl collect`."""

import dataclasses
import shlex
import statistics
import textwrap
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro  # noqa: TID253 - marks the positional argument; the command line imports it anyway

from dexgarmentlab.cli import EXIT_INTERRUPTED, EXIT_OK, console
from dexgarmentlab.cli.worker_flags import Flags, WorkerFlags, told_how_to_continue

if TYPE_CHECKING:
    from dgl_collect import CollectConfig, Progress, Summary

__all__ = [
    "CollectOptions",
    "collect_with_progress",
    "describe_failures",
    "format_duration",
    "robot_options",
    "run",
]


@dataclass(frozen=True, kw_only=True)
class CollectOptions:
    """Collect demonstrations of a task automatically.

    Makes the attempts, keeps the episodes of those that succeed, and says why the others did not. The
    results follow from the seed; they do not depend on the number of workers. Ctrl-C keeps every finished
    attempt, and --resume continues.

    Example: dgl collect FoldTops-v1 --episodes 100 --workers 4 --out out/fold-tops
    """

    task: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="TASK")]
    """Which task, such as FoldTops-v1."""
    out: Path
    """Output folder; it must be empty or missing, unless --resume is given."""
    episodes: int = 10
    """Attempts to make; how many of them succeed is a result."""
    seed: int = 0
    """Seed of the run; every attempt gets its own from it."""
    resume: bool = False
    """Continue the run in the output folder."""
    look: Literal["studio", "random"] = "studio"
    """A plain floor and fabrics that stand out from it, or floors, mats and fabrics of all kinds."""
    garment: Path | None = None
    """A garment of your own for every attempt, instead of the catalogue's: a mesh file, which is imported, or a folder that
    `dgl assets import` has made. It is judged by its key points, and where it has none by those that the affordance model
    finds."""
    matcher: Literal["exact", "gam"] | None = None
    """What finds the demonstrated points: the generator's correspondence, which knows the simulated garment, or
    the Garment Affordance Model, which sees its cloud alone. Exact for the catalogue's garments, gam for your own, when not
    given."""
    record: Literal["stages", "approaches"] = "stages"
    """What episodes hold: the stages, from the grasp points on; or these and the hands' approaches before them, which
    policies that work without grasp points have to learn."""
    rounds: int | None = None
    """How often the stages are gone through at most, while the task is believed not to be done; as the demonstration says
    when not given. The paper's protocol is 1."""
    robot: str = "ur10e+shadow"
    """Name of arm and hand, ARM+HAND; one of them stands for itself with the built-in other."""
    robots: Path | None = None
    """Folder of imported robots; see `dgl assets import-robot`."""
    workers: Flags = field(default_factory=WorkerFlags)
    json: bool = False
    """Write the summary as JSON."""

    @property
    def command(self) -> str:
        """The command line that asks for the same, without --resume and --json."""
        words = ["dgl", "collect", self.task, "--episodes", self.episodes, "--seed", self.seed]
        words += [*self.workers.words, "--out", self.out]
        words += ["--look", self.look] if self.look != "studio" else []
        words += ["--garment", self.garment] if self.garment is not None else []
        words += ["--matcher", self.matcher] if self.matcher is not None else []
        words += ["--record", self.record] if self.record != "stages" else []
        words += ["--rounds", self.rounds] if self.rounds is not None else []
        words += ["--robot", self.robot] if self.robot != "ur10e+shadow" else []
        words += ["--robots", self.robots] if self.robots is not None else []
        return shlex.join(str(word) for word in words)


def robot_options(robot: str, robots: Path | None) -> dict[str, str]:
    """Give the options of an attempt that name its robot, none for the default one.

    Raises:
        AssetError: If there is no such robot, or it cannot be loaded.
    """
    from dgl_assets.robots import DEFAULT_ROBOT
    from dgl_assets.robots.importing import load_robot

    model = load_robot(robot, robots)
    if model is DEFAULT_ROBOT:
        return {}
    options = {"robot": robot}
    return options if robots is None else {**options, "robots": str(robots.resolve())}


def bring_garment(source: Path | None, task: str) -> Path | None:
    """Make a garment of one's own ready for a task, and tell what was assumed.

    Returns:
        Its folder; None without one.
    """
    if source is None:
        return None
    if not source.exists():  # before much is imported
        raise ValueError(
            f"--garment must be a mesh file or the folder of an imported garment; {source} is not there"
        )
    source = source.absolute()  # "." has no name
    from dexgarmentlab.cli.assets_import import name_flags
    from dgl_assets.importing import AssetImportError
    from dgl_collect.own_garment import prepare_garment
    from dgl_collect.runner import check_task
    from dgl_tasks.tasks import get_task, task_ids

    check_task(task, task_ids())
    console.quieten_warp()
    try:
        own = prepare_garment(source, get_task(task))
    except AssetImportError as err:
        text = name_flags(str(err))
        if " --" in text:
            text += f"; import it with them (dgl assets import {source} --out FOLDER …), and give --garment the folder"
        raise ValueError(text) from err
    for note in own.notes:
        console.info(f"{source.name}: {note}")
    return own.folder


def choose_matcher(matcher: str | None, garment: Path | None) -> str | None:
    """Choose who finds the points: None for the usual one.

    Raises:
        ValueError: If it cannot find any on the garment.
    """
    if garment is None:
        return None if matcher == "exact" else matcher
    if matcher == "exact":
        raise ValueError(
            "--matcher exact knows the catalogue's garments alone; take gam for your own"
        )
    return "gam"


def run(options: CollectOptions) -> int:
    """Collect, write the report, and say how many attempts succeeded."""
    from dgl_collect import CollectConfig

    config = CollectConfig(
        task=options.task,
        episodes=options.episodes,
        seed=options.seed,
        workers=options.workers.make(),
        out=options.out,
        resume=options.resume,
        command=options.command + (" --resume" if options.resume else ""),
    )
    if options.rounds is not None and options.rounds < 1:
        raise ValueError(f"--rounds must be at least 1; got {options.rounds}")
    own = bring_garment(options.garment, options.task)
    told = {
        "look": options.look if options.look != "studio" else None,
        "garment": None if own is None else str(own),
        "matcher": choose_matcher(options.matcher, own),
        "recorded": options.record if options.record != "stages" else None,
        "rounds": options.rounds,
        **robot_options(options.robot, options.robots),
    }
    chosen = {name: value for name, value in told.items() if value is not None}
    config = dataclasses.replace(config, options={**config.options, **chosen})
    with told_how_to_continue(options.command):
        summary, report = collect_with_progress(config)
    if options.json:
        console.out_json({**dataclasses.asdict(summary), "report": str(report)})
    else:
        for line in _lines(summary):
            console.out(line)
        console.out(f"report: {report}")
    if summary.status == "interrupted":
        console.error(
            f"interrupted after {summary.attempted} of {summary.requested} attempts; "
            f"continue with: {options.command} --resume"
        )
        return EXIT_INTERRUPTED
    return EXIT_OK


def collect_with_progress(
    config: "CollectConfig", *, embed_media: bool = False
) -> tuple["Summary", Path]:
    """Collect with a progress bar, and write the report.

    Args:
        config: What to collect.
        embed_media: Whether the report is to hold films and pictures itself.

    Returns:
        The summary, and the report's path.
    """
    from dexgarmentlab.reports.collection import write_report
    from dgl_collect import WorkerError, collect
    from dgl_collect.demonstration import load_demonstration
    from dgl_collect.runner import check_task
    from dgl_tasks.scene_check import check_scene
    from dgl_tasks.tasks import get_task, task_ids

    known_tasks = task_ids()
    check_task(config.task, known_tasks)
    check_scene(get_task(config.task))  # before there is a folder
    load_demonstration(config.task)
    shown = 0
    with console.progress(f"collecting {config.task}", config.episodes) as bar:

        def show(progress: "Progress") -> None:
            nonlocal shown
            made = len(progress.results)
            bar.advance(made - shown, note=_note(progress))
            shown = made

        try:
            summary = collect(config, known_tasks=known_tasks, on_progress=show)
        except WorkerError:
            write_report(config.out, embed_media=embed_media)  # what had finished is worth a look
            raise
    return summary, write_report(config.out, embed_media=embed_media)


def format_duration(seconds: float) -> str:
    """Write a duration [s] as people say it."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if minutes < 90 else f"{minutes // 60} h {minutes % 60} min"


def _note(progress: "Progress") -> str:
    """Describe how far a run is: successes, time per attempt, and the time that is left."""
    waiting = progress.workers_waiting
    if not progress.results:
        note = "making the first attempt" if progress.workers_ready else "building the environment"
        return note + _waiting(waiting)
    succeeded = sum(result.success for result in progress.results)
    median = statistics.median(result.seconds for result in progress.results)
    note = f"{succeeded} succeeded, {format_duration(median)} each"
    made = len(progress.results) - progress.resumed
    left = progress.requested - len(progress.results)
    if made > 0 and left > 0:
        note += f", {format_duration(progress.seconds / made * left)} left"
    return note + _waiting(waiting)


def _waiting(count: int) -> str:
    """Say how many workers the cluster has no place for yet."""
    return f", {count} worker{'s wait' if count > 1 else ' waits'} for a place" if count else ""


def _lines(summary: "Summary") -> list[str]:
    """Summarise a run in a few lines."""
    if summary.success_rate is None:
        return [f"{summary.task}: no attempt has finished"]
    low, high = summary.success_interval
    median = summary.seconds_per_attempt["median"] or 0.0
    lines = [
        f"{summary.task}: {summary.succeeded_first} of {summary.attempted} attempts succeeded at the first try, "
        f"{summary.succeeded} with retries, {summary.success_rate:.1%} (95 % interval {low:.1%} to {high:.1%}), "
        f"{format_duration(median)} per attempt"
    ]
    return lines + describe_failures(summary.reasons, summary.details)


def describe_failures(reasons: Mapping[str, int], details: Mapping[str, str]) -> list[str]:
    """Say why attempts have failed, how many, and what the first of each kind says of it."""
    lines = []
    for reason, count in reasons.items():
        detail = " ".join(details.get(reason, "").split())
        shown = textwrap.shorten(detail, 160, placeholder=" …")
        lines.append(f"  failed, {reason}: {count}" + (f" ({shown})" if shown else ""))
    return lines
