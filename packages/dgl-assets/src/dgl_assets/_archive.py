"""Archives of plain arrays on disk: a file appears whole or not at all, and holds no pickled objects."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np


def get_cache_folder(kind: str) -> Path:
    """Give a folder for what can be made again: in `$XDG_CACHE_HOME`, or in `~/.cache` where that is not set."""
    base = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    return Path(base) / "dexgarmentlab" / kind


def write_archive(path: Path, arrays: Mapping[str, np.ndarray]) -> None:
    """Write arrays by name, beside their place and renamed."""
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, beside = tempfile.mkstemp(dir=path.parent, suffix=".part")
    try:
        with os.fdopen(handle, "wb") as file:
            np.savez_compressed(file, **arrays)  # pyright: ignore[reportArgumentType]
        Path(beside).replace(path)
    except BaseException:
        Path(beside).unlink(missing_ok=True)
        raise


def read_archive(path: Path, names: tuple[str, ...]) -> dict[str, np.ndarray]:
    """Read arrays by name.

    Raises:
        OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile: If the file is damaged or lacks one.
    """
    with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
        return {name: archive[name] for name in names}
