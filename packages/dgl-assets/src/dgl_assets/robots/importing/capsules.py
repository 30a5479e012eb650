"""Capsules around triangles: the smallest found, divided where one would be mostly empty.

Every capsule contains all that it stands for, so the capsules of a link contain the whole link.
"""

from dataclasses import dataclass
from math import pi

import numpy as np
from scipy.optimize import minimize
from scipy.spatial import ConvexHull, QhullError

GAIN = 0.85
"""A capsule is divided where the two halves together have less than this share of its volume."""
MIN_HALF_LENGTH = 1e-4
MIN_RADIUS = 5e-4
"""Least thickness; thinner parts get it [m]."""


@dataclass(frozen=True, kw_only=True)
class Capsule:
    """All points within `radius` of a segment."""

    centre: np.ndarray
    """Middle of the segment [m], shape (3,)."""
    axis: np.ndarray
    """Unit direction, shape (3,)."""
    radius: float
    """Radius [m]."""
    half_length: float
    """Half length of the segment [m]."""

    @property
    def volume(self) -> float:
        """Volume [m^3]."""
        return pi * self.radius**2 * (2 * self.half_length + 4 / 3 * self.radius)

    def measure_distance(self, points: np.ndarray) -> np.ndarray:
        """Signed distance of points to the surface [m], shape (N,); negative inside."""
        offset = points - self.centre
        along = np.clip(offset @ self.axis, -self.half_length, self.half_length)
        return np.linalg.norm(offset - along[:, None] * self.axis, axis=1) - self.radius


def fit_capsules(vertices: np.ndarray, faces: np.ndarray, *, most: int = 4) -> list[Capsule]:
    """Fit capsules that together contain a surface.

    Args:
        vertices: Positions [m], shape (V, 3).
        faces: Triangles, shape (F, 3).
        most: Largest number of capsules.

    Returns:
        At least one capsule, the longest pieces first.
    """
    triangles = np.asarray(vertices, dtype=float)[faces]
    pieces = [(triangles, fit_capsule(triangles.reshape(-1, 3)))]
    is_final = [False]
    while len(pieces) < most and not all(is_final):
        worst = max(
            (k for k in range(len(pieces)) if not is_final[k]), key=lambda k: pieces[k][1].volume
        )
        halves = _divide(*pieces[worst])
        if halves is None:
            is_final[worst] = True
            continue
        pieces[worst : worst + 1] = halves
        is_final[worst : worst + 1] = [False, False]
    return sorted((capsule for _, capsule in pieces), key=lambda c: -c.volume)


def fit_capsule(points: np.ndarray) -> Capsule:
    """Fit the smallest capsule around points, as a descent over directions finds it.

    Args:
        points: Positions [m], shape (N, 3), N >= 1.
    """
    points = _take_hull(np.unique(points, axis=0))
    directions = _find_directions(points)
    found = [_descend(points, np.roll(directions, -k, axis=0)) for k in range(3)]
    return min(found, key=lambda capsule: capsule.volume)


def _find_directions(points: np.ndarray) -> np.ndarray:
    """Principal directions, the longest first, shape (3, 3), one a row."""
    offset = points - points.mean(axis=0)
    return np.linalg.eigh(offset.T @ offset)[1].T[::-1]


def _descend(points: np.ndarray, directions: np.ndarray) -> Capsule:
    """Find the smallest capsule near the first direction, tilting it towards the other two."""

    def make(tilt: np.ndarray) -> Capsule:
        axis = directions[0] + tilt[0] * directions[1] + tilt[1] * directions[2]
        return _wrap(points, axis / np.linalg.norm(axis))

    scale = make(np.zeros(2)).volume
    simplex = np.array([[0.0, 0.0], [0.15, 0.0], [0.0, 0.15]])
    found = minimize(
        lambda tilt: make(tilt).volume / scale,
        np.zeros(2),
        method="Nelder-Mead",
        options={"initial_simplex": simplex, "maxfev": 60, "xatol": 1e-3, "fatol": 1e-4},
    )
    return make(found.x)


def _wrap(points: np.ndarray, axis: np.ndarray) -> Capsule:
    """Make the capsule of a direction: the narrowest round tube, then the shortest caps."""
    u = np.cross(axis, np.eye(3)[np.abs(axis).argmin()])
    u /= np.linalg.norm(u)
    v = np.cross(axis, u)
    centre, radius = enclosing_circle(np.column_stack([points @ u, points @ v]))
    radius = max(radius * (1 + 1e-9), MIN_RADIUS)
    across = points - np.outer(points @ axis, axis) - (centre[0] * u + centre[1] * v)
    reach = np.sqrt(np.maximum(radius**2 - (across**2).sum(axis=1), 0.0))
    along = points @ axis
    # each point lies under a cap as soon as the segment ends no further than `reach` before it
    high, low = float((along - reach).max()), float((along + reach).min())
    if low > high:  # one ball would do; where it sits does not matter
        low = high = (low + high) / 2
    return Capsule(
        centre=(low + high) / 2 * axis + centre[0] * u + centre[1] * v,
        axis=axis,
        radius=radius,
        half_length=max((high - low) / 2, MIN_HALF_LENGTH),
    )


def enclosing_circle(points: np.ndarray) -> tuple[np.ndarray, float]:
    """Find the smallest circle around points in the plane.

    Args:
        points: Positions, shape (N, 2).

    Returns:
        Centre, shape (2,), and radius.

    Source:
        Welzl, "Smallest enclosing disks (balls and ellipsoids)", 1991, as the loop over points that
        lie outside of the circle so far.
    """
    points = np.asarray(points, dtype=float)
    points = points[np.random.default_rng(0).permutation(len(points))]
    centre, radius = points[0], 0.0
    i = j = k = 0
    while (i := _find_outside(points, i, centre, radius)) < len(points):
        centre, radius, j = points[i], 0.0, 0
        while (j := _find_outside(points[:i], j, centre, radius)) < i:
            centre, k = (points[i] + points[j]) / 2, 0
            radius = float(np.linalg.norm(points[i] - points[j])) / 2
            while (k := _find_outside(points[:j], k, centre, radius)) < j:
                centre, radius = _through(points[i], points[j], points[k])
    return centre, float(np.linalg.norm(points - centre, axis=1).max())


def _find_outside(points: np.ndarray, start: int, centre: np.ndarray, radius: float) -> int:
    """Find the first point from `start` on outside of a circle; the number of points if none."""
    offset = points[start:] - centre
    is_outside = np.hypot(offset[:, 0], offset[:, 1]) > radius * (1 + 1e-9) + 1e-12
    return start + int(is_outside.argmax()) if is_outside.any() else len(points)


def _through(p: np.ndarray, q: np.ndarray, r: np.ndarray) -> tuple[np.ndarray, float]:
    """Circle through three points; of three in a line, that of the two furthest apart."""
    a, b = q - p, r - p
    d = 2 * (a[0] * b[1] - a[1] * b[0])
    if abs(d) < 1e-18:
        pairs = ((p, q), (p, r), (q, r))
        s, t = max(pairs, key=lambda pair: float(np.linalg.norm(pair[0] - pair[1])))
        return (s + t) / 2, float(np.linalg.norm(s - t)) / 2
    aa, bb = a @ a, b @ b
    offset = np.array([b[1] * aa - a[1] * bb, a[0] * bb - b[0] * aa]) / d
    return p + offset, float(np.linalg.norm(offset))


def _divide(triangles: np.ndarray, capsule: Capsule) -> list[tuple[np.ndarray, Capsule]] | None:
    """Cut a surface where two capsules are smallest, if that is worth it."""
    points = triangles.reshape(-1, 3)
    best: list[np.ndarray] | None = None
    least = np.inf
    for direction in _find_directions(points)[:2]:
        along = points @ direction
        low, high = along.min(), along.max()
        for share in (0.3, 0.5, 0.7):
            level = low + share * (high - low)
            below = clip_triangles(triangles, direction, level)
            above = clip_triangles(triangles, -direction, -level)
            if not len(below) or not len(above):
                continue
            volume = sum(_estimate(part.reshape(-1, 3)) for part in (below, above))
            if volume < least:
                best, least = [below, above], volume
    if best is None:
        return None
    halves = [(part, fit_capsule(part.reshape(-1, 3))) for part in best]
    return halves if sum(half.volume for _, half in halves) < GAIN * capsule.volume else None


def _estimate(points: np.ndarray) -> float:
    """Volume of the smallest capsule along a principal direction [m^3]."""
    points = _take_hull(np.unique(points, axis=0))
    return min(_wrap(points, direction).volume for direction in _find_directions(points))


def clip_triangles(triangles: np.ndarray, normal: np.ndarray, level: float) -> np.ndarray:
    """Keep the part of triangles, (F, 3, 3), with position . normal <= level, (G, 3, 3)."""
    height = triangles @ normal - level
    is_kept = (height <= 0).all(axis=1)
    kept = [triangles[is_kept]]
    for corners, h in zip(
        triangles[~is_kept & (height < 0).any(axis=1)],
        height[~is_kept & (height < 0).any(axis=1)],
        strict=True,
    ):
        outline = []
        for k in range(3):
            a, b, ha, hb = corners[k], corners[(k + 1) % 3], h[k], h[(k + 1) % 3]
            if ha <= 0:
                outline.append(a)
            if ha * hb < 0:
                outline.append(a + (b - a) * ha / (ha - hb))
        kept.append(
            np.array([[outline[0], outline[k], outline[k + 1]] for k in range(1, len(outline) - 1)])
        )
    return np.concatenate([part.reshape(-1, 3, 3) for part in kept])


def _take_hull(points: np.ndarray) -> np.ndarray:
    """Keep the corners of the convex hull; all points where they are flat."""
    if len(points) < 5:
        return points
    try:
        return points[ConvexHull(points).vertices]
    except QhullError:
        return points
