"""Folders that one run writes to, and faults of the disk."""

import errno
import fcntl
import os
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from dgl_collect.errors import FileUnavailableError, MachineError, OutputFolderError
from dgl_files.whole import describe_access_fault

FULL_BYTES = 1_000_000
"""A disk with less room than this [bytes] counts as full."""
_DISK_FAULTS = {
    errno.ENOSPC: "the disk is full",
    errno.EDQUOT: "the disk quota is used up",
    errno.EROFS: "the disk can only be read",
    errno.EIO: "the disk cannot be read or written",
}


@contextmanager
def unavailable_told(path: Path) -> Iterator[None]:
    """Tell apart a file that cannot be read now from one that is damaged.

    Raises:
        FileUnavailableError: If the block raises an error of the operating system that says nothing
            of the file's content: locked, forbidden, a failing disk.
    """
    try:
        yield
    except OSError as err:
        if reason := describe_access_fault(err):
            raise FileUnavailableError(f"{path} cannot be read now: {reason}") from err
        raise


def describe_disk_fault(err: BaseException) -> str | None:
    """Describe the fault of a disk that an error, or one of its causes, comes from."""
    seen: BaseException | None = err
    while seen is not None:
        if isinstance(seen, OSError) and seen.errno in _DISK_FAULTS:
            where = f": {seen.filename}" if isinstance(seen.filename, str) else ""
            return _DISK_FAULTS[seen.errno] + where
        seen = seen.__cause__ or seen.__context__
    return None


@contextmanager
def disk_faults_told() -> Iterator[None]:
    """Turn errors of a full or failing disk into a `MachineError`.

    Raises:
        MachineError: If the block raises such an error.
    """
    try:
        yield
    except OSError as err:
        if fault := describe_disk_fault(err):
            raise MachineError(fault) from err
        raise


def describe_full_disk(folder: Path) -> str | None:
    """Describe a disk without room for another file in the folder."""
    free = shutil.disk_usage(folder).free
    return None if free >= FULL_BYTES else f"the disk is full: {folder}"


@contextmanager
def locked_folder(folder: Path) -> Iterator[None]:
    """Lock a folder against other runs; it is made if missing.

    Raises:
        OutputFolderError: If another run is writing to it, or it cannot be written to.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        probe = folder / f".writable-{os.getpid()}"
        probe.touch()
        probe.unlink()
    except OSError as err:
        raise OutputFolderError(f"cannot write to {folder}: {err.strerror}") from err
    lock = os.open(folder, os.O_RDONLY)
    try:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as err:
            raise OutputFolderError(f"another run is writing to {folder}") from err
        yield
    finally:
        os.close(lock)  # which gives up the lock


def check_continued(
    folder: Path, found: Mapping[str, object], identity: Mapping[str, object]
) -> None:
    """Check that a folder holds the run that is to be continued.

    Args:
        folder: Of the run.
        found: Content of the file that describes the run there.
        identity: Entries that must be equal.

    Raises:
        OutputFolderError: If an entry differs.
    """
    for key, value in identity.items():
        if (was := found.get(key)) == value:
            continue
        what = f"its {key} is {was!r}, this run's is {value!r}"
        if isinstance(was, Mapping) and isinstance(value, Mapping):
            names = [name for name in {**was, **value} if was.get(name) != value.get(name)]
            what = f"{key}: " + "; ".join(
                f"its {name} is {_tell(was, name)}, this run's is {_tell(value, name)}"
                for name in names
            )
        raise OutputFolderError(f"cannot resume {folder}: {what}; choose another --out")


def _tell(options: Mapping[str, object], name: str) -> str:
    return repr(options[name]) if name in options else "not given"
