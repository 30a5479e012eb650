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
    """A file of the package's tasks does not declare one, or one that there is already."""


class PerceptionError(TaskError):
    """A camera sees nothing of what it should see."""


class RenderingUnavailableError(TaskError):
    """There is no renderer or no window for what was asked; state observations with `render_backend="none"` need none."""


class EnvironmentClosedError(TaskError):
    """An environment is used after `close`."""


class RobotFilesError(OSError):
    """The folder of generated robot files cannot be written. It is no `TaskError`: the machine is at fault, not the task."""

    def __str__(self) -> str:
        """Give the message alone, without the number that `OSError` puts before it."""
        return str(self.args[0])


class UnreachableError(TaskError):
    """An arm has no joint configuration for a wanted pose, or none on its present branch.

    Attributes:
        distance: Remaining position error of the best configuration found [m]; 0 when the pose is
            met but only by a jump of the joints.
        angle: Remaining orientation error of that configuration [rad].
    """

    def __init__(self, message: str, *, distance: float, angle: float = 0.0) -> None:
        """Keep the measures beside the message."""
        super().__init__(message)
        self.distance = distance
        self.angle = angle
