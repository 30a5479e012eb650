"""Flags of runs: shared groups, and the command line that asks for the same run again."""

import dataclasses
import shlex
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeVar, Union, get_type_hints

import tyro  # noqa: TID253 - the command line imports it anyway

if TYPE_CHECKING:
    from dgl_collect.workers import Workers
    from dgl_tasks.declaration import Task

__all__ = [
    "Actions",
    "Flags",
    "WorkerFlags",
    "check_picture",
    "check_writable",
    "find_recorded_task",
    "find_task",
    "join_options",
    "run_action",
    "tell_command",
    "told_how_to_continue",
]

T = TypeVar("T")
Flags = Annotated[T, tyro.conf.arg(name="")]
"""A group of flags without a common prefix, as a field of a verb's options."""
_NEVER_TOLD = ("resume", "json")

Actions = Mapping[str, tuple[type, Callable[[Any], int]]]
"""Actions of a verb by name: the options, and what is done with them."""


def join_options(actions: Actions) -> Any:
    """Join the options of a verb's actions, one subcommand each."""
    kinds = (Annotated[kind, tyro.conf.subcommand(n)] for n, (kind, _) in actions.items())
    return Annotated[Union[tuple(kinds)], tyro.conf.arg(name="")]  # noqa: UP007 - of a tuple


def run_action(actions: Actions, options: object) -> int:
    """Do what the action says to which the options belong."""
    return next(run for kind, run in actions.values() if type(options) is kind)(options)


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
        """Build the workers' settings of a run."""
        from dgl_collect.workers import Workers

        return Workers(
            count=self.workers,
            engine=self.engine,
            address=self.address,
            shared_out=self.shared_out,
        )


def tell_command(verb: str, options: Any) -> str:
    """Write the command line of a verb's options, without --resume and --json.

    Args:
        verb: One or more words after `dgl`.
        options: The options, a dataclass; fields at their defaults are left out.
    """
    positional, flags = _split_words(options)
    return shlex.join(map(str, ["dgl", *verb.split(), *positional, *flags]))


def _split_words(options: Any) -> tuple[list[object], list[object]]:
    """Give the positional words and the flags of options."""
    positional: list[object] = []
    flags: list[object] = []
    hints = get_type_hints(type(options), include_extras=True)
    for item in dataclasses.fields(options):
        value = getattr(options, item.name)
        if dataclasses.is_dataclass(value):
            more, named = _split_words(value)
            positional, flags = [*positional, *more], [*flags, *named]
        elif tyro.conf.Positional in getattr(hints[item.name], "__metadata__", ()):
            positional += _listed(value)
        elif item.name not in _NEVER_TOLD and value != item.default:
            name = item.name.replace("_", "-")
            if isinstance(value, bool):
                flags.append(f"--{name}" if value else f"--no-{name}")
            else:
                flags += [f"--{name}", *_listed(value)]
    return positional, flags


def _listed(value: object) -> list[object]:
    return [*value] if isinstance(value, tuple) else [value]


def check_picture(path: Path, *, flag: str = "--out") -> None:
    """Refuse a file for a picture that cannot be written, or does not end in .png."""
    if path.suffix.lower() != ".png":
        raise ValueError(f"{flag} must be a file .png; got {path}")
    check_writable(path.parent)


def check_writable(folder: Path) -> None:
    """Refuse a folder that can neither be written to nor made; nothing is made."""
    there = folder.absolute()
    try:
        while not there.exists():
            there = there.parent
        with tempfile.TemporaryFile(dir=there):
            pass
    except OSError as err:
        raise ValueError(f"cannot write to {folder}: {err.strerror}") from err


def find_task(source: str) -> "Task":
    """Find a task by id, file or module, and make its id known in this process."""
    from dgl_tasks import load_task

    if (here := str(Path.cwd())) not in sys.path:
        sys.path.insert(0, here)  # as `python -m` has it; workers inherit it
    return load_task(source)


def find_recorded_task(task_id: str, source: str | None) -> "Task":
    """Find the task of episodes by its id, or by the file or module that --task names.

    Raises:
        ValueError: If there is no such task, or the source declares another one.
    """
    from dgl_tasks.errors import UnknownTaskError

    try:
        task = find_task(source or task_id)
    except UnknownTaskError as err:
        if source is not None:
            raise
        raise ValueError(
            f"the task {task_id!r} of the episodes is not known; name the file or module that "
            "declares it: --task FILE"
        ) from err
    if task.id != task_id:
        raise ValueError(
            f"--task must declare {task_id!r}, the task of the episodes; got {task.id!r}"
        )
    return task


@contextmanager
def told_how_to_continue(command: str) -> Iterator[None]:
    """Add the command that continues to an error that ends a run and leaves what had finished."""
    from dgl_collect import MachineError, WorkerError

    try:
        yield
    except (MachineError, WorkerError) as err:
        text = f"{err}; what had finished is kept, continue with: {command} --resume"
        raise type(err)(text) from err
