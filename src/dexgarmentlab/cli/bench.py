"""Verb `dgl bench`."""

import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro  # noqa: TID253 - marks the positional argument; the command line imports it anyway

from dexgarmentlab.cli import EXIT_OK, EXIT_USAGE, console

__all__ = ["Options", "run"]


@dataclass(frozen=True, kw_only=True)
class Options:
    """Measure this machine: the numbers that the documentation quotes.

    A row is a name, a value, its unit, the bar that the value should meet and whether it does. A bar that
    is not met is a finding and no failure: the exit status is 0.

    Example: dgl bench physics --report physics-report
    """

    subject: Annotated[Literal["physics"], tyro.conf.Positional]
    """What to measure: the simulation of cloth and elastic solids."""
    only: tuple[str, ...] = ()
    """Names of the experiments; all when none is named. An unknown name lists them."""
    report: Path | None = None
    """Folder for a page with every figure, index.html."""
    effort: float = 1.0
    """Factor on what can be repeated: timed frames, drops, random actions."""
    seed: int = 0
    """Of everything that is drawn at random."""
    newton_python: str | None = None
    """Python interpreter that has Newton, when this one has not."""
    json: bool = False
    """Write the rows as JSON."""


def run(options: Options) -> int:
    """Measure and write the rows."""
    from dexgarmentlab import bench_physics
    from dexgarmentlab.bench_physics.report import format_value

    try:
        experiments = bench_physics.select(options.only)
        bench = bench_physics.Bench(
            effort=options.effort, seed=options.seed, newton_python=options.newton_python
        )
    except ValueError as err:
        console.error(str(err))
        return EXIT_USAGE
    results = []
    console.info(f"measuring {experiments[0].name} ...")
    for number, found in enumerate(bench_physics.run(experiments, bench), start=1):
        results.append(found)
        experiment, result, seconds = found
        judged = [row.ok for row in result.rows if row.ok is not None]
        following = experiments[number].name if number < len(experiments) else ""
        console.info(
            f"[{number}/{len(experiments)}] {experiment.name}: {sum(judged)} of {len(judged)} bars met, "
            f"{seconds:.1f} s" + (f"; measuring {following} ..." if following else "")
        )
    rows = [row for _, result, _ in results for row in result.rows]
    if options.report is not None:
        page = bench_physics.write_report(options.report, results, command=_command(options))
        console.info(f"report: {page}")
    if options.json:
        console.out_json([row.to_dict() for row in rows])
    else:
        console.out_table(
            ("name", "value", "unit", "bar", "ok", "note"),
            [
                (
                    row.name,
                    format_value(row.value)
                    if row.value is not None
                    else "skipped"
                    if row.is_skipped
                    else "failed",
                    row.unit,
                    row.bar,
                    _MARKS[row.ok],
                    row.note,
                )
                for row in rows
            ],
        )
    return EXIT_OK


_MARKS = {True: "yes", False: "no", None: ""}


def _command(options: Options) -> str:
    """How to make the same again."""
    words = ["dgl", "bench", options.subject]
    if options.only:
        words += ["--only", *options.only]
    words += ["--report", str(options.report)]
    if options.effort != 1.0:
        words += ["--effort", f"{options.effort:g}"]
    if options.seed:
        words += ["--seed", str(options.seed)]
    return shlex.join(words)
