"""Verb `dgl bench`."""

from dataclasses import dataclass
from typing import Annotated, Literal

import tyro  # noqa: TID253 - marks the positional argument; the command line imports it anyway

from dexgarmentlab.cli import EXIT_OK, console

__all__ = ["Options", "run"]


@dataclass(frozen=True, kw_only=True)
class Options:
    """Measure this machine: the numbers that the documentation quotes.

    A row is a name, a value, its unit, the bar that the value should meet and whether it does. A bar that
    is not met is a finding and no failure: the exit status is 0.

    Example: dgl bench physics --json
    """

    subject: Annotated[Literal["physics"], tyro.conf.Positional]
    """What to measure: the cloth simulation."""
    quick: bool = False
    """Time fewer frames; the speeds are rough then."""
    json: bool = False
    """Write the rows as JSON."""


def run(options: Options) -> int:
    """Measure and write the rows."""
    from dexgarmentlab import _bench_physics

    rows = []
    with console.progress(f"measuring {options.subject}", _bench_physics.count_rows()) as bar:
        for row in _bench_physics.measure(effort=0.1 if options.quick else 1.0):
            rows.append(row)
            bar.advance(note=row.name)
    if options.json:
        console.out_json([row.to_dict() for row in rows])
    else:
        console.out_table(
            ("name", "value", "unit", "bar", "ok"),
            [(r.name, _format(r.value), r.unit, r.bar, _MARKS[r.ok]) for r in rows],
        )
    return EXIT_OK


_MARKS = {True: "yes", False: "no", None: ""}


def _format(value: float | None) -> str:
    return "failed" if value is None else f"{value:.3g}" if abs(value) < 1e3 else f"{value:,.0f}"
