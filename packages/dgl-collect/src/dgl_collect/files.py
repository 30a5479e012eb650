"""Files that are either whole or absent, and files of whole lines."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

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
        file.write(line.encode() + b"\n")
        file.flush()
        os.fsync(file.fileno())


def drop_unfinished_line(path: Path) -> None:
    """Cut off a last line without a line end, so that the next one starts on a line of its own."""
    if not path.exists():
        return
    content = path.read_bytes()
    whole = content.rfind(b"\n") + 1
    if whole < len(content):
        os.truncate(path, whole)
