"""Convex hull of points in space."""

import numpy as np

from dgl_physics.errors import MeshError

_TOLERANCE = 1e-6
"""Relative to the size of the points: what is nearer to a plane lies in it."""


def compute_hull(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Compute the convex hull.

    From a tetrahedron on, the point that is farthest outside of a face is added: the faces that
    see it give way to a fan over their rim.

    Args:
        points: Shape (N, 3).

    Returns:
        Its vertices, shape (V, 3), and its triangles, shape (F, 3), int32, counter-clockwise
        seen from outside.

    Raises:
        MeshError: If the points do not span a volume.

    Source:
        C. Barber, D. Dobkin, H. Huhdanpaa: The Quickhull Algorithm for Convex Hulls, 1996.
    """
    points = np.asarray(points, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != 3:
        raise MeshError(f"points must have shape (N, 3); got {points.shape}")
    if not np.isfinite(points).all():
        raise MeshError("points must be finite")
    points = np.unique(points, axis=0)
    tolerance = _TOLERANCE * np.ptp(points, axis=0).max(initial=0.0)
    faces = _make_tetrahedron(points, tolerance)
    normals, offsets = _compute_planes(points, faces)
    # every point is looked at once more than it is added, so this ends
    for _ in range(len(points)):
        height = points @ normals.T - offsets  # (N, F)
        apex = int(np.argmax(height.max(axis=1)))
        visible = height[apex] > tolerance
        if not visible.any():
            break
        rim = _find_rim(faces[visible])
        fan = np.column_stack([rim, np.full(len(rim), apex, dtype=np.int32)])
        fan_normals, fan_offsets = _compute_planes(points, fan)
        faces = np.concatenate([faces[~visible], fan])
        normals = np.concatenate([normals[~visible], fan_normals])
        offsets = np.concatenate([offsets[~visible], fan_offsets])
    used, index = np.unique(faces, return_inverse=True)
    return points[used], index.reshape(faces.shape).astype(np.int32)


def _make_tetrahedron(points: np.ndarray, tolerance: float) -> np.ndarray:
    """Choose four points that are far apart; their faces, shape (4, 3)."""
    if len(points) < 4:
        raise MeshError(f"a hull needs 4 different points; got {len(points)}")
    a = int(np.argmin(points[:, 0]))
    arms = points - points[a]
    b = int(np.argmax(np.linalg.norm(arms, axis=1)))
    axis = arms[b] / np.linalg.norm(arms[b])
    c = int(np.argmax(np.linalg.norm(arms - np.outer(arms @ axis, axis), axis=1)))
    normal = np.cross(axis, arms[c])
    height = arms @ (normal / max(float(np.linalg.norm(normal)), 1e-300))
    d = int(np.argmax(np.abs(height)))
    if not np.abs(height[d]) > 10 * tolerance:
        raise MeshError("points of a hull must span a volume; they lie in a plane")
    if height[d] > 0:
        b, c = c, b
    return np.array([[a, b, c], [a, d, b], [b, d, c], [c, d, a]], dtype=np.int32)


def _compute_planes(points: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    a, b, c = (points[faces[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    normals = normals / np.maximum(length, 1e-300)
    return normals, np.sum(normals * a, axis=1)


def _find_rim(faces: np.ndarray) -> np.ndarray:
    """Directed edges of some triangles whose other side is not among them, shape (E, 2)."""
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    known = {(int(i), int(j)) for i, j in edges}
    return np.array([e for e in edges if (int(e[1]), int(e[0])) not in known], dtype=np.int32)
