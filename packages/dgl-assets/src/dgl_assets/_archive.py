"""Files that appear whole or not at all, and archives of plain arrays without pickled objects."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import BinaryIO

import numpy as np


def get_cache_folder(kind: str) -> Path:
    """Give a folder for files that can be made again, in `$XDG_CACHE_HOME` or `~/.cache`."""
    base = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    return Path(base) / "dexgarmentlab" / kind


def write_whole(path: Path, write: Callable[[BinaryIO], object]) -> None:
    """Write a file beside its place and rename it; missing folders are made."""
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, beside = tempfile.mkstemp(dir=path.parent, suffix=".part")
    try:
        with os.fdopen(handle, "wb") as file:
            write(file)
        Path(beside).replace(path)
    except BaseException:
        Path(beside).unlink(missing_ok=True)
        raise


def write_archive(path: Path, arrays: Mapping[str, np.ndarray]) -> None:
    """Write arrays by name; the file appears whole."""
    write_whole(path, lambda file: np.savez_compressed(file, **arrays))  # pyright: ignore[reportArgumentType]


def read_archive(path: Path, names: tuple[str, ...]) -> dict[str, np.ndarray]:
    """Read arrays by name.

    Raises:
        OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile: If one is damaged or missing.
    """
    with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
        return {name: archive[name] for name in names}
