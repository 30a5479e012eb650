"""Files that are either whole or absent, and files of whole lines."""

from __future__ import annotations

import errno
import hashlib
import json
import os
import secrets
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

PARTIAL_MARK = ".partial"
"""Part of the name of every file that is still being written."""

_ACCESS_FAULTS = {
    errno.EAGAIN: "another process has locked it",
    **{
        code: os.strerror(code).lower()
        for code in (
            errno.EACCES, errno.EPERM, errno.EBUSY, errno.EMFILE, errno.ENFILE, errno.ENOMEM,
            errno.EIO, errno.ESTALE, errno.ENOLCK, errno.ETIMEDOUT,
        )
    },
}  # fmt: skip


@contextmanager
def written_beside(path: Path) -> Iterator[Path]:
    """Yield a hidden path beside `path`, and rename it into place when the block succeeds.

    The partial file keeps the suffix, because encoders choose a format by it. When the block
    raises, the partial file is removed and `path` is untouched.

    Args:
        path: The finished file; its folder is made when missing.

    Yields:
        The path to write to.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    mark = f"{PARTIAL_MARK}-{os.getpid()}-{secrets.token_hex(3)}"
    partial = path.with_name(f".{path.stem}{mark}{path.suffix}")
    try:
        yield partial
        with partial.open("rb") as file:
            os.fsync(file.fileno())
        partial.replace(path)
    except BaseException:
        partial.unlink(missing_ok=True)
        raise
    sync_folder(path.parent)


def write_bytes(path: Path, content: bytes) -> None:
    """Write a file of bytes."""
    with written_beside(path) as partial:
        partial.write_bytes(content)


def write_text(path: Path, text: str) -> None:
    """Write a file of UTF-8 text."""
    write_bytes(path, text.encode())


def write_json(path: Path, content: Mapping[str, object]) -> None:
    """Write a JSON object.

    Args:
        path: The file.
        content: Finite numbers, text, lists and objects.

    Raises:
        ValueError: If a number is not finite; JSON has no word for it.
    """
    text = json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False)
    write_text(path, text + "\n")


def append_line(path: Path, line: str) -> None:
    """Append one whole line and flush it to disk.

    Args:
        path: The file; made when missing.
        line: The text, without its line end.
    """
    with path.open("ab") as file:
        before = file.tell()
        try:
            file.write(line.encode() + b"\n")
            file.flush()
            os.fsync(file.fileno())
        except OSError:
            os.truncate(path, before)  # A full disk may have taken a part of the line.
            raise


def drop_unfinished_line(path: Path) -> None:
    """Cut off a last line that has no line end."""
    if not path.exists():
        return
    content = path.read_bytes()
    whole = content.rfind(b"\n") + 1
    if whole < len(content):
        os.truncate(path, whole)


def describe_access_fault(err: BaseException) -> str | None:
    """Describe an error of the operating system that says nothing of a file's content.

    Such a file may be whole: it is locked, forbidden, or on a failing disk.

    Returns:
        The reason; None for other errors.
    """
    if "already open for write" in str(err):  # HDF5 gives no number for it.
        return "another process has it open for writing, or was killed while it had"
    return _ACCESS_FAULTS.get(err.errno or 0) if isinstance(err, OSError) else None


def sync_folder(folder: Path) -> None:
    """Flush a folder's directory entry to disk, so that a rename inside it survives a power cut."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def compute_checksum(path: Path) -> str:
    """Compute the SHA-256 of a file, in hexadecimal digits."""
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while part := file.read(2**20):
            digest.update(part)
    return digest.hexdigest()
