"""Jobs of a run, and their outcomes."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol


class JobRunner(Protocol):
    """Does jobs one after the other, with what it has built once.

    The result of a job must depend on its request alone, not on earlier jobs: then a run gives the
    same files with any number of workers, and a job whose worker is lost is simply done again.
    """

    def run(self, request: Any, out_dir: Path, /) -> object:
        """Do one job.

        Args:
            request: Of the job.
            out_dir: An empty folder for the job's files; thrown away when the worker is lost.

        Returns:
            The result, picklable.
        """
        ...

    def close(self) -> None:
        """Release what was built."""
        ...


@dataclass(frozen=True, kw_only=True)
class Work:
    """Construction of a worker's job runner."""

    factory: str
    """`module:name` of a callable that returns a `JobRunner`."""
    arguments: Mapping[str, object] = field(default_factory=dict)
    """Its keyword arguments, picklable."""


@dataclass(frozen=True, kw_only=True)
class Job:
    """One piece of work."""

    name: str
    """Unique in a run, and valid as the name of a folder."""
    request: object
    """Argument of the job runner, picklable."""


@dataclass(frozen=True, kw_only=True)
class Failure:
    """Reason why a job has no result."""

    reason: str
    """The reason in a few words without numbers, so that equal failures can be counted."""
    detail: str
    """The reason with numbers."""


@dataclass(frozen=True, kw_only=True)
class JobOutcome:
    """Outcome of a job."""

    job: Job
    result: object
    """Returned by the job runner; None after a failure."""
    failure: Failure | None
    seconds: float
    """Wall-clock time of the job on its worker [s]."""
    folder: Path
    """Folder of the job's files. It is removed when the next outcome is asked for."""
