"""Errors of this package that callers may catch."""

from pathlib import Path


class CollectionError(Exception):
    """Base of every error that this package raises on purpose."""


class CorruptEpisodeError(CollectionError):
    """An episode file is damaged, incomplete or of another format.

    Attributes:
        path: The file.
        fault: In a few words.
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
    """An episode lacks data that a replay needs, such as its commands."""


class OutputFolderError(CollectionError, ValueError):
    """An output folder is not writable, not empty, busy, or of another run."""


class WorkerError(CollectionError):
    """Workers cannot be built, keep dying, or lost their cluster; finished jobs are kept."""


class EngineError(CollectionError):
    """Workers cannot be started: no Ray, or no cluster at the address."""


class MachineError(CollectionError):
    """The machine failed, for example with a full disk; finished jobs are kept."""


class DemonstrationError(CollectionError):
    """A demonstration is missing or faulty."""


class MissingPackageError(CollectionError):
    """A package that only some functions need is not installed."""

    def __init__(self, name: str, requirement: str) -> None:
        super().__init__(f"{name} is not installed: pip install '{requirement}'")
