"""Verb `dgl eval`."""

from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro  # noqa: TID253 - marks the positional argument; the command line imports it anyway

from dexgarmentlab.cli import EXIT_INTERRUPTED, EXIT_OK, console
from dexgarmentlab.cli.collect import describe_failures, format_duration, prepare_run
from dexgarmentlab.cli.compare import describe_cm
from dexgarmentlab.cli.flags import (
    Flags,
    WorkerFlags,
    find_task,
    tell_command,
    told_how_to_continue,
)
from dgl_collect.options import EvaluationOptions

if TYPE_CHECKING:
    from dgl_collect import CollectConfig, Progress
    from dgl_collect.evaluation.results import Count, Results

__all__ = ["SEED_OFFSET", "EvalOptions", "parse_seeds", "run"]

SEED_OFFSET = 1_000_000
"""Added to the seeds, so that no episode starts as one of a collection with the same seed did."""


@dataclass(frozen=True, kw_only=True)
class EvalOptions:
    """Evaluate a method on a task, as the paper does: episodes for each of several seeds.

    Every method meets the same garments at the same places. Half of the garments are of the
    catalogue's training split, half of its testing split, and they are counted apart. What is
    judged is the task's own rule, with the arms out of the way. Ctrl-C keeps every finished
    episode, and --resume continues.

    Example: dgl eval FoldTops-v1 --policy expert --episodes 50 --seeds 0,1,2 --workers 4 --out
        out/eval
    """

    task: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="TASK")]
    """The task: an id such as FoldTops-v1, or a file or module of your own that declares one."""
    run: Flags[EvaluationOptions]
    out: Path
    """Output folder; it must be empty or missing, unless --resume is given."""
    episodes: int = 50
    """Episodes for each seed."""
    seeds: str = "0,1,2"
    """Seeds of the evaluation, separated by commas."""
    resume: bool = False
    """Continue the evaluation in the output folder."""
    workers: Flags[WorkerFlags] = field(default_factory=WorkerFlags)
    json: bool = False
    """Write the results as JSON."""


def parse_seeds(text: str) -> tuple[int, ...]:
    """Parse seeds separated by commas.

    Raises:
        ValueError: If one is no number from 0 to 999,999, or is there twice.
    """
    try:
        seeds = tuple(int(part) for part in text.split(","))
    except ValueError:
        seeds = ()
    if not seeds or len(set(seeds)) < len(seeds) or not all(0 <= s < SEED_OFFSET for s in seeds):
        raise ValueError(
            f"--seeds must be different numbers from 0 to {SEED_OFFSET - 1:,} separated by commas; "
            f"got {text!r}"
        )
    return seeds


def run(options: EvalOptions) -> int:
    """Evaluate, write `results.json` and the report, and say how many episodes succeeded."""
    from dexgarmentlab.learned_methods import METHODS
    from dexgarmentlab.reports.evaluation import write_report
    from dgl_collect import collect, package_versions
    from dgl_collect.evaluation.methods import check_method
    from dgl_collect.evaluation.results import RESULTS_FILE, Run, summarize, to_json
    from dgl_collect.results import ATTEMPTS_FILE, read_results
    from dgl_collect.run_folder import RUN_FILE
    from dgl_files.whole import write_json

    seeds = parse_seeds(options.seeds)
    task, policy = find_task(options.task), options.run.policy
    check_method(task, options.run, METHODS)
    if (options.out / RUN_FILE).exists():
        raise ValueError(
            f"--out must be the folder of an evaluation; {options.out} has a collection"
        )
    prepared = prepare_run(options.run, task)
    command = tell_command("eval", options)
    configs = {seed: _configure(options, seed, prepared, command) for seed in seeds}
    status: Literal["complete", "interrupted"] = "complete"
    runs: list[Run] = []
    bar_text = f"evaluating {policy} on {options.task}"
    wanted = options.episodes * len(seeds)
    with console.progress(bar_text, wanted) as bar:
        for seed, config in configs.items():
            before = bar.steps

            def show(progress: "Progress", before: int = before, seed: int = seed) -> None:
                made = len(progress.results)
                succeeded = sum(result.success for result in progress.results)
                bar.reach(before + made, note=f"seed {seed}: {succeeded} of {made} succeeded")

            with told_how_to_continue(command):
                summary = collect(config, on_progress=show)
            results = read_results(config.out / ATTEMPTS_FILE)
            runs.append(Run(seed=seed, folder=Path(config.out.name), results=results))
            if summary.status == "interrupted":
                status = "interrupted"
                break
    results = summarize(runs)
    asked, versions = _asked(options, command), package_versions()
    content = to_json(results, runs, asked=asked, status=status, versions=versions)
    write_json(options.out / RESULTS_FILE, content)
    page = write_report(options.out, results, runs, asked=asked, wanted=wanted, versions=versions)
    if options.json:
        console.out_json(content)
    else:
        _show(options, results)
        console.out(f"results: {options.out / RESULTS_FILE}")
        console.out(f"report: {page}")
    if status == "interrupted":
        console.error(
            f"interrupted after {results.total.episodes} of {wanted} episodes; "
            f"continue with: {command} --resume"
        )
        return EXIT_INTERRUPTED
    return EXIT_OK


def _configure(
    options: EvalOptions, seed: int, prepared: EvaluationOptions, command: str
) -> "CollectConfig":
    """Make the run of one seed."""
    from dexgarmentlab.learned_methods import FACTORY
    from dgl_collect import CollectConfig

    return CollectConfig(
        task=options.task,
        episodes=options.episodes,
        seed=SEED_OFFSET + seed,
        workers=options.workers.make(),
        out=options.out / f"seed-{seed}",
        resume=options.resume,
        attempt_factory=FACTORY,
        options=prepared,
        has_episodes=False,
        command=command + (" --resume" if options.resume else ""),
    )


def _asked(options: EvalOptions, command: str) -> dict[str, object]:
    asked = {item.name: getattr(options.run, item.name) for item in fields(options.run)}
    return {
        "task": find_task(options.task).id,
        **{name: str(v) if isinstance(v, Path) else v for name, v in asked.items()},
        "episodes": options.episodes,
        "seeds": list(parse_seeds(options.seeds)),
        "command": command,
    }


def _show(options: EvalOptions, results: "Results") -> None:
    total = results.total
    if results.mean is None or total.rate is None:
        console.out(f"{options.task}, {options.run.policy}: no episode has finished")
        return
    spread = (
        "" if results.std is None else f" ± {results.std:.3f} over {len(results.by_seed)} seeds"
    )
    console.out(
        f"{options.task}, {options.run.policy}: {total.first_try} of {total.episodes} episodes "
        "succeeded at the first try, "
        f"{total.succeeded} with retries, "
        f"{results.mean:.3f}{spread}, 95 % interval {total.interval[0]:.1%} to "
        f"{total.interval[1]:.1%}"
    )
    rows: list[Sequence[object]] = [
        _row(f"seed {seed}", item) for seed, item in results.by_seed.items()
    ]
    rows += [_row(f"{split} garments", item) for split, item in results.by_split.items()]
    console.out_table(("", "episodes", "first try", "with retries", "rate", "95 % interval"), rows)
    if results.value_median is not None:
        console.out(
            f"value: median {results.value_median:.3f}, "
            f"from {results.value_least:.3f} to {results.value_largest:.3f}"
        )
    if results.placement_error is not None:
        console.out(f"placement error: median {describe_cm(results.placement_error)}")
    for line in describe_failures(results.reasons, results.details):
        console.out(line)
    if results.seconds_median is not None:
        console.out(f"{format_duration(results.seconds_median)} an episode")


def _row(name: str, item: "Count") -> tuple[object, ...]:
    low, high = item.interval
    rate = "-" if item.rate is None else f"{item.rate:.3f}"
    return (name, item.episodes, item.first_try, item.succeeded, rate, f"{low:.1%} to {high:.1%}")
