"""Throughput of several workers side by side, relative to one alone."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from dgl_bench.collect.timed import AttemptTimes

__all__ = ["Throughput", "compare_throughput"]


@dataclass(frozen=True, kw_only=True)
class Throughput:
    """The attempts of a run with several workers, while all of them were busy."""

    ratio: float
    """Throughput relative to that of one worker."""
    cores: float
    """Cores that the workers had, by their processor time; fewer where other programs run."""
    processor_ratio: float
    """Throughput if each worker had a core: their number, times the processor time of the same
    attempts alone over that side by side. The loss is due to shared caches and memory."""


def compare_throughput(
    alone: Sequence[AttemptTimes], together: Sequence[AttemptTimes], *, workers: int
) -> Throughput:
    """Compare a run of several workers with the same attempts by one worker.

    Attempts take different times, and at the end workers have nothing left to do. So what counts is
    from when the last worker has begun until the first one has ended, and an attempt counts by its
    time alone, in part where it began before or ended after.

    Args:
        alone: The attempts of one worker.
        together: The same attempts of several workers.
        workers: How many.

    Raises:
        ValueError: If the attempts are not the same, or the workers were never busy at the same
            time.
    """
    by_index: Mapping[int, AttemptTimes] = {times.index: times for times in alone}
    if sorted(by_index) != sorted(times.index for times in together):
        raise ValueError(
            f"both runs must make the same attempts; got {sorted(by_index)} and "
            f"{sorted(times.index for times in together)}"
        )
    processes = {times.process for times in together}
    by_process = [[t for t in together if t.process == process] for process in processes]
    first = max(min(times.began for times in own) for own in by_process)
    last = min(max(times.ended for times in own) for own in by_process)
    if len(processes) < workers or not first < last:
        raise ValueError(
            f"{workers} workers must be busy at the same time; {len(together)} attempts are too few"
        )
    done = used = same = 0.0
    for times in together:
        share = max(0.0, min(times.ended, last) - max(times.began, first)) / times.elapsed
        done += share * by_index[times.index].elapsed
        used += share * times.seconds
        same += share * by_index[times.index].seconds
    return Throughput(
        ratio=done / (last - first),
        cores=used / (last - first),
        processor_ratio=workers * same / used,
    )
