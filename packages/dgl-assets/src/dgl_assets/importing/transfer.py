"""Carry texture coordinates over to a new mesh of the same surface."""

from __future__ import annotations

import numpy as np

from dgl_assets.importing.surface import SurfaceIndex
from dgl_assets.importing.topology import (
    compute_edge_table,
    compute_normals,
    compute_vertex_normals,
    label_components,
)

MAX_PATCHES = 256
"""Most patches that a texture may be cut into."""
_SAME = 1e-5  # texture coordinates that differ by less are one


def label_patches(faces: np.ndarray, uvs: np.ndarray) -> tuple[int, np.ndarray]:
    """Label texture patches: faces with texture coordinates that continue over their edge.

    Args:
        faces: Triangles, shape (F, 3), int.
        uvs: Texture coordinates of corners, shape (F, 3, 2).

    Returns:
        Number of patches, and the patch of each face, shape (F,).
    """
    edges = compute_edge_table(faces)
    inner = np.flatnonzero(edges.counts == 2)
    first, second = edges.faces[inner].T
    same = np.ones(len(inner), dtype=bool)
    for end in range(2):
        vertex = edges.pairs[inner, end][:, None]
        there = [uvs[f, np.argmax(faces[f] == vertex, axis=1)] for f in (first, second)]
        same &= np.abs(there[0] - there[1]).max(axis=1) < _SAME
    return label_components(len(faces), np.column_stack([first, second])[same])


def transfer_uvs(
    surface: SurfaceIndex, uvs: np.ndarray, vertices: np.ndarray, faces: np.ndarray
) -> np.ndarray:
    """Texture coordinates of the corners of a new mesh.

    Each new triangle takes the patch at its middle, so that no triangle spans two patches.

    Args:
        surface: The former mesh.
        uvs: Texture coordinates of its corners, shape (F, 3, 2).
        vertices: Positions of the new mesh [m], shape (V, 3).
        faces: Its triangles, shape (G, 3), int.

    Returns:
        Shape (G, 3, 2), float64.
    """
    _, patches = label_patches(surface.faces, uvs)
    normals, _ = compute_normals(vertices, faces)
    vertex_normals = compute_vertex_normals(vertices, faces)
    middle, _ = surface.locate(vertices[faces].mean(axis=1), normals)
    result = np.empty((len(faces), 3, 2))
    for patch in np.unique(patches[middle]):
        members = np.flatnonzero(patches[middle] == patch)
        ids, place = np.unique(faces[members], return_inverse=True)
        found, weights = surface.locate(vertices[ids], vertex_normals[ids], faces=patches == patch)
        values = (uvs[found] * weights[:, :, None]).sum(axis=1)
        result[members] = values[place.reshape(-1, 3)]
    return result
