"""`dgl bench collect`: the time of attempts, by component, and the memory of who makes them."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

from dexgarmentlab.cli import EXIT_OK, console
from dexgarmentlab.cli.bench_physics import print_rows

if TYPE_CHECKING:
    from dgl_bench.collect.timed import AttemptTimes

__all__ = ["BenchCollectOptions", "measure_collect"]


@dataclass(frozen=True, kw_only=True)
class BenchCollectOptions:
    """Time attempts with film and recording: components, total, start of a worker, several workers.

    Attempts are made as `dgl collect` makes them, but end after one round, and are thrown away.
    Times are processor time where they can be, since other work on the machine changes that least.
    With more than 20 attempts the growth of a process's memory after the 20th is told, too. A bar
    that is not met is
    a finding and no failure: the exit status is 0.

    Example: dgl bench collect --task FoldTops-v1 --attempts 6
    """

    task: tuple[str, ...] = ("FoldTops-v1", "FlingTops-v1")
    """Tasks to time; several workers are tried at the first one."""
    attempts: int | None = None
    """Attempts at each task, of seeds of their own; by default six, and one at Fling Tops."""
    seed: int = 0
    """Of the runs: as of `dgl collect`, every attempt gets its own from it."""
    workers: int = 2
    """Workers side by side that are compared with one; 1 leaves that out."""
    json: bool = False
    """Print the rows as JSON."""


def measure_collect(options: BenchCollectOptions) -> int:
    """Make the attempts and write the rows."""
    from dgl_bench.collect import Plan, make_attempts, measure_collection

    plan = Plan(
        tasks=options.task, attempts=options.attempts, seed=options.seed, workers=options.workers
    )
    with console.progress("making attempts", plan.total) as bar:

        def make(task: str, count: int, workers: int) -> "list[AttemptTimes]":
            before, note = bar.steps, f"{task}, {workers} worker{'s' * (workers > 1)}"
            return make_attempts(
                task,
                count,
                workers,
                seed=options.seed,
                on_attempt=lambda done: bar.reach(before + done, note=note),
            )

        rows = measure_collection(plan, make)
    print_rows(rows, as_json=options.json)
    return EXIT_OK
