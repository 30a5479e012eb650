"""Signed distances of the solids that a body is blended from.

Distances are negative inside. Those of ellipsoids and lofts are approximate away from the surface.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class Cone:
    """A capsule whose radius changes linearly."""

    bone: str
    """Joint whose bone it moves with."""
    start: np.ndarray
    """First end [m], shape (3,)."""
    end: np.ndarray
    """Second end [m], shape (3,)."""
    radii: tuple[float, float]
    """Radius at either end [m]."""
    flatness: float = 0.0
    """Share by which it is thinner along `thin`."""
    thin: np.ndarray | None = None
    """Unit direction in which it is thin, shape (3,)."""

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Corners of the bounding box [m], each of shape (3,)."""
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


@dataclass(frozen=True, eq=False)
class Ellipsoid:
    """An ellipsoid with axes along those of the person."""

    bone: str
    """Joint whose bone it moves with."""
    centre: np.ndarray
    """[m], shape (3,)."""
    radii: np.ndarray
    """Half axes [m], shape (3,)."""

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Corners of the bounding box [m], each of shape (3,)."""
        return self.centre - self.radii, self.centre + self.radii

    def distance(self, points: np.ndarray) -> np.ndarray:
        """Distances of points [m], shape (..., 3), from its surface [m]."""
        scaled = (points - self.centre) / self.radii
        first = np.linalg.norm(scaled, axis=-1)
        second = np.linalg.norm(scaled / self.radii, axis=-1)
        return first * (first - 1) / np.maximum(second, 1e-9)


@dataclass(frozen=True, kw_only=True, eq=False)
class Loft:
    """Superellipses stacked along z."""

    bones: tuple[str, ...]
    """Joints whose bones it moves with, from below."""
    borders: tuple[float, ...]
    """Heights between the bones' parts [m], one fewer than bones."""
    heights: np.ndarray
    """Heights of the sections [m], increasing, shape (S,)."""
    half_widths: np.ndarray
    """Along x [m], shape (S,)."""
    half_depths: np.ndarray
    """Along y [m], shape (S,)."""
    centres: np.ndarray
    """y of the sections' centres [m], shape (S,)."""
    exponent: float
    """2 is an ellipse; larger is squarer."""

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Corners of the bounding box [m], each of shape (3,)."""
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


@dataclass(frozen=True, eq=False)
class Blend:
    """Solids joined with rounded transitions."""

    radius: float
    """Reach of a transition from the joint of two parts [m]."""
    parts: Sequence[Solid | Blend]
    """In the order in which they are joined."""

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Corners of the bounding box [m], each of shape (3,)."""
        low, high = zip(*(part.bounds() for part in self.parts), strict=True)
        return np.min(low, axis=0), np.max(high, axis=0)

    def list_solids(self) -> list[Solid]:
        """List all solids, nested blends included."""
        found: list[Solid] = []
        for part in self.parts:
            found += part.list_solids() if isinstance(part, Blend) else [part]
        return found


def chain(
    bones: Sequence[str], points: Sequence[np.ndarray], radii: Sequence[float], radius: float
) -> Blend:
    """Join one cone a bone along a line of points, with the radius [m] at each point."""
    cones = [
        Cone(bone, points[k], points[k + 1], (radii[k], radii[k + 1]))
        for k, bone in enumerate(bones)
    ]
    return Blend(radius, cones)


def blend(first: np.ndarray, second: np.ndarray, radius: float) -> np.ndarray:
    """Join two distance fields with a rounded transition (a quadratic smooth minimum)."""
    near = np.maximum(radius - np.abs(first - second), 0.0) / radius
    return np.minimum(first, second) - near**2 * radius / 4
