"""Attempts that time themselves, in the workers of an ordinary collection."""

import os
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from dgl_bench.collect.components import COMPONENTS, REST, STEP
from dgl_bench.collect.stopwatch import Stopwatch, watch_functions
from dgl_bench.process_memory import measure_process_memory
from dgl_collect.attempt import Attempts, make_attempt_runner
from dgl_collect.attempt_jobs import AttemptRequest
from dgl_collect.options import RecordOptions
from dgl_collect.results import AttemptResult

__all__ = ["FACTORY", "AttemptTimes", "TimedAttempts", "TimedOptions", "make_timed_attempts"]

FACTORY = f"{__name__}:make_timed_attempts"
"""Factory of the collection's workers."""
_COMPONENT = "component: "
_PROCESS, _BEGAN, _ENDED, _MEMORY = "process", "began", "ended", "memory"
_START, _START_ELAPSED = "start", "start elapsed"


@dataclass(frozen=True, kw_only=True)
class AttemptTimes:
    """Time of one attempt, by component."""

    index: int
    """Its number in the run."""
    process: int
    """Number of its worker's process."""
    success: bool
    components: Mapping[str, float]
    """Processor time of all threads by component [s]."""
    began: float
    """Begin [s since 1970]."""
    ended: float
    """End [s since 1970]."""
    memory: int
    """Resident memory of its worker's process at its end [bytes]."""
    start: float | None = None
    """Processor time of its process until the first control step [s]; None in all attempts of a
    worker but the first."""
    start_elapsed: float | None = None
    """Time from the start of the collection until then [s]."""

    @property
    def seconds(self) -> float:
        """Processor time of the whole attempt [s]."""
        return sum(self.components.values())

    @property
    def elapsed(self) -> float:
        """Time from its begin to its end [s]."""
        return self.ended - self.began

    @classmethod
    def from_result(cls, result: AttemptResult) -> "AttemptTimes":
        """Read what `TimedAttempts` has put into a result.

        Raises:
            ValueError: If there is nothing, as the attempt did not come to an end.
        """
        found = result.measurements
        if _BEGAN not in found:
            raise ValueError(
                f"attempt {result.index} did not end: {result.reason}, {result.detail}"
            )
        return cls(
            index=result.index,
            process=round(found[_PROCESS]),
            success=result.success,
            components={
                name.removeprefix(_COMPONENT): seconds
                for name, seconds in found.items()
                if name.startswith(_COMPONENT)
            },
            began=found[_BEGAN],
            ended=found[_ENDED],
            memory=round(found[_MEMORY]),
            start=found.get(_START),
            start_elapsed=found.get(_START_ELAPSED),
        )


@dataclass(frozen=True, kw_only=True)
class TimedOptions(RecordOptions):
    """Options of timed attempts."""

    rounds: int | None = 1
    """One round, done or not: how many a garment needs is a matter of success and not of speed."""
    launched: float = 0.0
    """Start of the collection [s since 1970]."""


def make_timed_attempts(task: str, options: TimedOptions) -> "TimedAttempts":
    """Build the attempts of a task; see `dgl_collect.CollectConfig.attempt_factory`."""
    return TimedAttempts(make_attempt_runner(task, options), options.launched)


class TimedAttempts:
    """Makes another runner's attempts, and adds their times to what they measure."""

    def __init__(self, runner: Attempts, launched: float) -> None:
        """Time a runner's attempts; `launched` is the start of the collection [s since 1970]."""
        self._runner, self._launched = runner, launched
        self._has_started = False

    def close(self) -> None:
        """Release the environment."""
        self._runner.close()

    def run(self, request: AttemptRequest, out_dir: Path) -> AttemptResult:
        """Make one attempt."""
        watch, began = Stopwatch(), time.time()
        with watch_functions(watch, COMPONENTS), watch.part(REST):
            result = self._runner.run(request, out_dir)
        times = {_COMPONENT + name: watch.seconds[name] for name in (*COMPONENTS, REST)}
        times |= {_PROCESS: os.getpid(), _BEGAN: began, _ENDED: time.time()}
        times[_MEMORY] = measure_process_memory()
        if STEP in watch.first and not self._has_started:
            # the processor time of a process counts from its start
            times[_START], at = watch.first[STEP]
            times[_START_ELAPSED] = at - self._launched
            self._has_started = True
        return replace(result, measurements={**result.measurements, **times})
