"""Named points of a garment in a file: vertex numbers or positions."""

from __future__ import annotations

import reprlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dgl_assets.importing.bounds import LARGEST_COORDINATE, MAX_KEYPOINTS, MAX_TEXT
from dgl_assets.importing.errors import UnreadableFileError
from dgl_assets.importing.paths import read_json
from dgl_files.fields import show

_OFF_SURFACE = 0.02  # of the bounding box's diagonal that a position may lie off the surface


@dataclass(frozen=True, kw_only=True, eq=False)
class Keypoints:
    """Named points on the vertices or the surface of a mesh, in its own units."""

    names: tuple[str, ...]
    positions: np.ndarray
    """Shape (K, 3), float64."""
    vertex_ids: np.ndarray
    """Vertex of the file, or -1 where a position was given, shape (K,)."""


def read_keypoints(path: Path, vertices: np.ndarray) -> Keypoints:
    """Read a JSON file `{"left_cuff": 123, "collar": [x, y, z]}`, or the same under "keypoints".

    Args:
        path: Of the file.
        vertices: Of the mesh that it belongs to, shape (V, 3).

    Raises:
        UnreadableFileError: If it is broken or a vertex does not exist; with the point's name.
    """
    tree = read_json(path)
    if isinstance(tree, dict) and isinstance(tree.get("keypoints"), dict):
        tree = tree["keypoints"]
    if not isinstance(tree, dict) or len(tree) > MAX_KEYPOINTS:
        raise UnreadableFileError(
            f"{path.name} must map at most {MAX_KEYPOINTS} names to vertices or positions"
        )
    positions, ids = [], []
    for name, value in tree.items():
        if not 0 < len(name) <= MAX_TEXT:
            raise UnreadableFileError(
                f"{path.name}: names must have 1 to {MAX_TEXT} characters; got {len(name)}"
            )
        if isinstance(value, int) and not isinstance(value, bool):
            if not 0 <= value < len(vertices):
                raise UnreadableFileError(
                    f"{path.name}: {name!r} is vertex {show(value)}, "
                    f"but the mesh has {len(vertices)}"
                )
            ids.append(value)
            positions.append(vertices[value])
            continue
        if not _is_position(value):
            raise UnreadableFileError(
                f"{path.name}: {name!r} must be a vertex or three numbers below "
                f"{LARGEST_COORDINATE:g}; "
                f"got {reprlib.repr(value)}"
            )
        ids.append(-1)
        positions.append(np.array(value, dtype=np.float64))
    return Keypoints(
        names=tuple(tree),
        positions=np.array(positions, dtype=np.float64).reshape(-1, 3),
        vertex_ids=np.array(ids, dtype=np.int64),
    )


def check_on_surface(
    keypoints: Keypoints, vertices: np.ndarray, distances: np.ndarray, name: str
) -> None:
    """Refuse points that are not of this mesh.

    Args:
        keypoints: The points.
        vertices: Of the mesh, shape (V, 3).
        distances: Of the points from the surface, in the same units, shape (K,).
        name: Of the file, for messages.

    Raises:
        UnreadableFileError: With the first such point and the count.
    """
    limit = _OFF_SURFACE * float(np.linalg.norm(np.ptp(vertices, axis=0)))
    off = np.flatnonzero(distances > limit)
    if len(off):
        raise UnreadableFileError(
            f"{name}: {len(off)} landmarks lie off the surface, the first is "
            f"{keypoints.names[off[0]]!r} by "
            f"{distances[off[0]]:.3g} units; they must be in the units and axes of the mesh"
        )


def _is_position(value: object) -> bool:
    return (
        isinstance(value, list)
        and len(value) == 3
        and all(isinstance(x, int | float) and not isinstance(x, bool) for x in value)
        and all(abs(x) <= LARGEST_COORDINATE for x in value)
    )
