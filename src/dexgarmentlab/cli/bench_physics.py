"""`dgl bench physics`: the simulation of cloth and elastic solids."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from dexgarmentlab.cli import EXIT_OK, console
from dexgarmentlab.cli.flags import tell_command

if TYPE_CHECKING:
    from dgl_bench.physics import Reading

__all__ = ["BenchPhysicsOptions", "measure_physics", "print_rows"]


@dataclass(frozen=True, kw_only=True)
class BenchPhysicsOptions:
    """Measure the simulation of cloth and elastic solids, theory beside measurement.

    A row is a name, a value, its unit, the bar that the value should meet and whether it does. A
    bar that
    is not met is a finding and no failure: the exit status is 0.

    Example: dgl bench physics --report physics-report
    """

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
    """Print the rows as JSON."""


def measure_physics(options: BenchPhysicsOptions) -> int:
    """Measure and write the rows."""
    import dgl_bench.physics

    experiments = dgl_bench.physics.select(options.only)
    bench = dgl_bench.physics.Bench(
        effort=options.effort, seed=options.seed, newton_python=options.newton_python
    )
    if options.report is not None:
        options.report.mkdir(parents=True, exist_ok=True)
    results = []
    console.info(f"measuring {experiments[0].name} ...")
    for number, found in enumerate(dgl_bench.physics.run(experiments, bench), start=1):
        results.append(found)
        experiment, result, seconds = found
        judged = [row.ok for row in result.rows if row.ok is not None]
        following = experiments[number].name if number < len(experiments) else ""
        console.info(
            f"[{number}/{len(experiments)}] {experiment.name}: {sum(judged)} of {len(judged)} bars "
            "met, "
            f"{seconds:.1f} s" + (f"; measuring {following} ..." if following else "")
        )
    rows = [row for _, result, _ in results for row in result.rows]
    if options.report is not None:
        from dgl_bench.physics.report import write_report

        page = write_report(options.report, results, command=tell_command("bench physics", options))
        console.info(f"report: {page}")
    print_rows(rows, as_json=options.json)
    return EXIT_OK


def print_rows(rows: "Sequence[Reading]", *, as_json: bool) -> None:
    """Write rows as JSON or as a table."""
    from dgl_bench.rows import format_value

    if as_json:
        console.out_json([row.to_dict() for row in rows])
        return
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


_MARKS = {True: "yes", False: "no", None: ""}
