"""Attempts are made as `dgl collect` makes them, and timed."""

import shutil
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from dgl_bench.collect.rows import (
    find_worker_obstacle,
    make_memory_rows,
    make_start_rows,
    make_task_rows,
    make_worker_rows,
)
from dgl_bench.collect.timed import FACTORY, AttemptTimes, TimedOptions
from dgl_bench.rows import Reading
from dgl_collect import AttemptResult, CollectConfig, Progress, Workers, collect
from dgl_tasks import load_task

__all__ = ["Plan", "make_attempts", "measure_collection"]

TASKS = ("FoldTops-v1", "FlingTops-v1")
"""Tasks measured by default."""
ATTEMPTS = {"FlingTops-v1": 1}
"""Attempts at a task, where these are not `MANY`."""
MANY = 6


@dataclass(frozen=True, kw_only=True)
class Plan:
    """Plan of a measurement.

    Raises:
        ValueError: If a number is out of its range.
        UnknownTaskError: If there is no such task.
    """

    tasks: tuple[str, ...] = TASKS
    """Tasks, by id, file or module; several workers are tried at the first one."""
    attempts: int | None = None
    """Attempts at each task, at least 1; six, and one at Fling Tops, when None."""
    seed: int = 0
    """Seed of the runs; every attempt gets its own from it, as in a collection."""
    workers: int = 2
    """Workers that are compared with one, at least 1; they are not when it is 1."""

    def __post_init__(self) -> None:
        for name, value, least in (
            ("attempts", MANY if self.attempts is None else self.attempts, 1),
            ("seed", self.seed, 0),
            ("workers", self.workers, 1),
        ):
            if value < least:
                raise ValueError(f"{name} must be at least {least}; got {value}")
        if not self.tasks:
            raise ValueError("tasks must name at least one task; got none")
        for task in self.tasks:
            load_task(task)

    def count_attempts(self, task: str) -> int:
        """Tell how many attempts are made at a task."""
        return ATTEMPTS.get(task, MANY) if self.attempts is None else self.attempts

    @property
    def total(self) -> int:
        """Attempts in all."""
        again = self.count_attempts(self.tasks[0]) if self.has_side_by_side else 0
        return again + sum(self.count_attempts(task) for task in self.tasks)

    @property
    def has_side_by_side(self) -> bool:
        """True if attempts are also made by several workers."""
        count = self.count_attempts(self.tasks[0])
        return self.workers > 1 and find_worker_obstacle(self.workers, count) is None


Make = Callable[[str, int, int], list[AttemptTimes]]
"""Makes the attempts at a task: its id, their number, and the number of workers."""


def measure_collection(plan: Plan, make: Make) -> list[Reading]:
    """Make the attempts of a plan.

    Args:
        plan: What to measure.
        make: Makes the attempts, see `make_attempts`.
    """
    first, *others = plan.tasks
    count = plan.count_attempts(first)
    alone = make(first, count, 1)
    rows = make_task_rows(first, alone) + make_memory_rows(first, alone)
    for task in others:
        attempts = make(task, plan.count_attempts(task), 1)
        rows += make_task_rows(task, attempts) + make_memory_rows(task, attempts)
    together = make(first, count, plan.workers) if plan.has_side_by_side else []
    rows += make_start_rows([*alone, *together])
    if plan.workers > 1:
        rows += make_worker_rows(first, alone, together, workers=plan.workers)
    return rows


def make_attempts(
    task: str,
    count: int,
    workers: int,
    *,
    seed: int,
    on_attempt: Callable[[int], None] = lambda done: None,
) -> list[AttemptTimes]:
    """Make attempts as a collection does, with film and recording, and throw away what they give.

    Args:
        task: Environment id.
        count: How many.
        workers: Processes that make them.
        seed: Of the run.
        on_attempt: Is told how many have been made.

    Returns:
        The attempts in their order.

    Raises:
        KeyboardInterrupt: If the run was interrupted.
        WorkerError: If workers cannot work.
        ValueError: If an attempt ended early. After an error the run's folder is kept, with the
            workers' logs.
    """
    results: list[AttemptResult] = []

    def report(progress: Progress) -> None:
        results[:] = progress.results
        on_attempt(len(results))

    folder = Path(tempfile.mkdtemp(prefix="dgl-bench-"))
    config = CollectConfig(
        task=task,
        episodes=count,
        out=folder,
        seed=seed,
        workers=Workers(count=workers),
        attempt_factory=FACTORY,
        options=TimedOptions(launched=time.time()),
    )
    summary = collect(config, on_progress=report)
    if summary.status == "interrupted":
        shutil.rmtree(folder)
        raise KeyboardInterrupt
    try:
        times = [AttemptTimes.from_result(result) for result in results]
    except ValueError as err:
        raise ValueError(f"{err}; the run is kept in {folder}") from err
    shutil.rmtree(folder)
    return sorted(times, key=lambda attempt: attempt.index)
