"""Interfaces of workers and of the engines that start them."""

import time
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, Protocol

from dgl_collect.errors import MachineError, WorkerError
from dgl_collect.workers.jobs import Job, JobOutcome, Work
from dgl_files.fields import check_fields


@dataclass(frozen=True, kw_only=True)
class Workers:
    """Number of workers, and their engine.

    Raises:
        ValueError: If a value is out of its range, or does not fit the engine.
    """

    count: int = 1
    """Processes that work at the same time. The results do not depend on it."""
    engine: Literal["local", "ray"] = "local"
    """Processes of this machine, or of a Ray cluster."""
    address: str | None = None
    """Head of the Ray cluster, such as "auto" or "10.0.0.1:6379"; None starts a cluster of this
    machine alone."""
    shared_out: bool = False
    """Every node of the Ray cluster sees the output folder under the same path, so that workers
    write into it. Otherwise files travel through Ray."""

    def __post_init__(self) -> None:
        check_fields(self)
        if self.count < 1:
            raise ValueError(f"workers must be at least 1; got {self.count}")
        for name in ("address", "shared_out"):
            if self.engine == "local" and getattr(self, name):
                raise ValueError(f"{name} is for engine ray; got engine {self.engine}")


@dataclass(frozen=True, kw_only=True)
class Machine:
    """The machine of a worker."""

    host: str
    """Host name."""
    cpu: str
    """Model of its processor."""
    cpu_code: str
    """Code of the cloth solver, "vector" or "warp"; both compute the same bits."""


@dataclass(frozen=True, kw_only=True)
class Ready:
    """A worker has built its job runner."""

    machine: Machine
    versions: Mapping[str, str]
    """Package to version."""


@dataclass(frozen=True, kw_only=True)
class Lost:
    """A worker is lost, or cannot do another job."""

    how: str
    cause: Literal["crash", "machine", "time"] = "crash"
    """It ended by itself, with its whole machine, or for a time limit."""


Answer = Ready | JobOutcome | Lost | WorkerError | MachineError
"""Answer of a worker. The errors end the run: every other worker or job would meet them too."""


class Worker(ABC):
    """A worker, as the run sees it. It builds its job runner as soon as it runs."""

    def __init__(self, number: int) -> None:
        """Begin with a worker that waits for a processor; `number` is its number in the run."""
        self.number = number
        self.since: float | None = None
        """Time of its start or of its job [s]; None while it waits for a processor."""
        self.is_ready = False
        """True once its job runner is built."""
        self.job: Job | None = None
        """Its present job."""

    def assign(self, job: Job, out_dir: Path) -> None:
        """Hand over a job; a worker that is gone is noticed by `Engine.hear`."""
        self.job, self.since = job, time.monotonic()
        self._send(job, out_dir)

    @abstractmethod
    def _send(self, job: Job, out_dir: Path) -> None: ...

    @abstractmethod
    def release(self) -> None:
        """Let an idle worker release its job runner and end, without waiting for it."""

    @abstractmethod
    def kill(self) -> None:
        """End the worker, whatever it is doing, and wait until it has ended."""


class Engine(Protocol):
    """Starts workers and receives their answers."""

    def start(self, number: int, work: Work, log_path: Path) -> Worker:
        """Start a worker; `log_path` receives what it prints."""
        ...

    def hear(self, workers: Sequence[Worker], seconds: float) -> list[tuple[Worker, Answer]]:
        """Wait for answers, `seconds` at most, and return at most one of each worker."""
        ...

    def close(self) -> None:
        """Close the engine, after its workers have ended."""
        ...
