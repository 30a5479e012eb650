"""Exceptions that a caller may want to catch."""

from pathlib import Path

__all__ = [
    "CheckpointError",
    "DamagedEpisodeError",
    "EpisodeAccessError",
    "ObservationError",
    "PrimitiveError",
    "SadpError",
    "TrainingDivergedError",
    "TrainingProcessError",
    "UnsuitableEpisodeError",
]


class SadpError(Exception):
    """Base of the errors of this package. Wrong arguments raise `ValueError` instead."""


class CheckpointError(SadpError):
    """A file is not a checkpoint of this package, is damaged, or does not fit."""


class ObservationError(SadpError):
    """An observation lacks something, or has another shape or values that are not finite."""


class PrimitiveError(SadpError):
    """Recordings are too few or do not fit, or a primitive lacks an anchor."""


class TrainingDivergedError(SadpError):
    """The loss of a training is no longer finite."""


class TrainingProcessError(SadpError):
    """A process of a training on several devices has ended without having said why."""


class DamagedEpisodeError(SadpError):
    """A file is damaged, or is not an episode of the format that this package reads."""

    advice = "; remove the file or collect the episode again"

    def __init__(self, path: Path, reason: str) -> None:
        super().__init__(f"{path}: {reason}{self.advice}")
        self.path = path
        self.reason = reason

    def __reduce__(self) -> tuple[type, tuple[Path, str]]:
        """Keep both arguments when a data loader's worker sends the error to its parent."""
        return type(self), (self.path, self.reason)


class EpisodeAccessError(SadpError):
    """A file cannot be opened now, though it may be whole: locked, or not readable."""

    def __init__(self, path: Path, reason: str) -> None:
        super().__init__(f"{path} cannot be read now: {reason}")
        self.path = path
        self.reason = reason

    def __reduce__(self) -> tuple[type, tuple[Path, str]]:
        """Keep both arguments when a data loader's worker sends the error to its parent."""
        return type(self), (self.path, self.reason)


class UnsuitableEpisodeError(DamagedEpisodeError):
    """A whole file does not fit: another robot, format version, stage, or a copy."""

    advice = ""
