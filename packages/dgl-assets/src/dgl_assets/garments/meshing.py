"""Fill a planar outline with even triangles, and measure meshes.

The outline is given as evenly spaced points, so that two panels that share a seam share its
vertices. The inside starts as a hexagonal lattice; rounds of Delaunay triangulation and smoothing
fit it to the outline.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import Delaunay, KDTree

from dgl_assets.errors import MeshingError

_SMOOTHING_ROUNDS = 10
_REFINING_ROUNDS = (2, 4, 6)
_SHORTEST, _LONGEST = 0.66, 1.36  # of the spacing; edges beyond are refined
_CLEARANCE = 0.62  # of the spacing, between the outline and the first lattice points
_PIN_CLEARANCE = 0.72  # of the spacing, between a pinned point and the lattice points


def resample_polyline(points: np.ndarray, count: int) -> np.ndarray:
    """Place points evenly along a polyline.

    Args:
        points: Corners [m], shape (N, 2), N >= 2.
        count: Number of segments of the result, at least 1.

    Returns:
        Points [m], shape (count + 1, 2); the first and last are those of the polyline, exactly.
    """
    lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
    arc = np.concatenate([[0.0], np.cumsum(lengths)])
    targets = np.linspace(0.0, arc[-1], count + 1)
    result = np.stack([np.interp(targets, arc, points[:, k]) for k in range(2)], axis=1)
    result[0], result[-1] = points[0], points[-1]
    return result


def contains_points(outline: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Find the points inside a closed outline (even-odd rule).

    Args:
        outline: Corners in order [m], shape (B, 2).
        points: Queries [m], shape (N, 2).

    Returns:
        Mask, shape (N,), bool. Points exactly on the outline may be either.
    """
    start, end = outline, np.roll(outline, -1, axis=0)
    x, y = points[:, :1], points[:, 1:]
    straddles = (start[:, 1] > y) != (end[:, 1] > y)
    rise = np.where(end[:, 1] == start[:, 1], 1.0, end[:, 1] - start[:, 1])
    crossing = start[:, 0] + (y - start[:, 1]) * (end[:, 0] - start[:, 0]) / rise
    return np.count_nonzero(straddles & (x < crossing), axis=1) % 2 == 1


def mesh_outline(
    outline: np.ndarray, *, spacing: float, pins: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Fill a simple outline with triangles of even size.

    Args:
        outline: Boundary vertices, counter-clockwise, about `spacing` apart [m], shape (B, 2).
        spacing: Target edge length [m].
        pins: Points inside that must become vertices [m], shape (K, 2).

    Returns:
        Vertices [m], shape (V, 2), float64: the outline first, then the pins, then the rest; and
        triangles, counter-clockwise, shape (F, 3), int32. Every outline segment is an edge of
        exactly one triangle.

    Raises:
        MeshingError: If a pin lies outside, or a segment of an outline too thin for the spacing is
            lost.

    Limitations:
        Corners sharper than about 30 degrees give triangles as sharp.
    """
    pins = np.empty((0, 2)) if pins is None else np.asarray(pins, dtype=np.float64)
    if len(pins) and not contains_points(outline, pins).all():
        outside = np.flatnonzero(~contains_points(outline, pins)).tolist()
        raise MeshingError(f"pins must lie inside the outline; pins {outside} do not")
    points = np.concatenate([outline, pins, _lattice(outline, pins, spacing)])
    fixed_count, boundary_count = len(outline) + len(pins), len(outline)
    for round_index in range(_SMOOTHING_ROUNDS):
        triangles = _triangulate(outline, points)
        if round_index in _REFINING_ROUNDS:
            points = _refine(points, triangles, spacing=spacing, fixed_count=fixed_count)
            triangles = _triangulate(outline, points)
        points = _smooth(points, triangles, fixed_count=fixed_count)
    triangles = _triangulate(outline, points)
    used = np.zeros(len(points), dtype=bool)
    used[triangles] = True
    missing = _missing_segments(boundary_count, triangles)
    if len(missing) or not used.all():
        raise MeshingError(
            f"an outline of {boundary_count} segments cannot be filled at spacing {spacing} m: "
            f"{len(missing)} segments are lost, {np.count_nonzero(~used)} vertices unused"
        )
    return points, triangles.astype(np.int32)


def compute_edges(faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """List the undirected edges of a triangle mesh and the number of faces at each.

    Args:
        faces: Triangles, shape (F, 3), int.

    Returns:
        Edges with the smaller index first, shape (E, 2), and face counts, shape (E,).
    """
    half_edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    stride = int(half_edges.max(initial=0)) + 1
    keys = half_edges.min(axis=1).astype(np.int64) * stride + half_edges.max(axis=1)
    keys, counts = np.unique(keys, return_counts=True)
    return np.column_stack(np.divmod(keys, stride)).astype(faces.dtype), counts


def compute_boundary_loops(faces: np.ndarray) -> list[np.ndarray]:
    """Follow the open edges of an oriented manifold mesh.

    Args:
        faces: Consistently oriented triangles, shape (F, 3), int.

    Returns:
        One array of vertex ids per loop, in the direction of its faces, longest loop first.

    Raises:
        ValueError: If two open edges leave the same vertex, so that loops are not defined.
    """
    half_edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    present = {(int(a), int(b)) for a, b in half_edges}
    open_edges = [(a, b) for a, b in present if (b, a) not in present]
    following = dict(open_edges)
    if len(following) != len(open_edges):
        raise ValueError(
            f"expected one open edge to leave each boundary vertex; got {len(open_edges)} open "
            f"edges at {len(following)} vertices"
        )
    loops = []
    while following:
        start, vertex = following.popitem()
        loop = [start]
        while vertex != start:
            loop.append(vertex)
            vertex = following.pop(vertex)
        loops.append(np.array(loop, dtype=np.int32))
    return sorted(loops, key=lambda loop: (-len(loop), int(loop.min())))


def compute_smallest_angles(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Compute the smallest angle of each triangle.

    Args:
        vertices: Positions [m], shape (V, 2) or (V, 3).
        faces: Triangles, shape (F, 3), int.

    Returns:
        Angles [rad], shape (F,).
    """
    corners = vertices[faces].astype(np.float64)
    cosines = []
    for k in range(3):
        first = corners[:, (k + 1) % 3] - corners[:, k]
        second = corners[:, (k + 2) % 3] - corners[:, k]
        norms = np.linalg.norm(first, axis=1) * np.linalg.norm(second, axis=1)
        cosines.append((first * second).sum(axis=1) / norms)
    return np.arccos(np.clip(np.max(cosines, axis=0), -1.0, 1.0))


def compute_segment_distances(points: np.ndarray, start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Compute the distance of each point from the nearest of some segments.

    Args:
        points: Queries [m], shape (N, 2).
        start: First ends [m], shape (S, 2).
        end: Second ends [m], shape (S, 2).

    Returns:
        Distances [m], shape (N,).
    """
    along = end - start
    offset = points[:, None] - start[None]
    share = (offset * along).sum(axis=2) / np.maximum((along**2).sum(axis=1), 1e-18)
    nearest = np.clip(share, 0.0, 1.0)[..., None] * along
    return np.sqrt(((offset - nearest) ** 2).sum(axis=2).min(axis=1))


def _lattice(outline: np.ndarray, pins: np.ndarray, spacing: float) -> np.ndarray:
    low, high = outline.min(axis=0), outline.max(axis=0)
    rows = np.arange(low[1], high[1] + spacing, spacing * np.sqrt(0.75))
    columns = np.arange(low[0] - spacing, high[0] + spacing, spacing)
    x, y = np.meshgrid(columns, rows)
    x[1::2] += spacing / 2
    points = np.stack([x.ravel(), y.ravel()], axis=1)
    points = points[contains_points(outline, points)]
    distances = compute_segment_distances(points, outline, np.roll(outline, -1, axis=0))
    points = points[distances > _CLEARANCE * spacing]
    if len(pins) and len(points):
        points = points[KDTree(pins).query(points)[0] > _PIN_CLEARANCE * spacing]
    return points


def _triangulate(outline: np.ndarray, points: np.ndarray) -> np.ndarray:
    triangles = Delaunay(points).simplices
    # Only triangles between outline points can lie outside, or be flat along a straight outline.
    spanning = np.flatnonzero((triangles < len(outline)).all(axis=1))
    first, second = _span(points, triangles[spanning])
    scale = np.abs(first).sum(axis=1) * np.abs(second).sum(axis=1)
    inside = contains_points(outline, points[triangles[spanning]].mean(axis=1))
    is_cloth = np.ones(len(triangles), dtype=bool)
    is_cloth[spanning] = inside & (np.abs(_cross(first, second)) > 1e-6 * scale)
    triangles = triangles[is_cloth]
    is_clockwise = _cross(*_span(points, triangles)) < 0
    return np.where(is_clockwise[:, None], triangles[:, ::-1], triangles)


def _refine(
    points: np.ndarray, triangles: np.ndarray, *, spacing: float, fixed_count: int
) -> np.ndarray:
    """Drop free points that are too close to another, and split edges that are too long."""
    edges, _ = compute_edges(triangles)
    ends = points[edges]
    lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    # The second end has the larger index, so it is the free one if any is.
    crowded = np.unique(edges[(lengths < _SHORTEST * spacing) & (edges[:, 1] >= fixed_count), 1])
    long = (lengths > _LONGEST * spacing) & ~np.isin(edges, crowded).any(axis=1)
    long &= edges[:, 1] >= fixed_count
    middles = ends[long].mean(axis=1)[np.argsort(-lengths[long], kind="stable")]
    added: list[np.ndarray] = []
    for middle in middles:  # one of several long edges around a gap is enough
        if all(np.linalg.norm(middle - other) > spacing for other in added):
            added.append(middle)
    kept = np.delete(points, crowded, axis=0)
    return np.concatenate([kept, np.array(added).reshape(-1, 2)])


def _smooth(points: np.ndarray, triangles: np.ndarray, *, fixed_count: int) -> np.ndarray:
    """Move each free point to the mean of its neighbours."""
    # An edge inside the panel is seen from both of its triangles, once in each direction.
    start = triangles.ravel()
    end = triangles[:, [1, 2, 0]].ravel()
    count = np.bincount(start, minlength=len(points))
    total = [np.bincount(start, points[end, k], minlength=len(points)) for k in range(2)]
    moved = np.arange(len(points)) >= fixed_count
    moved &= count > 0
    result = points.copy()
    result[moved] = np.stack(total, axis=1)[moved] / count[moved, None]
    return result


def _span(points: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    corners = points[triangles]
    return corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]


def _cross(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    return first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]


def _missing_segments(boundary_count: int, triangles: np.ndarray) -> np.ndarray:
    half_edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    keys = half_edges[:, 0].astype(np.int64) * (triangles.max() + 1) + half_edges[:, 1]
    start = np.arange(boundary_count, dtype=np.int64)
    wanted = start * (triangles.max() + 1) + (start + 1) % boundary_count
    return start[~np.isin(wanted, keys)]


def compute_vertex_normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Compute unit normals of vertices, the mean over their triangles by area, shape (V, 3)."""
    corners = vertices[faces]
    area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = np.zeros_like(vertices)
    np.add.at(normals, faces.ravel(), np.repeat(area, 3, axis=0))
    return normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-15)
