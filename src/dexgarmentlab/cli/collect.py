"""Verb `dgl collect`."""

import dataclasses
import statistics
import textwrap
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeVar

import tyro  # noqa: TID253 - marks the positional argument; the command line imports it anyway

from dexgarmentlab.cli import EXIT_INTERRUPTED, EXIT_OK, console
from dexgarmentlab.cli.flags import (
    Flags,
    WorkerFlags,
    find_task,
    tell_command,
    told_how_to_continue,
)
from dgl_collect.options import RecordOptions, RunOptions

if TYPE_CHECKING:
    from dgl_collect import CollectConfig, Progress, Summary
    from dgl_tasks.declaration import Task

__all__ = [
    "CollectOptions",
    "collect_with_progress",
    "describe_failures",
    "format_duration",
    "format_time_left",
    "prepare_run",
    "run",
]

O = TypeVar("O", bound=RunOptions)


@dataclass(frozen=True, kw_only=True)
class CollectOptions:
    """Collect demonstrations of a task automatically.

    Makes the attempts, keeps the episodes of those that succeed, and says why the others did not.
    The results follow from the seed; they do not depend on the number of workers. Ctrl-C keeps
    every finished attempt, and --resume continues.

    Example: dgl collect FoldTops-v1 --episodes 100 --workers 4 --out out/fold-tops
    """

    task: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="TASK")]
    """The task: an id such as FoldTops-v1, or a file or module of your own that declares one."""
    out: Path
    """Output folder; it must be empty or missing, unless --resume is given."""
    episodes: int = 10
    """Attempts to make; how many of them succeed is a result."""
    seed: int = 0
    """Seed of the run; every attempt gets its own from it."""
    resume: bool = False
    """Continue the run in the output folder."""
    run: Flags[RecordOptions] = field(default_factory=RecordOptions)
    workers: Flags[WorkerFlags] = field(default_factory=WorkerFlags)
    json: bool = False
    """Write the summary as JSON."""


def prepare_run(options: O, task: "Task") -> O:
    """Check the options of a run, make a garment of one's own ready, and tell what was assumed.

    Raises:
        ValueError: If something that they name is missing or does not fit; flags are named.
    """
    from dexgarmentlab.cli.assets_import import name_flags
    from dgl_assets.importing import AssetImportError
    from dgl_collect.setup import prepare_options

    try:
        prepared, notes = prepare_options(options, task)
    except AssetImportError as err:
        text = name_flags(str(err))
        if " --" in text:
            text += (
                f"; import it with them (dgl assets import {options.garment} --out FOLDER …), "
                "and give --garment the folder"
            )
        raise ValueError(text) from err
    for note in notes:
        console.info(f"{Path(str(options.garment)).name}: {note}")
    return prepared


def run(options: CollectOptions) -> int:
    """Collect, write the report, and say how many attempts succeeded."""
    from dgl_collect import CollectConfig

    command = tell_command("collect", options)
    config = CollectConfig(
        task=options.task,
        episodes=options.episodes,
        seed=options.seed,
        workers=options.workers.make(),
        out=options.out,
        resume=options.resume,
        options=prepare_run(options.run, find_task(options.task)),
        command=command + (" --resume" if options.resume else ""),
    )
    with told_how_to_continue(command):
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
            f"continue with: {command} --resume"
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
    from dgl_tasks.scene_check import check_scene

    check_scene(find_task(config.task))  # before there is a folder
    with console.progress(f"collecting {config.task}", config.episodes) as bar:
        try:
            summary = collect(
                config, on_progress=lambda p: bar.reach(len(p.results), note=_note(p))
            )
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


def format_time_left(made: int, wanted: int, resumed: int, seconds: float) -> str:
    """Write the time that is left, after a comma; nothing while it is unknown.

    Args:
        made: Steps made, earlier runs included.
        wanted: Steps in all.
        resumed: Steps made by an earlier run.
        seconds: Time of this run [s].
    """
    if made == resumed or made >= wanted:
        return ""
    return f", {format_duration(seconds / (made - resumed) * (wanted - made))} left"


def _note(progress: "Progress") -> str:
    """Describe how far a run is: successes, time per attempt, and the time that is left."""
    waiting = progress.workers_waiting
    if not progress.results:
        note = "making the first attempt" if progress.workers_ready else "building the environment"
        return note + _waiting(waiting)
    succeeded = sum(result.success for result in progress.results)
    median = statistics.median(result.seconds for result in progress.results)
    note = f"{succeeded} succeeded, {format_duration(median)} each"
    note += format_time_left(
        len(progress.results), progress.requested, progress.resumed, progress.seconds
    )
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
        f"{summary.task}: {summary.succeeded_first} of {summary.attempted} attempts succeeded at "
        "the first try, "
        f"{summary.succeeded} with retries, {summary.success_rate:.1%} (95 % interval {low:.1%} to "
        f"{high:.1%}), "
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
