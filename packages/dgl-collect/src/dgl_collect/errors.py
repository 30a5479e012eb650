"""What callers of this package may want to catch."""

from __future__ import annotations

from pathlib import Path


class CollectionError(Exception):
    """Base of every error that this package raises on purpose."""


class CorruptEpisodeError(CollectionError):
    """An episode file is damaged, incomplete or of another format.

    Attributes:
        path: The file.
        fault: What is wrong with it.
    """

    def __init__(self, path: Path, fault: str) -> None:
        super().__init__(f"{path}: {fault}")
        self.path = path
        self.fault = fault


class FileUnavailableError(CollectionError):
    """A file cannot be read now: another process has locked it, or reading is not permitted.

    The file may be whole; it must not be called damaged.
    """


class NotReplayableError(CollectionError):
    """An episode does not hold what a replay needs, such as its commands."""


class OutputFolderError(CollectionError, ValueError):
    """The output folder cannot be used: not writable, not empty, busy, or of another run."""


class WorkerError(CollectionError):
    """Workers cannot be built, keep dying, or their cluster is gone; what had finished is kept."""


class EngineError(CollectionError):
    """There is nothing to start workers on: Ray is not installed, or there is no cluster at the address."""


class MachineError(CollectionError):
    """The machine has failed at something, such as writing to a full disk; what had finished is kept."""


class DemonstrationError(CollectionError):
    """A demonstration is missing, or its file is not as it should be."""
