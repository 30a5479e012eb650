"""Tetrahedral meshes: checks, surfaces, and thin shells made of prisms.

Positions `vertices` are in metres, shape (V, 3); `tets` and `faces` are vertex indices, shapes
(T, 4) and (F, 3), counter-clockwise seen from outside.
"""

import numpy as np

from dgl_physics import topology
from dgl_physics.errors import MeshError

# Faces of a tetrahedron of positive volume, counter-clockwise seen from outside.
_FACES = np.array([[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]])
_EDGES = np.array([[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]])


def compute_volumes(vertices: np.ndarray, tets: np.ndarray) -> np.ndarray:
    """Compute the signed volume of each tetrahedron [m^3], shape (T,)."""
    a, b, c, d = (vertices[tets[:, k]] for k in range(4))
    return np.sum(np.cross(b - a, c - a) * (d - a), axis=1) / 6.0


def check_tets(vertices: np.ndarray, tets: np.ndarray) -> None:
    """Check that a mesh of tetrahedra of positive volume can be simulated.

    Raises:
        MeshError: Naming the first offending index and the count.
    """
    topology.check_arrays(vertices, tets, "tets", 4)
    # Relative to a regular one of the same longest edge, so that slivers are refused as well.
    ends = vertices[tets[:, _EDGES]]
    longest = np.linalg.norm(ends[:, :, 0] - ends[:, :, 1], axis=2).max(axis=1)
    bad = np.flatnonzero(compute_volumes(vertices, tets) < 1e-4 * longest**3)
    if len(bad):
        raise MeshError(
            f"{len(bad)} tetrahedra are inverted or flat, the first is {bad[0]}; "
            "volumes (b - a) x (c - a) . (d - a) / 6 must be positive"
        )
    unused = np.setdiff1d(np.arange(len(vertices)), tets)
    if len(unused):
        raise MeshError(
            f"{len(unused)} vertices belong to no tetrahedron, the first is {unused[0]}"
        )


def compute_edges(tets: np.ndarray) -> np.ndarray:
    """Compute the unique edges of a tetrahedral mesh, shape (E, 2), int32, sorted."""
    return np.unique(np.sort(tets[:, _EDGES].reshape(-1, 2), axis=1), axis=0).astype(np.int32)


def compute_surface(tets: np.ndarray) -> np.ndarray:
    """Compute the triangles that belong to one tetrahedron only.

    Returns:
        Vertex indices, counter-clockwise seen from outside, shape (F, 3), int32.
    """
    faces = tets[:, _FACES].reshape(-1, 3)
    _, first, counts = np.unique(
        np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True
    )
    return faces[np.sort(first[counts == 1])].astype(np.int32)


def check_orientation(faces: np.ndarray) -> bool:
    """Check that neighbouring triangles turn the same way; returns True for a closed mesh.

    Raises:
        MeshError: If an edge is passed twice in the same direction.
    """
    directed = topology.list_sides(faces)
    pairs, counts = np.unique(directed, axis=0, return_counts=True)
    bad = np.flatnonzero(counts > 1)
    if len(bad):
        raise MeshError(
            f"{len(bad)} edges are passed twice in the same direction, the first is "
            f"{tuple(pairs[bad[0]].tolist())}; neighbouring triangles must be wound the same way"
        )
    return len(topology.compute_hinges(faces)) * 2 == len(directed)


def extrude_shell(
    vertices: np.ndarray, faces: np.ndarray, thickness: float
) -> tuple[np.ndarray, np.ndarray]:
    """Make a wall of tetrahedra behind a surface.

    Each triangle becomes a prism between the surface and its inner copy, and each prism three
    tetrahedra whose diagonals start at the lower vertex index, so neighbours agree.

    Returns:
        Vertices, shape (2 V, 3), the outer side first, and tetrahedra, shape (3 F, 4), int32.

    Raises:
        MeshError: If the wall is too thick for the curvature of the surface.
    """
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    area = np.cross(b - a, c - a)
    normals = np.zeros_like(vertices)
    for k in range(3):
        np.add.at(normals, faces[:, k], area)
    length = np.linalg.norm(normals, axis=1)
    bad = np.flatnonzero(length < 1e-12)
    if len(bad):
        raise MeshError(f"{len(bad)} vertices have no normal, the first is {bad[0]}")
    normals /= length[:, None]
    # A face keeps its distance to the inner copy where the surface is bent: divide by the cosine.
    unit = area / np.linalg.norm(area, axis=1, keepdims=True)
    cosine, count = np.zeros(len(vertices)), np.bincount(faces.ravel(), minlength=len(vertices))
    for k in range(3):
        np.add.at(cosine, faces[:, k], np.sum(unit * normals[faces[:, k]], axis=1))
    inner = vertices - normals * (thickness / np.maximum(cosine / count, 0.5))[:, None]
    order = np.argsort(faces, axis=1)
    i, j, k = np.take_along_axis(faces, order, axis=1).T
    n = len(vertices)
    tets = np.stack(
        [
            np.column_stack([i, j, k, k + n]),
            np.column_stack([i, j, j + n, k + n]),
            np.column_stack([i, i + n, j + n, k + n]),
        ],
        axis=1,
    )
    # Sorting turns half of the triangles around; the first two vertices undo it. Inside is
    # behind the face, so an even one has (i, j, k, k') of negative volume.
    is_even = (order[:, 1] - order[:, 0]) % 3 == 1
    swap = np.stack([is_even, ~is_even, is_even], axis=1)
    tets[swap] = tets[swap][:, [1, 0, 2, 3]]
    both = np.concatenate([vertices, inner])
    tets = tets.reshape(-1, 4)
    bad = np.unique(np.flatnonzero(compute_volumes(both, tets) <= 0) // 3)
    if len(bad):
        raise MeshError(
            f"a wall of {thickness} m folds over itself behind {len(bad)} triangles, the first is "
            f"{bad[0]}; it must be thinner than the radius of curvature"
        )
    return both, tets.astype(np.int32)
