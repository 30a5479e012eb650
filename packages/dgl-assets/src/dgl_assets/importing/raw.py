"""Content of a mesh file, in its own units and axes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dgl_assets.importing.bounds import LARGEST_COORDINATE, check_size
from dgl_assets.importing.errors import UnreadableFileError


@dataclass(frozen=True, kw_only=True, eq=False)
class ClothPicture:
    """A picture on the cloth."""

    data: bytes
    """The whole picture file."""
    suffix: str
    """".png" or ".jpg"."""


@dataclass(frozen=True, kw_only=True, eq=False)
class RawMesh:
    """Triangles as they are in a file, in its own units and axes."""

    vertices: np.ndarray
    """Positions, shape (V, 3), float64, in the order of the file."""
    faces: np.ndarray
    """Triangles, shape (F, 3), int64."""
    uvs: np.ndarray | None = None
    """Texture coordinates of each corner, v upwards, shape (F, 3, 2), float64."""
    texture: ClothPicture | None = None
    unit: float | None = None
    """Length of a unit that the file states [m]."""
    up: str | None = None
    """Up axis that the file states, "y" or "z"."""
    notes: tuple[str, ...] = ()
    """Parts that were left out, and assumptions."""
    objects: tuple[tuple[str, ...], ...] = ()
    """Names of each object of the file: its own, and those of its groups."""
    object_ids: np.ndarray | None = None
    """Object of each triangle, -1 for none, shape (F,), int64; None where the file names none."""


def check_raw(mesh: RawMesh, name: str) -> None:
    """Refuse a mesh that cannot be a surface.

    Args:
        mesh: Content of the file.
        name: Name of the file, for messages.

    Raises:
        UnreadableFileError: If there are no faces, too many, indices of vertices that do not exist,
            or positions that are not finite; with the first index and the count.
    """
    vertices, faces = mesh.vertices, mesh.faces
    if not len(vertices) or not len(faces):
        raise UnreadableFileError(
            f"{name} holds no surface: {len(vertices)} vertices and {len(faces)} faces"
        )
    check_size(len(vertices), len(faces), name)
    outside = np.flatnonzero(((faces < 0) | (faces >= len(vertices))).any(axis=1))
    if len(outside):
        raise UnreadableFileError(
            f"{name}: {len(outside)} faces use vertices that do not exist, the first is face "
            f"{outside[0]} with {faces[outside[0]].tolist()} of {len(vertices)} vertices"
        )
    wrong = np.flatnonzero(~np.isfinite(vertices).all(axis=1))
    if len(wrong):
        raise UnreadableFileError(
            f"{name}: {len(wrong)} vertices are not finite, the first is vertex {wrong[0]} with "
            f"{vertices[wrong[0]].tolist()}"
        )
    largest = float(np.abs(vertices).max())
    if largest > LARGEST_COORDINATE:
        raise UnreadableFileError(
            f"{name}: coordinates must be below {LARGEST_COORDINATE:g}; got {largest:g}"
        )
    if mesh.uvs is not None and not np.isfinite(mesh.uvs).all():
        bad = np.flatnonzero(~np.isfinite(mesh.uvs).all(axis=(1, 2)))
        raise UnreadableFileError(
            f"{name}: texture coordinates of {len(bad)} faces are not finite, the first is face "
            f"{bad[0]}"
        )


def triangulate(sizes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Cut polygons into fans of triangles.

    Args:
        sizes: Number of corners of each, at least three, shape (P,), int.

    Returns:
        Polygon of each triangle, shape (F,), and its corners in the polygon, shape (F, 3).
    """
    counts = np.asarray(sizes, dtype=np.int64) - 2
    owner = np.repeat(np.arange(len(counts)), counts)
    ordinal = np.arange(len(owner)) - np.repeat(np.cumsum(counts) - counts, counts)
    return owner, np.column_stack([np.zeros_like(ordinal), ordinal + 1, ordinal + 2])
