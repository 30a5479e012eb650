"""The visor of a cap: a crescent, bent across like a sheet."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from dgl_assets.garments.hats.cap_parameters import CapParameters
from dgl_assets.garments.meshing import mesh_outline, resample_polyline

PHI_END = 4 * np.pi / 9
"""Canonical angle of the ends of the visor [rad]."""

_GRID = (241, 41)  # starts of the inversion of the map
_NEWTON_STEPS = 6
_CANONICAL_WIDTH = 0.9
_CANONICAL_POWER = 2.2


@dataclass(frozen=True, kw_only=True)
class VisorMesh:
    """Triangles of a visor, unrolled."""

    points: np.ndarray
    """Positions [m], shape (V, 2), those of the inner edge first, left to right."""
    faces: np.ndarray
    """Triangles, counter-clockwise from above, shape (F, 3)."""
    pins: tuple[int, ...]
    """Vertex ids of the pins."""
    tip: int
    """Vertex id in the middle of the outer edge."""


class Visor:
    """A visor that is sewn to the edge of a crown.

    It is drawn unrolled across: x is arc length along its bend, so that distances are kept except
    where the visor also falls forward.
    """

    def __init__(self, parameters: CapParameters, inner: np.ndarray, angles: np.ndarray) -> None:
        """Sew a visor to an edge.

        Args:
            parameters: Measures.
            inner: Edge of the crown from the left to the right end of the visor [m], shape (N, 3).
            angles: Canonical angles of these points [rad], -`PHI_END` to `PHI_END`, shape (N,).
        """
        self._p = parameters
        self._shares = angles / PHI_END  # of half of the width
        self._end = float(inner[-1, 0])  # half of the width between the ends
        reach = np.linspace(-1.6 * self._end, 1.6 * self._end, 801)
        steps = np.sqrt(1 + self._compute_bend(reach)[1] ** 2)
        arc = np.concatenate([[0.0], np.cumsum((steps[1:] + steps[:-1]) / 2 * np.diff(reach))])
        self._x, self._arc = reach, arc - arc[400]
        flat_x = np.interp(inner[:, 0], self._x, self._arc)
        self._flat_inner = np.column_stack([flat_x, inner[:, 1]])

    def make_mesh(self, *, spacing: float, pins: tuple[tuple[float, float], ...]) -> VisorMesh:
        """Fill it with triangles.

        Args:
            spacing: Target edge length [m].
            pins: Points that become vertices: share of the half width, share of the way to the
                edge.

        Raises:
            MeshingError: If it cannot be filled at this spacing.
        """
        samples = np.linspace(-1, 1, 401)
        outer = self._place(samples, np.ones(401))
        length = np.linalg.norm(np.diff(outer, axis=0), axis=1).sum()
        count = 2 * max(2, round(length / spacing / 2))  # even, so that the tip is a vertex
        outer = resample_polyline(outer, count)
        # Counter-clockwise from above: the outer edge left to right, back along the inner one.
        outline = np.concatenate([self._flat_inner[::-1], outer[1:-1]])
        flat_pins = self._place(*np.array(pins).T)
        points, triangles = mesh_outline(outline, spacing=spacing, pins=flat_pins)
        inner_count = len(self._flat_inner)
        order = np.arange(len(points))
        order[:inner_count] = order[:inner_count][::-1]
        return VisorMesh(
            points=points[order],
            faces=order[triangles],
            pins=tuple(range(len(outline), len(outline) + len(pins))),
            tip=inner_count + count // 2 - 1,
        )

    def lift(self, points: np.ndarray) -> np.ndarray:
        """Bend flat points, shape (N, 2), into place [m], shape (N, 3), frame of the crown."""
        x = np.interp(points[:, 0], self._arc, self._x)
        inner_y = np.interp(points[:, 0], *self._flat_inner.T)
        forward = inner_y - points[:, 1]
        height, _ = self._compute_bend(x)
        fall = np.tan(self._p.visor_pitch) * np.maximum(forward, 0.0)
        return np.column_stack([x, points[:, 1], height - fall])

    def to_polar(self, points: np.ndarray) -> np.ndarray:
        """Canonical distance and angle of flat points, shape (N, 2)."""
        share, way = self._find_places(points)
        crescent = _CANONICAL_WIDTH * (1 - np.abs(share) ** _CANONICAL_POWER)
        return np.column_stack([1 + way * crescent, share * PHI_END])

    def _place(self, share: np.ndarray, way: np.ndarray) -> np.ndarray:
        """Flat points, shape (N, 2), at shares of the half width and of the way to the edge."""
        edge = self._flat_inner
        start = np.column_stack([np.interp(share, self._shares, edge[:, k]) for k in range(2)])
        turn = self._p.visor_splay * share
        along = np.column_stack([np.sin(turn), -np.cos(turn)])
        return start + (way * self._compute_depth(share))[:, None] * along

    def _find_places(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Invert `_place` on points, shape (N, 2): linear within a fine grid."""
        shares = np.linspace(-1, 1, _GRID[0])
        share, way = (grid.ravel() for grid in np.meshgrid(shares, np.linspace(0, 1, _GRID[1])))
        nearest = KDTree(self._place(share, way)).query(points)[1]
        share, way = share[nearest], way[nearest]
        h = 1e-4
        for _ in range(_NEWTON_STEPS):
            here = self._place(share, way)
            by_share = (self._place(share + h, way) - self._place(share - h, way)) / (2 * h)
            by_way = (self._place(share, way + h) - self._place(share, way - h)) / (2 * h)
            area = by_share[:, 0] * by_way[:, 1] - by_share[:, 1] * by_way[:, 0]
            area = np.where(np.abs(area) < 1e-7, -1e-7, area)  # at the ends, where all ways are one
            x, y = (points - here).T
            step_share = (x * by_way[:, 1] - y * by_way[:, 0]) / area
            step_way = (by_share[:, 0] * y - by_share[:, 1] * x) / area
            share = np.clip(share + np.clip(step_share, -0.05, 0.05), -1, 1)
            way = np.clip(way + np.clip(step_way, -0.1, 0.1), 0, 1)
        return share, way

    def _compute_bend(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Height [m] and slope across: a parabola between the ends, straight outside."""
        share = np.abs(x) / self._end
        height = np.where(share < 1, 1 - share**2, 2 - 2 * share)
        slope = -2 * np.sign(x) * np.minimum(share, 1.0) / self._end
        return self._p.front_rise * height, self._p.front_rise * slope

    def _compute_depth(self, share: np.ndarray) -> np.ndarray:
        """Inner to outer edge [m]."""
        rest = np.clip(1 - np.abs(share) ** self._p.visor_squareness, 0.0, 1.0)
        return self._p.visor_length * rest**0.8
