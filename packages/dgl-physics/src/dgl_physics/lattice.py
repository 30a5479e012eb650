"""Tetrahedral lattices that fill closed surfaces, and the surface that they carry."""

from dataclasses import dataclass
from itertools import permutations

import numpy as np

from dgl_physics.errors import MeshError
from dgl_physics.tetrahedra import compute_surface, compute_volumes

# Six tetrahedra of a cube, along the six orders in which one can walk its axes (Kuhn). Neighbours
# agree on their faces because all cubes are cut alike.
_CORNERS = np.array([[k >> 2 & 1, k >> 1 & 1, k & 1] for k in range(8)])


def _make_kuhn() -> np.ndarray:
    tets = []
    for axes in permutations(range(3)):
        at, walk = 0, [0]
        for axis in axes:
            at |= 4 >> axis
            walk.append(at)
        tets.append(walk)
    tets = np.array(tets)
    swap = compute_volumes(_CORNERS.astype(float), tets) < 0
    tets[swap] = tets[swap][:, [1, 0, 2, 3]]
    return tets


_KUHN = _make_kuhn()


@dataclass(frozen=True, kw_only=True)
class Skin:
    """A surface that is carried by tetrahedra."""

    faces: np.ndarray
    """Triangles of the surface, shape (F, 3), int32."""
    particles: np.ndarray
    """The four particles that carry each vertex, shape (S, 4), int32."""
    weights: np.ndarray
    """Their barycentric weights, which sum to 1, shape (S, 4)."""

    def compute_vertices(self, positions: np.ndarray) -> np.ndarray:
        """Compute the vertices [m], shape (S, 3), from particle positions, shape (V, 3)."""
        return np.einsum("sk,skc->sc", self.weights, positions[self.particles])


def fill_closed_surface(
    vertices: np.ndarray, faces: np.ndarray, resolution: int
) -> tuple[np.ndarray, np.ndarray, Skin]:
    """Fill a closed surface with cubes, and move their outside onto the surface.

    Args:
        vertices: Positions [m], shape (V, 3).
        faces: Closed, counter-clockwise seen from outside, shape (F, 3).
        resolution: Cubes along the longest side of the bounding box.

    Returns:
        Lattice points [m], shape (P, 3), tetrahedra, shape (T, 4), int32, and the surface as
        their skin.

    Raises:
        MeshError: If the surface faces inwards, or no cube fits in.
    """
    if resolution < 1:
        raise ValueError(f"resolution must be >= 1; got {resolution}")
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    volume = np.sum(a * np.cross(b, c)) / 6.0
    if volume <= 0:
        raise MeshError(
            f"the closed surface faces inwards (volume {volume:.3g} m^3); reverse its triangles"
        )
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    cell = float((high - low).max()) / resolution
    shape = np.maximum(np.ceil((high - low) / cell - 1e-6).astype(int), 1)
    origin = 0.5 * (low + high) - 0.5 * cell * shape
    cubes = np.stack(np.meshgrid(*map(np.arange, shape), indexing="ij"), axis=-1).reshape(-1, 3)
    cubes = cubes[is_inside(origin + cell * (cubes + 0.5), vertices, faces)]
    if not len(cubes):
        raise MeshError(
            f"no cube of {cell:.3g} m fits into the closed surface; raise resolution ({resolution})"
        )
    corners = cubes[:, None] + _CORNERS  # (N, 8, 3)
    grid, index = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
    tets = index.reshape(-1, 8)[:, _KUHN].reshape(-1, 4).astype(np.int32)
    points = origin + cell * grid
    outer = np.unique(compute_surface(tets))
    points = _fit(points, tets, outer, _find_closest(points[outer], vertices, faces))
    return points, tets, _make_skin(vertices, faces, points, tets)


def is_inside(points: np.ndarray, vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Test points by the winding number of a closed surface.

    Args:
        points: [m], shape (N, 3).
        vertices: [m], shape (V, 3).
        faces: Counter-clockwise seen from outside, shape (F, 3).

    Returns:
        Shape (N,), bool.

    Source:
        van Oosterom and Strackee 1983, "The solid angle of a plane triangle".
    """
    solid_angle = np.zeros(len(points))
    for part in _chunks(len(points), len(faces)):
        a, b, c = (vertices[faces[:, k]] - points[part, None] for k in range(3))
        x, y, z = (np.linalg.norm(v, axis=2) for v in (a, b, c))
        above = np.einsum("pfk,pfk->pf", a, np.cross(b, c))
        below = x * y * z
        for u, v, w in ((a, b, z), (b, c, x), (c, a, y)):
            below += np.einsum("pfk,pfk->pf", u, v) * w
        solid_angle[part] = 2.0 * np.arctan2(above, below).sum(axis=1)
    return solid_angle > 2.0 * np.pi


def _chunks(count: int, width: int) -> list[slice]:
    size = max(1, 500_000 // width)
    return [slice(first, first + size) for first in range(0, count, size)]


def _find_closest(points: np.ndarray, vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Find the closest points on the surface, shape (P, 3)."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    squared = np.sum(normal * normal, axis=1)
    closest = np.empty_like(points)
    for part in _chunks(len(points), len(faces)):
        p = points[part, None]
        best = p - normal * (np.sum((p - a) * normal, axis=2) / squared)[..., None]
        outside = np.zeros(best.shape[:2], dtype=bool)
        for u, v in ((a, b), (b, c), (c, a)):
            outside |= np.sum(np.cross(v - u, best - u) * normal, axis=2) < 0
        distance = np.where(outside, np.inf, np.sum((best - p) ** 2, axis=2))
        for u, v in ((a, b), (b, c), (c, a)):
            along = np.sum((p - u) * (v - u), axis=2) / np.sum((v - u) ** 2, axis=1)
            on = u + (v - u) * np.clip(along, 0.0, 1.0)[..., None]
            d = np.sum((on - p) ** 2, axis=2)
            is_nearer = d < distance
            best[is_nearer], distance[is_nearer] = on[is_nearer], d[is_nearer]
        closest[part] = best[np.arange(len(best)), distance.argmin(axis=1)]
    return closest


def _fit(
    points: np.ndarray, tets: np.ndarray, outer: np.ndarray, targets: np.ndarray
) -> np.ndarray:
    """Move outer points towards their targets, as far as no tetrahedron becomes flat."""
    smallest = 0.15 * compute_volumes(points, tets)
    share = np.zeros(len(points))
    share[outer] = 1.0
    target = points.copy()
    target[outer] = targets
    tries = 0
    while True:
        moved = points + share[:, None] * (target - points)
        bad = compute_volumes(moved, tets) < smallest
        if not bad.any():
            return moved
        # a little less each time, and finally not at all, which ends the loop
        share[np.unique(tets[bad])] *= 0.7 if tries < 12 else 0.0
        tries += 1


def _make_skin(
    vertices: np.ndarray, faces: np.ndarray, points: np.ndarray, tets: np.ndarray
) -> Skin:
    """Attach each vertex to the tetrahedron that contains it, or nearly does."""
    middle = points[tets].mean(axis=1)
    near = min(16, len(tets))
    chosen, weights = [], []
    for part in _chunks(len(vertices), len(tets)):
        v = vertices[part]
        d = -2.0 * v @ middle.T + np.sum(middle * middle, axis=1)
        candidates = np.argpartition(d, near - 1, axis=1)[:, :near]
        corner = points[tets[candidates]]  # (P, 16, 4, 3)
        edges = (corner[:, :, 1:] - corner[:, :, :1]).transpose(0, 1, 3, 2)
        rest = np.linalg.solve(edges, (v[:, None] - corner[:, :, 0])[..., None])[..., 0]
        all_four = np.concatenate([1.0 - rest.sum(axis=2, keepdims=True), rest], axis=2)
        best = all_four.min(axis=2).argmax(axis=1)
        rows = np.arange(len(v))
        chosen.append(tets[candidates[rows, best]])
        weights.append(all_four[rows, best])
    return Skin(
        faces=faces.astype(np.int32),
        particles=np.concatenate(chosen),
        weights=np.concatenate(weights),
    )
