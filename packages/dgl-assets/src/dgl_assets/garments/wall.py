"""Check that a wall fits behind a shell's surface, so that it becomes valid tetrahedra."""

from __future__ import annotations

import numpy as np

from dgl_assets.garments.meshing import compute_vertex_normals

_STRETCH = 2.0  # largest lengthening of the wall where the surface is bent
_SMALLEST = 0.04  # of a third of a straight prism; smaller tetrahedra count as folded


def find_folds(vertices: np.ndarray, faces: np.ndarray, thickness: float) -> np.ndarray:
    """Find triangles behind which a wall would fold over itself.

    The wall's inner side is the surface moved along its vertices' mean normals, farther where the
    triangles around a vertex are bent, so that it is as thick behind each of them. Each triangle
    and its inner copy are a prism.

    Args:
        vertices: Outer side [m], shape (V, 3).
        faces: Triangles, counter-clockwise from outside, shape (F, 3).
        thickness: Of the wall [m].

    Returns:
        Indices of faces, sorted, shape (N,).
    """
    outer = vertices.astype(np.float64)
    corners = outer[faces]
    area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal = compute_vertex_normals(outer, faces)
    size = np.linalg.norm(area, axis=1)
    unit = area / np.maximum(size, 1e-15)[:, None]
    cosine = np.zeros(len(outer))
    np.add.at(cosine, faces.ravel(), (unit[:, None] * normal[faces]).sum(axis=2).ravel())
    cosine /= np.maximum(np.bincount(faces.ravel(), minlength=len(outer)), 1)
    inner = outer - normal * (thickness / np.maximum(cosine, 1 / _STRETCH))[:, None]

    # Three tetrahedra a prism, side diagonals from the lower index (Dompierre et al. 1999).
    order = np.argsort(faces, axis=1)
    sign = np.where((order[:, 1] - order[:, 0]) % 3 == 1, 1.0, -1.0)
    i, j, k = (np.take_along_axis(corners, order[:, n, None, None], axis=1)[:, 0] for n in range(3))
    ii, jj, kk = (inner[np.take_along_axis(faces, order[:, [n]], axis=1)[:, 0]] for n in range(3))
    share = size * thickness / 6  # of one of three tetrahedra of a straight prism
    is_folded = size < 1e-12
    for a, b, c, d, turn in ((i, j, k, kk, -1), (i, j, jj, kk, 1), (i, ii, jj, kk, -1)):
        volume = np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a) / 6
        is_folded |= sign * turn * volume < _SMALLEST * share
    return np.flatnonzero(is_folded)
