"""Archives of plain arrays on disk, without pickled objects."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from dgl_files.whole import written_beside


def get_cache_folder(kind: str) -> Path:
    """Give a folder for files that can be made again, in `$XDG_CACHE_HOME` or `~/.cache`."""
    base = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    return Path(base) / "dexgarmentlab" / kind


def write_archive(path: Path, arrays: Mapping[str, np.ndarray]) -> None:
    """Write arrays by name; the file appears whole."""
    with written_beside(path) as beside, beside.open("wb") as file:
        np.savez_compressed(file, **arrays)  # pyright: ignore[reportArgumentType]


def read_archive(path: Path, names: tuple[str, ...]) -> dict[str, np.ndarray]:
    """Read arrays by name.

    Raises:
        OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile: If one is damaged or missing.
    """
    with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
        return {name: archive[name] for name in names}
