"""Files that are either whole or absent, files of whole lines, and folders that one run writes to."""

from __future__ import annotations

import errno
import fcntl
import hashlib
import json
import os
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

from dgl_collect.errors import MachineError, OutputFolderError

FULL_BYTES = 1_000_000
"""A disk with less room than this [bytes] is full: a file is not begun that may not fit."""
_DISK_FAULTS = {
    errno.ENOSPC: "the disk is full",
    errno.EDQUOT: "the disk quota is used up",
    errno.EROFS: "the disk can only be read",
    errno.EIO: "the disk cannot be read or written",
}
PARTIAL_MARK = ".partial"
"""Part of the name of every file that is still being written."""


def sync_folder(folder: Path) -> None:
    """Flush a folder's directory entry to disk, so that a rename inside it survives a power cut."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


@contextmanager
def written_beside(path: Path) -> Iterator[Path]:
    """Give a path beside `path` to write to, and rename it into place when the block succeeds.

    The partial file is hidden and keeps the suffix, because encoders choose a format by it. When the
    block raises, the partial file is removed and `path` is untouched.

    Args:
        path: Where the finished file belongs; its folder is made when missing.

    Yields:
        The path to write to.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(f".{path.stem}{PARTIAL_MARK}-{os.getpid()}{path.suffix}")
    try:
        yield partial
        with partial.open("rb") as file:
            os.fsync(file.fileno())
        partial.replace(path)
    except BaseException:
        with suppress(FileNotFoundError):
            partial.unlink()
        raise
    sync_folder(path.parent)


def write_bytes(path: Path, content: bytes) -> None:
    """Write a file, whole or not at all."""
    with written_beside(path) as partial:
        partial.write_bytes(content)


def compute_checksum(path: Path) -> str:
    """Compute the SHA-256 of a file, in hexadecimal digits."""
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while part := file.read(2**20):
            digest.update(part)
    return digest.hexdigest()


def describe_disk_fault(err: BaseException) -> str | None:
    """Say what is wrong with a disk, if that is what an error or one of its causes comes from."""
    seen: BaseException | None = err
    while seen is not None:
        if isinstance(seen, OSError) and seen.errno in _DISK_FAULTS:
            where = f": {seen.filename}" if isinstance(seen.filename, str) else ""
            return _DISK_FAULTS[seen.errno] + where
        seen = seen.__cause__ or seen.__context__
    return None


@contextmanager
def disk_faults_told() -> Iterator[None]:
    """Turn errors of a disk that is full, or fails, into one that says so.

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
    """Say that there is no room for another file in a folder, if there is none."""
    free = shutil.disk_usage(folder).free
    return None if free >= FULL_BYTES else f"the disk is full: {folder}"


def write_json(path: Path, content: Mapping[str, object]) -> None:
    """Write a JSON object so that the file is either the old one or the new one.

    Args:
        path: The file.
        content: Finite numbers, text, lists and objects.

    Raises:
        ValueError: If a number is not finite; JSON has no word for it.
    """
    text = json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False) + "\n"
    with written_beside(path) as partial:
        partial.write_text(text, encoding="utf-8")


def append_line(path: Path, line: str) -> None:
    """Append one whole line and flush it to disk.

    Args:
        path: Made when missing.
        line: Without its line end.
    """
    with path.open("ab") as file:
        before = file.tell()
        try:
            file.write(line.encode() + b"\n")
            file.flush()
            os.fsync(file.fileno())
        except OSError:
            os.truncate(path, before)  # a part of a line may have found room
            raise


def drop_unfinished_line(path: Path) -> None:
    """Cut off a last line without a line end, so that the next one starts on a line of its own."""
    if not path.exists():
        return
    content = path.read_bytes()
    whole = content.rfind(b"\n") + 1
    if whole < len(content):
        os.truncate(path, whole)


@contextmanager
def locked_folder(folder: Path) -> Iterator[None]:
    """Keep other runs from writing to the folder, which is made if it is missing.

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
    """Check that a folder's run is the one that is to be continued.

    Args:
        folder: Of the run.
        found: What its file says of the run that is there.
        identity: What must be equal.

    Raises:
        OutputFolderError: If something is not.
    """
    for key, value in identity.items():
        if found.get(key) != value:
            raise OutputFolderError(
                f"cannot resume {folder}: its {key} is {found.get(key)!r}, this run's is {value!r}; "
                "choose another --out"
            )
