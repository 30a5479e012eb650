"""Errors that a caller of the tasks may want to catch."""


class TaskError(Exception):
    """Base of the errors of this package."""


class UnknownTaskError(TaskError, ValueError):
    """There is no task of that id."""


class DeclarationError(TaskError, ValueError):
    """A file of the package's tasks does not declare one, or one that there is already."""


class PerceptionError(TaskError):
    """A camera sees nothing of what it should see."""


class RenderingUnavailableError(TaskError):
    """No renderer could be started; state observations with `render_backend="none"` need none."""


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
