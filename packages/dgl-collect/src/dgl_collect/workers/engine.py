"""What an engine and a worker are: an engine starts workers, and hears from them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, Protocol, get_args

from dgl_collect.workers.jobs import Job, Message, Work

EngineName = Literal["local", "ray"]


@dataclass(frozen=True, kw_only=True)
class Workers:
    """How many workers there are, and where.

    Raises:
        ValueError: If a value is out of its range, or does not fit the engine.
    """

    count: int = 1
    """Processes that work at the same time. The results do not depend on it."""
    engine: EngineName = "local"
    """Processes of this machine, or of a Ray cluster."""
    address: str | None = None
    """Of the Ray cluster's head, such as "auto" or "10.0.0.1:6379"; a cluster of this machine alone when None."""
    shared_out: bool = False
    """Whether every node of the Ray cluster sees the output folder under the same path: files are written there by the
    workers. Without it they travel through Ray."""

    def __post_init__(self) -> None:
        if self.count < 1:
            raise ValueError(f"workers must be at least 1; got {self.count}")
        if self.engine not in get_args(EngineName):
            raise ValueError(
                f"engine must be one of {list(get_args(EngineName))}; got {self.engine!r}"
            )
        for name in ("address", "shared_out"):
            if self.engine == "local" and getattr(self, name):
                raise ValueError(f"{name} is for engine ray; got engine {self.engine}")


class Worker(Protocol):
    """The run's side of one worker. It builds its job runner as soon as it has a place."""

    number: int
    """Of the worker in the run."""
    has_place: bool
    """Whether it runs; a `Placed` message tells when it begins to, if it does not at once."""

    def assign(self, job: Job, out_dir: Path) -> None:
        """Hand over a job; a worker that is gone meanwhile is noticed when it is heard."""
        ...

    def release(self) -> None:
        """Let an idle worker release its job runner and end, without waiting for it."""
        ...

    def kill(self) -> None:
        """End the worker, whatever it is doing, and wait until it has ended."""
        ...


class Engine(Protocol):
    """Starts workers, and hears from them."""

    def start(self, number: int, work: Work, log_path: Path) -> Worker:
        """Start a worker; `log_path` receives what it prints."""
        ...

    def hear(self, workers: Sequence[Worker], seconds: float) -> list[tuple[Worker, Message]]:
        """Wait for messages, `seconds` at most, and give at most one of each worker."""
        ...

    def close(self) -> None:
        """End what the engine has started; its workers have ended by then."""
        ...
