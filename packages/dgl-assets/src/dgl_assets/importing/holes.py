"""Close holes that are too small to be openings of a garment."""

from __future__ import annotations

import numpy as np

from dgl_assets.importing.topology import find_loops


def compute_perimeter(vertices: np.ndarray, loop: np.ndarray) -> float:
    """Length around an opening [as the vertices]."""
    around = vertices[loop]
    return float(np.linalg.norm(around - np.roll(around, -1, axis=0), axis=1).sum())


def close_small_holes(
    vertices: np.ndarray, faces: np.ndarray, uvs: np.ndarray | None, *, largest: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray | None, int]:
    """Close holes with a fan around their middle.

    Args:
        vertices: Positions [m], shape (V, 3).
        faces: Oriented manifold triangles, shape (F, 3), int.
        uvs: Texture coordinates of corners, shape (F, 3, 2), or None.
        largest: Perimeter up to which a hole is closed [m].

    Returns:
        Vertices, faces, texture coordinates, and the number of holes that were closed.
    """
    closed = 0
    for loop in find_loops(faces):
        if compute_perimeter(vertices, loop) > largest:
            continue
        following = np.roll(loop, -1)
        middle = np.full(len(loop), len(vertices))
        if uvs is not None:
            # Of any face at the vertex: a hole this small lies within one patch of the texture.
            owner = {int(v): (f, k) for f, row in enumerate(faces) for k, v in enumerate(row)}
            around = np.array([uvs[owner[int(v)]] for v in loop])
            centre = np.tile(around.mean(axis=0), (len(loop), 1))
            uvs = np.concatenate([uvs, np.stack([np.roll(around, -1, axis=0), around, centre], 1)])
        vertices = np.concatenate([vertices, vertices[loop].mean(axis=0)[None]])
        faces = np.concatenate([faces, np.column_stack([following, loop, middle])])
        closed += 1
    return vertices, faces, uvs, closed
