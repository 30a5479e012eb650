"""Cache of the distance grids of large meshes on disk, one file each."""

import hashlib
import logging
import os
import zipfile
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path

import numpy as np

from dgl_files.whole import written_beside
from dgl_physics.distance_grid import DistanceGrid

logger = logging.getLogger(__name__)

VERSION = 1
"""To be raised whenever the grid of the same mesh changes."""
LEAST_FACES = 2000
"""Grids of smaller meshes are not kept: they are built as fast as read."""


def get_cache_folder() -> Path:
    """Return the folder of grids, in `$XDG_CACHE_HOME` or else in `~/.cache`."""
    base = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    return Path(base) / "dexgarmentlab" / "grids"


def load_or_build(
    vertices: np.ndarray,
    faces: np.ndarray,
    settings: tuple[object, ...],
    build: Callable[[], DistanceGrid],
) -> DistanceGrid:
    """Read the grid of a mesh, or build it and keep it.

    A damaged file is built again; a folder that cannot be written is logged.

    Args:
        vertices: Of the mesh [m], shape (V, 3).
        faces: Shape (F, 3).
        settings: Further settings of the grid.
        build: Builds it.
    """
    if len(faces) < LEAST_FACES:
        return build()
    key = hashlib.sha256(repr((VERSION, vertices.shape, faces.shape, settings)).encode())
    key.update(np.ascontiguousarray(vertices, dtype=np.float64).tobytes())
    key.update(np.ascontiguousarray(faces, dtype=np.int64).tobytes())
    path = get_cache_folder() / f"{key.hexdigest()[:32]}.npz"
    found = _read(path)
    if found is None:
        found = build()
        _write(path, found)
    return found


def _read(path: Path) -> DistanceGrid | None:
    if not path.is_file():
        return None
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
            content = {field.name: archive[field.name] for field in fields(DistanceGrid)}
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as err:
        logger.warning("%s cannot be read (%s); it is made again", path, err)
        return None
    for name in ("spacing", "reach"):
        content[name] = float(content[name])
    return DistanceGrid(**content)


def _write(path: Path, grid: DistanceGrid) -> None:
    try:
        with written_beside(path) as partial:
            np.savez(partial, **{field.name: getattr(grid, field.name) for field in fields(grid)})
    except OSError as err:
        logger.warning("the grid of a mesh cannot be kept in %s (%s)", path.parent, err)
