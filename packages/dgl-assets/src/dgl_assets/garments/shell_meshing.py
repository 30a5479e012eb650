"""Even triangles on a curved surface that is shaped like a disk: the crown of a cap, a whole hat.

The surface is given by its meridians, from the pole outward. Triangles are Delaunay in a plane onto
which the surface is mapped with (nearly) the same angles; lengths are measured on the surface. The
vertices of fixed rings and seams lie exactly on them, joined by edges.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.spatial import Delaunay, KDTree

from dgl_assets.errors import MeshingError
from dgl_assets.garments.meshing import compute_edges

_ROUNDS = 14
_REFINING_ROUNDS = (2, 4, 6, 8)
_SHORTEST, _LONGEST = 0.78, 1.36  # of the spacing; edges beyond are refined
_STIFFNESS = 1.0  # 0: smoothing is to the mean of the neighbours, 1: of springs of length `spacing`
_CLEARANCE = 0.72  # of the spacing, between fixed and first free points
_ROWS = 96  # samples of a meridian, per part
_INNERMOST = 1e-3  # row parameter below which the plane's radius is proportional to it


class DiskSurface:
    """A surface swept by meridians from a common pole.

    A point is (row, angle): the row counts the parts of the meridians (crown 0 to 1, brim 1 to 2,
    ...) and is proportional to arc length within each; the angle [rad] is counter-clockwise from
    above, 0 at the front (-y).
    """

    def __init__(self, parts: Sequence[np.ndarray]) -> None:
        """Take the meridians of each part.

        Args:
            parts: Points [m], each of shape (M, J, 3): M along the meridian, outward, of J
                meridians at even angles from 0. A part begins at the end of the one before; all
                meridians of the first begin at one point.
        """
        rows = [_resample_rows(part) for part in parts]
        grid = np.concatenate([rows[0], *(part[1:] for part in rows[1:])])
        self.part_count = len(parts)
        self._grid = np.concatenate([grid, grid[:, :1]], axis=1)  # closed, (R, J + 1, 3)
        self._log_radius = self._compute_log_radius()

    def evaluate(self, row: np.ndarray, angle: np.ndarray) -> np.ndarray:
        """Compute positions [m], shape (N, 3), of rows and angles, each of shape (N,)."""
        i = np.clip(np.asarray(row, dtype=np.float64) * _ROWS, 0, len(self._grid) - 1)
        j = np.asarray(angle, dtype=np.float64) / (2 * np.pi) % 1.0 * (self._grid.shape[1] - 1)
        i0 = np.minimum(i.astype(int), len(self._grid) - 2)
        j0 = np.minimum(j.astype(int), self._grid.shape[1] - 2)
        a, b = (i - i0)[:, None], (j - j0)[:, None]
        g = self._grid
        near = (1 - b) * g[i0, j0] + b * g[i0, j0 + 1]
        far = (1 - b) * g[i0 + 1, j0] + b * g[i0 + 1, j0 + 1]
        return (1 - a) * near + a * far

    def to_plane(self, row: np.ndarray, angle: np.ndarray) -> np.ndarray:
        """Map rows and angles to the plane of equal angles, the unit disk, shape (N, 2)."""
        row = np.asarray(row, dtype=np.float64)
        angle = np.asarray(angle, dtype=np.float64)
        inner = np.exp(self._log_radius[0]) * row / _INNERMOST
        samples = self._sample_rows()
        radius = np.exp(np.interp(row, samples, self._log_radius))
        radius = np.where(row < _INNERMOST, inner, radius)
        return radius[:, None] * np.column_stack([np.sin(angle), -np.cos(angle)])

    def from_plane(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Map points of the plane, shape (N, 2), to rows and angles, each of shape (N,)."""
        radius = np.linalg.norm(points, axis=1)
        samples = self._sample_rows()
        with np.errstate(divide="ignore"):
            row = np.interp(np.log(radius), self._log_radius, samples)
        inner = radius * np.exp(-self._log_radius[0]) * _INNERMOST
        row = np.where(radius < np.exp(self._log_radius[0]), inner, row)
        return row, np.arctan2(points[:, 0], -points[:, 1])

    def _sample_rows(self) -> np.ndarray:
        rows = np.linspace(0.0, self.part_count, len(self._log_radius))
        rows[0] = _INNERMOST
        return rows

    def _compute_log_radius(self) -> np.ndarray:
        """Log of the plane's radius at `_sample_rows`: d ln(radius) = d arc / (girth / 2 pi)."""
        count = 8 * (len(self._grid) - 1) + 1
        rows = np.linspace(0.0, self.part_count, count)
        rows[0] = _INNERMOST
        angles = np.arange(72) * (2 * np.pi / 72)
        points = np.stack([self.evaluate(np.full(72, row), angles) for row in rows])
        girth = np.linalg.norm(np.roll(points, -1, axis=1) - points, axis=2).sum(axis=1)
        steps = np.linalg.norm(np.diff(points, axis=0), axis=2).mean(axis=1)
        # Exact where the girth grows linearly, as it does from 0 at the pole.
        ratio = girth[1:] / girth[:-1]
        mean = np.where(
            np.abs(ratio - 1) < 1e-6,
            girth[:-1],
            (girth[1:] - girth[:-1]) / np.log(np.where(ratio == 1, 2.0, ratio)),
        )
        increments = 2 * np.pi * steps / mean
        return np.concatenate([[0.0], np.cumsum(increments)]) - increments.sum()


@dataclass(frozen=True, kw_only=True)
class DiskMesh:
    """Triangles of a disk surface."""

    rows: np.ndarray
    """Row of each vertex, shape (V,)."""
    angles: np.ndarray
    """Angle of each vertex [rad], in (-pi, pi], shape (V,)."""
    faces: np.ndarray
    """Triangles, shape (F, 3), int32; from outside, angles grow counter-clockwise."""
    rim: np.ndarray
    """Vertex ids of the outermost ring, from `marks[0]` on, by growing angle."""
    pins: tuple[int, ...]
    """Vertex ids of the pins, in their order."""


def mesh_disk(
    surface: DiskSurface,
    *,
    spacing: float,
    marks: Sequence[float],
    seams: Sequence[float] = (),
    rings: Sequence[float] = (),
    pins: Sequence[tuple[float, float]] = (),
) -> DiskMesh:
    """Fill a disk surface with triangles of even size.

    Args:
        surface: The surface.
        spacing: Target edge length [m].
        marks: Angles [rad] at which every ring, fixed or outermost, gets a vertex; seams too.
        seams: Angles [rad] of meridians that become rows of edges.
        rings: Rows inside that become rings of edges.
        pins: Points (row, angle) that become vertices.

    Returns:
        The mesh. Its vertices: the pole if there are seams, fixed points, pins, the rest.

    Raises:
        MeshingError: If a ring or seam is lost, or a vertex unused.
    """
    fixed, segments, rim = _place_fixed(surface, spacing, marks, seams, rings)
    count = len(fixed)
    fixed = np.concatenate([fixed, np.array(pins, dtype=np.float64).reshape(-1, 2)])
    free = _place_free(surface, spacing, rings)
    positions = surface.evaluate(*free.T)
    clear = KDTree(surface.evaluate(*fixed.T)).query(positions)[0] > _CLEARANCE * spacing
    places = np.concatenate([fixed, free[clear]])
    points = surface.to_plane(*places.T)
    for round_index in range(_ROUNDS):
        triangles = _triangulate(points)
        if round_index in _REFINING_ROUNDS:
            points = _refine(surface, points, triangles, spacing=spacing, fixed=len(fixed))
            triangles = _triangulate(points)
        points = _smooth(surface, points, triangles, spacing=spacing, fixed=len(fixed))
    points = _clear_segments(surface, points, segments, fixed=len(fixed))
    triangles = _triangulate(points)
    edges = {(int(a), int(b)) for a, b in compute_edges(triangles)[0]}
    lost = [pair for pair in segments if pair not in edges]
    unused = len(points) - len(np.unique(triangles))
    if lost or unused:
        raise MeshingError(
            f"a disk of {len(segments)} fixed edges cannot be filled at spacing {spacing} m: "
            f"{len(lost)} are lost, {unused} vertices unused"
        )
    rows, angles = surface.from_plane(points)
    rows[: len(fixed)], angles[: len(fixed)] = fixed.T  # exactly, not through the plane
    angles = (angles + np.pi) % (2 * np.pi) - np.pi
    pin_ids = tuple(range(count, count + len(pins)))
    return DiskMesh(
        rows=rows, angles=angles, faces=triangles.astype(np.int32), rim=rim, pins=pin_ids
    )


def _place_fixed(
    surface: DiskSurface,
    spacing: float,
    marks: Sequence[float],
    seams: Sequence[float],
    rings: Sequence[float],
) -> tuple[np.ndarray, list[tuple[int, int]], np.ndarray]:
    """Place fixed points: (row, angle), shape (N, 2), pairs that must be edges, ids of the rim."""
    places: list[tuple[float, float]] = [(0.0, 0.0)] if len(seams) else []
    segments: list[tuple[int, int]] = []
    corners = sorted({*np.mod(marks, 2 * np.pi), *np.mod(seams, 2 * np.pi)})
    levels = [*rings, float(surface.part_count)]
    at: dict[tuple[int, float], int] = {}  # (level, angle) of corners
    ids = np.zeros(0, dtype=np.int32)
    for level, row in enumerate(levels):
        first = len(places)
        for start, end in zip(corners, [*corners[1:], corners[0] + 2 * np.pi], strict=True):
            at[level, start] = len(places)
            angles = np.linspace(start, end, 200)
            targets = _divide(surface.evaluate(np.full(200, row), angles), angles, spacing)
            places.extend((row, angle) for angle in targets[:-1])
        ids = np.arange(first, len(places))
        segments += list(zip(ids.tolist(), np.roll(ids, -1).tolist(), strict=True))
    for seam in np.mod(seams, 2 * np.pi):
        last, start = 0, 0.0
        for level, row in enumerate(levels):
            samples = np.linspace(start, row, 200)
            targets = _divide(surface.evaluate(samples, np.full(200, seam)), samples, spacing)
            for target in targets[1:-1]:
                segments.append((last, len(places)))
                last = len(places)
                places.append((target, float(seam)))
            segments.append((last, at[level, seam]))
            last, start = at[level, seam], row
    ordered = [(min(pair), max(pair)) for pair in segments]
    return np.array(places), ordered, ids.astype(np.int32)


def _divide(points: np.ndarray, parameter: np.ndarray, spacing: float) -> np.ndarray:
    """Parameters that divide a sampled curve evenly, both ends included."""
    arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    count = max(1, round(arc[-1] / spacing))
    return np.interp(np.linspace(0.0, arc[-1], count + 1), arc, parameter)


def _place_free(surface: DiskSurface, spacing: float, rings: Sequence[float]) -> np.ndarray:
    """Staggered rings of points, shape (N, 2), between the fixed rings."""
    angles = np.arange(72) * (2 * np.pi / 72)
    places = [np.zeros((1, 2))]
    levels = [0.0, *rings, float(surface.part_count)]
    for start, end in pairwise(levels):
        samples = np.linspace(start, end, 100)
        points = np.stack([surface.evaluate(np.full(72, row), angles) for row in samples])
        arc = np.linalg.norm(np.diff(points, axis=0), axis=2).mean(axis=1).sum()
        count = max(1, round(arc / (spacing * np.sqrt(0.75))))
        for k in range(1, count):
            row = start + (end - start) * k / count
            ring = surface.evaluate(np.full(72, row), angles)
            girth = np.linalg.norm(np.roll(ring, -1, axis=0) - ring, axis=1).sum()
            number = max(6 if start == 0 else 3, round(girth / spacing))
            turn = 2 * np.pi * (np.arange(number) + 0.5 * (k % 2)) / number
            places.append(np.column_stack([np.full(number, row), turn]))
    return np.concatenate(places)


def _triangulate(points: np.ndarray) -> np.ndarray:
    triangles = Delaunay(points).simplices
    first = points[triangles[:, 1]] - points[triangles[:, 0]]
    second = points[triangles[:, 2]] - points[triangles[:, 0]]
    area = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]
    return np.where((area < 0)[:, None], triangles[:, ::-1], triangles)


def _refine(
    surface: DiskSurface, points: np.ndarray, triangles: np.ndarray, *, spacing: float, fixed: int
) -> np.ndarray:
    """Drop free points that are too close to another, and split edges that are too long."""
    edges, _ = compute_edges(triangles)
    positions = surface.evaluate(*surface.from_plane(points))
    lengths = np.linalg.norm(positions[edges[:, 1]] - positions[edges[:, 0]], axis=1)
    is_free = edges[:, 1] >= fixed  # the second end has the larger index
    dropped: set[int] = set()
    for k in np.flatnonzero((lengths < _SHORTEST * spacing) & is_free):
        if not dropped & set(edges[k].tolist()):
            dropped.add(int(edges[k, 1]))
    gone = np.array(sorted(dropped), dtype=int)
    long = (lengths > _LONGEST * spacing) & is_free & ~np.isin(edges, gone).any(axis=1)
    order = np.flatnonzero(long)[np.argsort(-lengths[long], kind="stable")]
    added: list[np.ndarray] = []
    taken: list[np.ndarray] = []
    for k in order:  # one of several long edges around a gap is enough
        middle = positions[edges[k]].mean(axis=0)
        if all(np.linalg.norm(middle - other) > spacing for other in taken):
            taken.append(middle)
            added.append(points[edges[k]].mean(axis=0))
    return np.concatenate([np.delete(points, gone, axis=0), np.array(added).reshape(-1, 2)])


def _smooth(
    surface: DiskSurface, points: np.ndarray, triangles: np.ndarray, *, spacing: float, fixed: int
) -> np.ndarray:
    """Move free points on the surface to `spacing` from their neighbours."""
    positions = surface.evaluate(*surface.from_plane(points))
    start, end = triangles.ravel(), triangles[:, [1, 2, 0]].ravel()
    along = points[end] - points[start]
    length = np.linalg.norm(positions[end] - positions[start], axis=1)
    scale = length / np.linalg.norm(along, axis=1)
    pull = along * (scale * (1 - _STIFFNESS * spacing / length))[:, None]
    total = np.stack(
        [np.bincount(start, pull[:, k], minlength=len(points)) for k in range(2)], axis=1
    )
    weight = np.bincount(start, scale, minlength=len(points))
    result = points.copy()
    result[fixed:] += total[fixed:] / weight[fixed:, None]
    return result


def _clear_segments(
    surface: DiskSurface, points: np.ndarray, segments: list[tuple[int, int]], *, fixed: int
) -> np.ndarray:
    """Drop free points so close to the middle of a fixed edge that it would be lost."""
    positions = surface.evaluate(*surface.from_plane(points))
    ends = positions[np.array(segments)]
    half = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) / 2
    distance, nearest = KDTree(ends.mean(axis=1)).query(positions)
    is_near = distance < 1.15 * half[nearest]
    is_near[:fixed] = False
    return points[~is_near]


def _resample_rows(part: np.ndarray) -> np.ndarray:
    """Points evenly along each meridian, shape (_ROWS + 1, J, 3)."""
    steps = np.linalg.norm(np.diff(part, axis=0), axis=2)
    result = np.empty((_ROWS + 1, part.shape[1], 3))
    for j in range(part.shape[1]):
        arc = np.concatenate([[0.0], np.cumsum(steps[:, j])])
        targets = np.linspace(0.0, arc[-1], _ROWS + 1)
        for k in range(3):
            result[:, j, k] = np.interp(targets, arc, part[:, j, k])
    result[-1] = part[-1]
    return result
