"""Convex hull of points in space."""

import numpy as np

from dgl_physics import topology
from dgl_physics.errors import MeshError

_JOGGLE = 1e-5
"""Random shift of the points over their extent: no four lie in a plane, so the hull is closed."""
_FLAT = 1e-4
"""Thickness over size below which points count as flat."""


def compute_hull(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Compute the convex hull, true to 1e-5 of the extent.

    It starts with a tetrahedron and adds the point farthest outside of a face: the faces that see
    it are replaced by a fan over their rim.

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
    faces = _make_tetrahedron(points)
    extent = np.ptp(points, axis=0).max()
    jitter = np.random.default_rng(0).uniform(-1.0, 1.0, points.shape)
    points = points + _JOGGLE * extent * jitter
    tolerance = 1e-12 * extent  # of rounding
    planes = _compute_planes(points, faces)
    left = np.arange(len(points))  # points that a face sees: the face, and their height over it
    owner, height = _assign(points, planes, tolerance)
    while len(left := left[owner >= 0]):
        owner, height = owner[owner >= 0], height[owner >= 0]
        apex = left[np.argmax(height)]
        visible = planes @ np.append(points[apex], -1.0) > tolerance
        rim = _find_rim(faces[visible])
        fan = np.column_stack([rim, np.full(len(rim), apex, dtype=np.int32)])
        fan_planes = _compute_planes(points, fan)
        kept = np.count_nonzero(~visible)
        # a point that saw a removed face sees a face of the fan, or is inside
        orphans = visible[owner]
        owner = (np.cumsum(~visible) - 1)[owner]
        adopted, height[orphans] = _assign(points[left[orphans]], fan_planes, tolerance)
        owner[orphans] = np.where(adopted >= 0, adopted + kept, -1)
        faces = np.concatenate([faces[~visible], fan])
        planes = np.concatenate([planes[~visible], fan_planes])
    used, index = np.unique(faces, return_inverse=True)
    return points[used], index.reshape(faces.shape).astype(np.int32)


def _make_tetrahedron(points: np.ndarray) -> np.ndarray:
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
    if not np.abs(height[d]) > _FLAT * np.linalg.norm(arms[b]):
        raise MeshError("points of a hull must span a volume; they lie in a plane")
    if height[d] > 0:
        b, c = c, b
    return np.array([[a, b, c], [a, d, b], [b, d, c], [c, d, a]], dtype=np.int32)


def _compute_planes(points: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Compute unit normals and offsets of the faces' planes, shape (F, 4)."""
    a, b, c = (points[faces[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    normals = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    return np.column_stack([normals, np.sum(normals * a, axis=1)])


def _assign(
    points: np.ndarray, planes: np.ndarray, tolerance: float
) -> tuple[np.ndarray, np.ndarray]:
    """Find the plane that each point is highest above, -1 for none, and its height."""
    height = points @ planes[:, :3].T - planes[:, 3]  # (N, F)
    owner = np.argmax(height, axis=1)
    height = height[np.arange(len(points)), owner]
    return np.where(height > tolerance, owner, -1), height


def _find_rim(faces: np.ndarray) -> np.ndarray:
    """Find the directed edges of triangles whose other side is not among them, shape (E, 2)."""
    edges = topology.list_sides(faces).astype(np.int64)
    most = int(edges.max()) + 1
    is_inner = np.isin(edges[:, 0] * most + edges[:, 1], edges[:, 1] * most + edges[:, 0])
    return edges[~is_inner]
