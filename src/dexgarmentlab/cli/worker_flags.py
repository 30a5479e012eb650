"""Flags of the workers of a run, and the command that continues a run."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Literal

import tyro  # noqa: TID253 - names a group of flags; the command line imports it anyway

if TYPE_CHECKING:
    from dgl_collect.workers import Workers

__all__ = ["Flags", "WorkerFlags", "told_how_to_continue"]


@dataclass(frozen=True, kw_only=True)
class WorkerFlags:
    """Workers of a run. Results are the same with any number of workers, and with both engines."""

    workers: int = 1
    """Processes that work at the same time."""
    engine: Literal["local", "ray"] = "local"
    """Processes of this machine, or of a Ray cluster of many machines."""
    address: str | None = None
    """Head of the Ray cluster, such as auto or 10.0.0.1:6379; by default Ray starts on this
    machine."""
    shared_out: bool = False
    """Workers write to the output folder, which every node of the Ray cluster sees under the same
    path. By default their files travel through Ray."""

    def make(self) -> "Workers":
        """Give what a run takes."""
        from dgl_collect.workers import Workers

        return Workers(
            count=self.workers,
            engine=self.engine,
            address=self.address,
            shared_out=self.shared_out,
        )

    @property
    def words(self) -> list[object]:
        """The words of a command line that asks for the same."""
        words: list[object] = ["--workers", self.workers]
        words += ["--engine", self.engine] if self.engine != "local" else []
        words += ["--address", self.address] if self.address is not None else []
        words += ["--shared-out"] if self.shared_out else []
        return words


Flags = Annotated[WorkerFlags, tyro.conf.arg(name="")]
"""`WorkerFlags` as a field of a verb's options."""


@contextmanager
def told_how_to_continue(command: str) -> Iterator[None]:
    """Add the command that goes on to an error that ends a run and leaves what had finished."""
    from dgl_collect import MachineError, WorkerError

    try:
        yield
    except (MachineError, WorkerError) as err:
        text = f"{err}; what had finished is kept, continue with: {command} --resume"
        raise type(err)(text) from err
