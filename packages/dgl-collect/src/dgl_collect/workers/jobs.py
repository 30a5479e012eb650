"""What workers are asked for, and what they answer."""

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
    """Does jobs, one after the other, with what it has built once.

    What comes out of a job must depend on its request alone, not on the jobs before it: then a run gives the same
    files with any number of workers, and a job that was lost with its worker is simply done again.
    """

    def run(self, request: Any, out_dir: Path) -> object:
        """Do one job.

        Args:
            request: What the job asks for.
            out_dir: An empty folder for the job's files. Whatever is in it when a worker is lost is thrown away.

        Returns:
            The result; it has to be picklable.
        """
        ...

    def close(self) -> None:
        """Release what was built."""
        ...


@dataclass(frozen=True, kw_only=True)
class Work:
    """What workers are for: how each of them makes its job runner."""

    factory: str
    """`module:name` of a callable that gives a `JobRunner`."""
    arguments: Mapping[str, object] = field(default_factory=dict)
    """Its keyword arguments; picklable."""


@dataclass(frozen=True, kw_only=True)
class Job:
    """One piece of work."""

    name: str
    """Different for every job of a run, and fit for the name of a folder."""
    request: object
    """What the job runner is given; picklable."""


@dataclass(frozen=True, kw_only=True)
class Failure:
    """Why a job has no result."""

    reason: str
    """In a few words without numbers, so that equal failures can be counted."""
    detail: str
    """The same with numbers."""


@dataclass(frozen=True, kw_only=True)
class Machine:
    """What a worker runs on."""

    host: str
    """Its name in the network."""
    cpu: str
    """Model of its processor."""
    cpu_code: str
    """Which code of the cloth solver it runs, "vector" or "warp"; both compute the same bits."""


@dataclass(frozen=True, kw_only=True)
class Placed:
    """A worker has got its place, and begins to build what it needs."""

    host: str


@dataclass(frozen=True, kw_only=True)
class Ready:
    """A worker has built what it needs."""

    machine: Machine
    versions: Mapping[str, str]


@dataclass(frozen=True, kw_only=True)
class StartFailed:
    """A worker could not build what it needs."""

    reason: str


@dataclass(frozen=True, kw_only=True)
class Done:
    """A job is done; its files are in its folder."""

    result: object
    seconds: float
    """Wall-clock time [s]."""


@dataclass(frozen=True, kw_only=True)
class Raised:
    """A job has raised an exception that is its own fault."""

    failure: Failure
    seconds: float


@dataclass(frozen=True, kw_only=True)
class MachineFault:
    """The machine has failed, not the job: its disk is full, say."""

    reason: str


@dataclass(frozen=True, kw_only=True)
class Lost:
    """A worker is gone."""

    how: str
    """How it ended."""
    with_machine: bool = False
    """Whether its machine is gone too."""


Message = Placed | Ready | StartFailed | Done | Raised | MachineFault | Lost


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
    """Say what this process runs on."""
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
