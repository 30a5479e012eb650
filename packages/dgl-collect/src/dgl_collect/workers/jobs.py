"""Jobs of a run, and the messages of workers."""

from __future__ import annotations

import importlib
import os
import platform
import socket
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any, Protocol


class JobRunner(Protocol):
    """Does jobs one after the other, with what it has built once.

    The result of a job must depend on its request alone, not on earlier jobs: then a run gives the
    same files with any number of workers, and a job whose worker is lost is simply done again.
    """

    def run(self, request: Any, out_dir: Path) -> object:
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
class Machine:
    """The machine of a worker."""

    host: str
    """Host name."""
    cpu: str
    """Model of its processor."""
    cpu_code: str
    """Code of the cloth solver, "vector" or "warp"; both compute the same bits."""


@dataclass(frozen=True, kw_only=True)
class Started:
    """A worker runs, and begins to build its job runner."""

    host: str


@dataclass(frozen=True, kw_only=True)
class Ready:
    """A worker has built its job runner."""

    machine: Machine
    versions: Mapping[str, str]


@dataclass(frozen=True, kw_only=True)
class RunEnded:
    """A fault that concerns every worker and job, such as a job runner that cannot be built."""

    reason: str


@dataclass(frozen=True, kw_only=True)
class Finished:
    """A job is done, or has failed by its own exception."""

    result: object
    failure: Failure | None
    seconds: float
    """Wall-clock time [s]."""


@dataclass(frozen=True, kw_only=True)
class MachineFault:
    """The machine has failed, not the job; for example, its disk is full."""

    reason: str


@dataclass(frozen=True, kw_only=True)
class Lost:
    """A worker is lost, or cannot do another job."""

    how: str
    with_machine: bool = False
    """The machine is lost, too."""


Message = Started | Ready | RunEnded | Finished | MachineFault | Lost


def load_callable(dotted_path: str) -> Callable[..., Any]:
    """Import a callable.

    Args:
        dotted_path: `module:name`.

    Raises:
        ValueError: If the path is not of that form, or names nothing callable.
        ImportError: If the module cannot be imported.
    """
    module_name, _, name = dotted_path.partition(":")
    if not module_name or not name:
        raise ValueError(f"factory must be 'module:name'; got {dotted_path!r}")
    found = getattr(importlib.import_module(module_name), name, None)
    if not callable(found):
        raise ValueError(f"factory must name a callable; {dotted_path!r} is {found!r}")
    return found


@cache
def describe_machine() -> Machine:
    """Describe the machine of this process."""
    from dgl_physics.launcher import find_vector_obstacle

    return Machine(
        host=socket.gethostname(),
        cpu=_find_cpu(),
        cpu_code="warp" if find_vector_obstacle() else "vector",
    )


def _find_cpu() -> str:
    path = Path("/proc/cpuinfo")
    if path.is_file():
        for line in path.read_text(encoding="utf-8", errors="replace").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or os.uname().machine
