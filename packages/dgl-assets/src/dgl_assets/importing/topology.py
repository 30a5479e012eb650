"""Edges, pieces and openings of triangle meshes, as arrays."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components


class EdgeTable(NamedTuple):
    """The undirected edges of a triangle mesh."""

    pairs: np.ndarray
    """Vertex ids, the smaller first, shape (E, 2), int64."""
    face_edges: np.ndarray
    """Edge from corner k to corner k + 1 of each face, shape (F, 3), int64."""
    counts: np.ndarray
    """Faces at each edge, shape (E,), int64."""
    faces: np.ndarray
    """Two of the faces at each edge, -1 where there is none, shape (E, 2), int64."""


def compute_edge_table(faces: np.ndarray) -> EdgeTable:
    """Find the edges of a triangle mesh.

    Args:
        faces: Triangles, shape (F, 3), int.
    """
    faces = np.asarray(faces, dtype=np.int64)
    half_edges = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2), 1)
    span = int(faces.max()) + 1 if len(faces) else 1
    keys, inverse, counts = np.unique(
        half_edges[:, 0] * span + half_edges[:, 1], return_inverse=True, return_counts=True
    )
    inverse = inverse.reshape(-1)
    order = np.argsort(inverse, kind="stable")
    first = np.cumsum(counts) - counts
    owner = order // 3
    second = np.where(counts > 1, owner[np.minimum(first + 1, len(owner) - 1)], -1)
    return EdgeTable(
        pairs=np.column_stack([keys // span, keys % span]),
        face_edges=inverse.reshape(-1, 3),
        counts=counts,
        faces=np.column_stack([owner[first], second]) if len(keys) else np.empty((0, 2), np.int64),
    )


def label_components(count: int, pairs: np.ndarray) -> tuple[int, np.ndarray]:
    """Label the connected components of a graph.

    Args:
        count: Number of nodes.
        pairs: Links, shape (N, 2), int.

    Returns:
        Number of components, and the label of each node, shape (count,), int.
    """
    weights = np.ones(len(pairs), dtype=np.int8)
    graph = coo_matrix((weights, (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    number, labels = connected_components(graph, directed=False)
    return int(number), labels


def label_pieces(faces: np.ndarray) -> tuple[int, np.ndarray]:
    """Label faces by the piece that they belong to: faces of one piece share edges.

    Args:
        faces: Triangles, shape (F, 3), int.

    Returns:
        Number of pieces, and the piece of each face, shape (F,), int.
    """
    edges = compute_edge_table(faces)
    owner = np.repeat(np.arange(len(faces)), 3)
    return label_components(
        len(faces), np.column_stack([edges.faces[edges.face_edges.ravel(), 0], owner])
    )


def find_loops(faces: np.ndarray) -> list[np.ndarray]:
    """Follow the open edges of an oriented mesh whose faces form one fan at each vertex.

    Args:
        faces: Triangles, shape (F, 3), int.

    Returns:
        Vertex ids of each opening in the direction of its faces, each shape (L,), the opening of
        most vertices first.
    """
    edges = compute_edge_table(faces)
    is_open = (edges.counts == 1)[edges.face_edges]  # (F, 3)
    start, end = faces[is_open], np.roll(faces, -1, axis=1)[is_open]
    following = dict(zip(start.tolist(), end.tolist(), strict=True))
    loops = []
    while following:
        first = next(iter(following))
        loop = [first]
        vertex = following.pop(first)
        while vertex != first:
            loop.append(vertex)
            vertex = following.pop(vertex)
        loops.append(np.array(loop, dtype=np.int64))
    return sorted(loops, key=lambda loop: (-len(loop), int(loop.min())))


def compute_normals(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Compute normals and areas of triangles.

    Args:
        vertices: Positions, shape (V, 3).
        faces: Triangles, shape (F, 3), int.

    Returns:
        Unit normals, shape (F, 3), zero for triangles without area; areas, shape (F,).
    """
    corners = vertices[faces]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    double = np.linalg.norm(cross, axis=1)
    return cross / np.maximum(double, 1e-300)[:, None], double / 2


def compute_vertex_normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Compute unit normals at vertices, weighted by area, shape (V, 3)."""
    normals, areas = compute_normals(vertices, faces)
    total = np.zeros((len(vertices), 3))
    for k in range(3):
        for axis in range(3):
            total[:, axis] += np.bincount(
                faces[:, k], normals[:, axis] * areas, minlength=len(vertices)
            )
    return total / np.maximum(np.linalg.norm(total, axis=1), 1e-300)[:, None]


def drop_unused(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Renumber the vertices that faces use, in their order.

    Args:
        vertices: Shape (V, D).
        faces: Shape (F, 3), int.

    Returns:
        Ids of the vertices that stay, shape (W,), and the renumbered faces, shape (F, 3).
    """
    used = np.zeros(len(vertices), dtype=bool)
    used[faces] = True
    number = np.cumsum(used) - 1
    return np.flatnonzero(used), number[faces]
