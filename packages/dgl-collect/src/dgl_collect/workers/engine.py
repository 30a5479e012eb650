"""Interfaces of workers and of the engines that start them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, Protocol

from dgl_collect.workers.jobs import Job, Message, Work
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


class Worker(Protocol):
    """A worker, as the run sees it. It builds its job runner as soon as it runs."""

    number: int
    """Number of the worker in the run."""
    is_started: bool
    """True once it runs; a `Started` message tells when, if not at once."""

    def assign(self, job: Job, out_dir: Path) -> None:
        """Hand over a job; a worker that is gone is noticed by `Engine.hear`."""
        ...

    def release(self) -> None:
        """Let an idle worker release its job runner and end, without waiting for it."""
        ...

    def kill(self) -> None:
        """End the worker, whatever it is doing, and wait until it has ended."""
        ...


class Engine(Protocol):
    """Starts workers and receives their messages."""

    def start(self, number: int, work: Work, log_path: Path) -> Worker:
        """Start a worker; `log_path` receives what it prints."""
        ...

    def hear(self, workers: Sequence[Worker], seconds: float) -> list[tuple[Worker, Message]]:
        """Wait for messages, `seconds` at most, and return at most one of each worker."""
        ...

    def close(self) -> None:
        """Close the engine, after its workers have ended."""
        ...
