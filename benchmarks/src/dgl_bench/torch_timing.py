"""Time of what runs in PyTorch on a fixed number of threads."""

import statistics
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

__all__ = ["measure_median", "torch_threads"]


@contextmanager
def torch_threads(count: int, repeats: int) -> Iterator[None]:
    """Run PyTorch on so many threads of the CPU.

    Raises:
        ValueError: If one of the numbers that the caller was given is not positive.
    """
    import torch

    if repeats < 1 or count < 1:
        raise ValueError(f"repeats and threads must be positive; got {repeats} and {count}")
    before = torch.get_num_threads()
    torch.set_num_threads(count)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def measure_median(work: Callable[[], object], repeats: int) -> tuple[float, float]:
    """Median duration and processor time [s] of work, after one untimed call.

    Args:
        work: Its results have arrived on the CPU when it returns.
        repeats: Timed calls.
    """
    work()
    times, processor = [], []
    for _ in range(repeats):
        began, used = time.perf_counter(), time.process_time()
        work()
        times.append(time.perf_counter() - began)
        processor.append(time.process_time() - used)
    return statistics.median(times), statistics.median(processor)
