"""Verb `dgl tune`."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro  # noqa: TID253 - marks the positional argument; the command line imports it anyway

from dexgarmentlab.cli import EXIT_INTERRUPTED, EXIT_OK, console
from dexgarmentlab.cli.collect import format_time_left, prepare_run
from dexgarmentlab.cli.flags import Flags, WorkerFlags, find_task, tell_command
from dgl_collect.options import RunOptions

if TYPE_CHECKING:
    from dgl_collect.tuning.search import TuneProgress, Tuning

__all__ = ["TuneOptions", "run"]


@dataclass(frozen=True, kw_only=True)
class TuneOptions:
    """Search for better values of a demonstration's parameters in simulation.

    A trial is one episode without film, to its first retry. Every generation has new starts with
    garments of the training split, the same for all candidates and for the demonstration itself.
    The winner is compared with the demonstration on further starts, half of them with garments of
    the testing split, and written to tuned.json. Ctrl-C keeps every finished trial, and --resume
    continues.

    Example: dgl tune FlingTops-v1 --workers 4 --out out/tune
    """

    task: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="TASK")]
    """The task: an id such as FlingTops-v1, or a file or module of your own that declares one."""
    run: Flags[RunOptions]
    out: Path
    """Output folder; it must be empty or missing, unless --resume is given."""
    generations: int = 9
    """Generations of the search, at least 1."""
    candidates: int = 12
    """Candidates in a generation, at least 4; the worse half is dropped after two starts."""
    starts: int = 3
    """New starts in a generation, at least 1. A search needs 20 trials or more in all."""
    judged: int = 40
    """Further starts for the comparison of the winner with the demonstration; 0 for none."""
    seed: int = 0
    """Seed of the search."""
    resume: bool = False
    """Continue the search in the output folder."""
    workers: Flags[WorkerFlags] = field(default_factory=WorkerFlags)
    json: bool = False
    """Write the result as JSON."""


def run(options: TuneOptions) -> int:
    """Search, write the winner and the report, and tell if it is better."""
    from dexgarmentlab.reports.tuning import write_report
    from dgl_collect.tuning.search import TUNED_FILE, Interrupted, TuneConfig, tune
    from dgl_collect.tuning.trials import read_content

    task = find_task(options.task)
    command = tell_command("tune", options)
    config = TuneConfig(
        task=options.task,
        out=options.out,
        options=prepare_run(options.run, task),
        generations=options.generations,
        candidates=options.candidates,
        starts=options.starts,
        judged=options.judged,
        seed=options.seed,
        workers=options.workers.make(),
        resume=options.resume,
        command=command,
    )
    read_content(task, config.options.demonstration)  # faults are told before the first line
    with console.progress(f"tuning {options.task}") as bar:
        try:
            tuning = tune(
                config,
                on_progress=lambda p: bar.reach(p.made, note=_note(p), total=p.wanted),
            )
        except Interrupted:
            console.error(
                f"interrupted after {bar.steps} trials; continue with: {command} --resume"
            )
            return EXIT_INTERRUPTED
    page = write_report(options.out, task.id, tuning)
    if options.json:
        console.out_json(_to_json(tuning))
    else:
        _show(tuning)
        if not tuning.is_better:
            console.out("not shown to be better: keep the demonstration")
        console.out(f"winner of the search: {options.out / TUNED_FILE}")
        console.out(f"report: {page}")
    return EXIT_OK


def _note(progress: "TuneProgress") -> str:
    """Describe the part of the search, and the time that is left."""
    p = progress
    return p.note + format_time_left(p.made, p.wanted, p.resumed, p.seconds)


def _show(tuning: "Tuning") -> None:
    rows = [
        (name, f"{tuning.before[name]:.4g}", f"{tuning.after[name]:.4g}", f"{t:+.1f}")
        for name, t in zip(tuning.names, tuning.response.t_values, strict=True)
    ]
    console.out_table(("parameter", "before", "after", "t"), rows)
    console.out(
        f"first try on {tuning.judged} further starts: {tuning.succeeded_before} before, "
        f"{tuning.succeeded_after} after; {tuning.only_before} only before, {tuning.only_after} "
        f"only after, p = {tuning.p_value:.3f}"
    )


def _to_json(tuning: "Tuning") -> dict[str, object]:
    return {
        "before": dict(tuning.before),
        "after": dict(tuning.after),
        "chosen": tuning.chosen,
        "t": dict(zip(tuning.names, map(float, tuning.response.t_values), strict=True)),
        "generations": [vars(each) for each in tuning.generations],
        "trials": tuning.trials,
        "judged": tuning.judged,
        "succeeded": {"before": tuning.succeeded_before, "after": tuning.succeeded_after},
        "alone": {"before": tuning.only_before, "after": tuning.only_after},
        "p": tuning.p_value,
        "is_better": tuning.is_better,
    }
