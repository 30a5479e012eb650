"""Times of attempts as rows."""

import os
import statistics
from collections.abc import Sequence

from dgl_bench.collect.components import COMPONENTS, REST
from dgl_bench.collect.throughput import compare_throughput
from dgl_bench.collect.timed import AttemptTimes
from dgl_bench.rows import Reading

__all__ = [
    "find_worker_obstacle",
    "make_memory_rows",
    "make_start_rows",
    "make_task_rows",
    "make_worker_rows",
    "select_median",
]

ATTEMPT_BARS = {"FoldTops-v1": 18.0, "FlingTops-v1": 20.0}
"""Longest times of an attempt of one round [s]."""
START_BAR = 8.0
"""Longest time of a worker to its first control step [s]."""
EFFICIENCY_BAR = 0.95
"""Least throughput of each of several workers, relative to one that is alone."""
MEMORY_BAR = 5.0
"""Largest growth of a process's memory after its attempt number `WARM` [%]."""
WARM = 20
"""Attempts after which a process has made what it keeps."""


def make_task_rows(task: str, attempts: Sequence[AttemptTimes]) -> list[Reading]:
    """Sum up the attempts at a task by one worker; the components add up to the attempt."""
    middle = select_median(attempts)
    seconds = statistics.fmean(times.seconds for times in middle)
    least, most = (pick(times.seconds for times in attempts) for pick in (min, max))
    succeeded = sum(times.success for times in attempts)
    name = f"{task}, attempt"
    bar = f"<= {ATTEMPT_BARS[task]:g}" if task in ATTEMPT_BARS else ""
    rows = [
        Reading(
            name,
            seconds,
            "s",
            bar=bar,
            note=f"processor time; median of {len(attempts)}, {least:.1f} to {most:.1f}; "
            f"{succeeded} succeeded "
            "in their first round, where they end",
        ),
        Reading(
            f"{name}, elapsed",
            statistics.median(times.elapsed for times in attempts),
            "s",
            note="more than the processor time where the machine has other work to do",
        ),
    ]
    for component in (*COMPONENTS, REST):
        part = statistics.fmean(times.components[component] for times in middle)
        rows.append(
            Reading(
                f"{task}, {component}",
                part,
                "s",
                note=f"{100 * part / seconds:.1f} % of the attempt",
            )
        )
    return rows


def select_median(attempts: Sequence[AttemptTimes]) -> list[AttemptTimes]:
    """Choose the attempt in the middle, or the two there, whose mean is the median."""
    ordered = sorted(attempts, key=lambda times: times.seconds)
    count = len(ordered)
    return ordered[(count - 1) // 2 : count // 2 + 1]


def make_start_rows(attempts: Sequence[AttemptTimes]) -> list[Reading]:
    """Sum up the start of workers: from a new process to the first control step."""
    starts = [(t.start, t.start_elapsed) for t in attempts if t.start is not None]
    name = "start of a worker to its first control step"
    if not starts:
        return [Reading.skip(name, "s", "no attempt came to a control step")]
    seconds, elapsed = min(starts)
    return [
        Reading(
            name,
            seconds,
            "s",
            bar=f"<= {START_BAR:g}",
            note=f"processor time; quickest of {len(starts)}, as the first one may compile kernels",
        ),
        Reading(f"{name}, elapsed", elapsed, "s", note="of the same worker"),
    ]


def make_memory_rows(task: str, attempts: Sequence[AttemptTimes]) -> list[Reading]:
    """Report the memory, and its growth, of the process that made the attempts at a task.

    Args:
        task: Environment id.
        attempts: Of one worker, in their order.
    """
    name = f"{task}, memory of a process"
    rows = [Reading(f"{name} at the end", attempts[-1].memory / 2**30, "GiB")]
    if len(attempts) > WARM and len({times.process for times in attempts}) == 1:
        warm = attempts[WARM - 1].memory
        rows.append(
            Reading(
                f"{name}, growth after {WARM} attempts",
                100 * (attempts[-1].memory / warm - 1),
                "%",
                bar=f"<= {MEMORY_BAR:g}",
                note=f"{len(attempts)} attempts",
            )
        )
    return rows


def find_worker_obstacle(workers: int, attempts: int) -> str | None:
    """Return the reason why workers cannot be compared by so many attempts, or None."""
    cores = len(os.sched_getaffinity(0))
    if cores < workers:
        return f"this machine has {cores} cores; compare fewer with --workers"
    if attempts < 2 * workers:
        return f"{attempts} attempts are too few; make {2 * workers} --attempts or more"
    return None


def make_worker_rows(
    task: str, alone: Sequence[AttemptTimes], together: Sequence[AttemptTimes], *, workers: int
) -> list[Reading]:
    """Compare several workers with one, see `compare_throughput`; or give a skipped row."""
    name = f"{task}, {workers} workers against 1"
    if obstacle := find_worker_obstacle(workers, len(alone)):
        return [Reading.skip(name, "times", obstacle)]
    found = compare_throughput(alone, together, workers=workers)
    rate = 3600 / statistics.fmean(times.elapsed for times in alone)
    return [
        Reading(f"{task}, 1 worker", rate, "attempts/h"),
        Reading(f"{task}, {workers} workers", rate * found.ratio, "attempts/h"),
        Reading(
            name,
            found.ratio,
            "times",
            bar=f">= {EFFICIENCY_BAR * workers:g}",
            note=f"elapsed time; the workers had {found.cores:.2f} cores, less than {workers} "
            "where the machine has "
            "other work to do",
        ),
        Reading(
            f"{name}, had each a core",
            found.processor_ratio,
            "times",
            note="by the processor time of the same attempts",
        ),
    ]
