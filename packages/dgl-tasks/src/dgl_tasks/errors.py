"""Errors that a caller of the tasks may want to catch."""

import difflib
from collections.abc import Sequence

from dgl_files.fields import show


class TaskError(Exception):
    """Base of the errors of this package."""


class UnknownTaskError(TaskError, ValueError):
    """No task has this id; the message names the closest and all known ones."""

    def __init__(self, task: object, known: Sequence[str]) -> None:
        """Keep the id beside the message."""
        by_lower = {name.lower(): name for name in known}
        close = difflib.get_close_matches(str(task).lower(), by_lower, n=1, cutoff=0.5)
        hint = f"did you mean {by_lower[close[0]]!r}? Known" if close else "known"
        super().__init__(f"unknown task {show(task)}; {hint} tasks: {', '.join(known)}")
        self.task = task


class DeclarationError(TaskError, ValueError):
    """A file or module does not declare a task, or declares one whose id is taken."""


class PerceptionError(TaskError):
    """A camera does not see the garment or the objects."""


class RenderingUnavailableError(TaskError):
    """There is no renderer, or no window; `render_backend="none"` with states needs neither."""


class EnvironmentClosedError(TaskError):
    """An environment is used after `close`."""


class RobotFilesError(OSError):
    """The folder of generated robot files cannot be written: a fault of the machine."""

    def __str__(self) -> str:
        """Give the message without the number of `OSError`."""
        return str(self.args[0])


class PolicyError(ValueError):
    """A policy gave actions of a wrong form; the run ends, since every attempt would fail."""

    ends_run = True


class PolicyUnavailableError(TaskError):
    """A policy server does not answer, or answers with an error."""


class UnreachableError(TaskError):
    """An arm has no joint configuration for a wanted pose, or none on its present branch."""
