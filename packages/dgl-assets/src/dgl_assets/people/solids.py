"""Solids that a body is blended from, by their distance.

Distances are negative inside. Those of ellipsoids and lofts are approximate, right near their surfaces.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, kw_only=True, eq=False)
class Cone:
    """A capsule whose radius changes linearly.

    Attributes:
        bone: Joint whose bone it moves with.
        start: First end [m], shape (3,).
        end: Second end [m], shape (3,).
        radii: Radius at either end [m].
        flatness: Share by which it is thinner along `thin`.
        thin: Unit direction in which it is thin, shape (3,).
    """

    bone: str
    start: np.ndarray
    end: np.ndarray
    radii: tuple[float, float]
    flatness: float = 0.0
    thin: np.ndarray | None = None

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Corners of a box around it [m], each of shape (3,)."""
        radius = max(self.radii)
        return np.minimum(self.start, self.end) - radius, np.maximum(self.start, self.end) + radius

    def distance(self, points: np.ndarray) -> np.ndarray:
        """Distances of points [m], shape (..., 3), from its surface [m]."""
        along = self.end - self.start
        offset = points - self.start
        share = np.clip(offset @ along / max(float(along @ along), 1e-12), 0.0, 1.0)
        away = offset - share[..., None] * along
        if self.thin is not None and self.flatness > 0:
            part = away @ self.thin
            away = away + (part * self.flatness / (1 - self.flatness))[..., None] * self.thin
        radius = self.radii[0] + (self.radii[1] - self.radii[0]) * share
        return np.linalg.norm(away, axis=-1) - radius


@dataclass(frozen=True, kw_only=True, eq=False)
class Ellipsoid:
    """An ellipsoid with axes along those of the person.

    Attributes:
        bone: Joint whose bone it moves with.
        centre: [m], shape (3,).
        radii: Half axes [m], shape (3,).
    """

    bone: str
    centre: np.ndarray
    radii: np.ndarray

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Corners of a box around it [m], each of shape (3,)."""
        return self.centre - self.radii, self.centre + self.radii

    def distance(self, points: np.ndarray) -> np.ndarray:
        """Distances of points [m], shape (..., 3), from its surface [m]."""
        scaled = (points - self.centre) / self.radii
        first = np.linalg.norm(scaled, axis=-1)
        second = np.linalg.norm(scaled / self.radii, axis=-1)
        return first * (first - 1) / np.maximum(second, 1e-9)


@dataclass(frozen=True, kw_only=True, eq=False)
class Loft:
    """Superellipses stacked along z.

    Attributes:
        bones: Joints whose bones it moves with, from below.
        borders: Heights between their parts [m], one fewer.
        heights: Of the sections [m], increasing, shape (S,).
        half_widths: Along x [m], shape (S,).
        half_depths: Along y [m], shape (S,).
        centres: y of the sections' centres [m], shape (S,).
        exponent: 2 is an ellipse; larger is squarer.
    """

    bones: tuple[str, ...]
    borders: tuple[float, ...]
    heights: np.ndarray
    half_widths: np.ndarray
    half_depths: np.ndarray
    centres: np.ndarray
    exponent: float = 2.3

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Corners of a box around it [m], each of shape (3,)."""
        width = self.half_widths.max()
        low = [-width, (self.centres - self.half_depths).min(), self.heights[0]]
        high = [width, (self.centres + self.half_depths).max(), self.heights[-1]]
        return np.array(low), np.array(high)

    def distance(self, points: np.ndarray) -> np.ndarray:
        """Distances of points [m], shape (..., 3), from its surface [m]."""
        z = np.clip(points[..., 2], self.heights[0], self.heights[-1])
        a = np.interp(z, self.heights, self.half_widths)
        b = np.interp(z, self.heights, self.half_depths)
        x = np.abs(points[..., 0]) / a
        y = np.abs(points[..., 1] - np.interp(z, self.heights, self.centres)) / b
        n = self.exponent
        level = np.maximum((x**n + y**n) ** (1 / n), 1e-6)
        slope = ((x ** (n - 1) / a) ** 2 + (y ** (n - 1) / b) ** 2) ** 0.5 / level ** (n - 1)
        across = (level - 1) / np.maximum(slope, 1e-6)
        beyond = np.abs(points[..., 2] - z)
        return np.where(beyond > 0, np.hypot(np.maximum(across, 0), beyond), across)


Solid = Cone | Ellipsoid | Loft


@dataclass(frozen=True, kw_only=True, eq=False)
class Blend:
    """Solids joined with rounded transitions.

    Attributes:
        parts: In the order in which they are joined.
        radius: How far from a joint the transition reaches [m].
    """

    parts: tuple[Solid | Blend, ...]
    radius: float

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Corners of a box around it [m], each of shape (3,)."""
        low, high = zip(*(part.bounds() for part in self.parts), strict=True)
        return np.min(low, axis=0), np.max(high, axis=0)

    def list_solids(self) -> list[Solid]:
        """All solids, of blends within too."""
        found: list[Solid] = []
        for part in self.parts:
            found += part.list_solids() if isinstance(part, Blend) else [part]
        return found


def blend(first: np.ndarray, second: np.ndarray, radius: float) -> np.ndarray:
    """Join two distance fields with a rounded transition (a quadratic smooth minimum)."""
    near = np.maximum(radius - np.abs(first - second), 0.0) / radius
    return np.minimum(first, second) - near**2 * radius / 4
