"""Give a flat pattern of two layers its round cross-section, keeping lengths.

Along the outline a strip of both layers is bent around a quarter of an ellipse, so that the two
meet at the seam without a fold. A strip as wide as half a finger makes fingers elliptical tubes.
"""

from __future__ import annotations

import numpy as np

_SAMPLES = 400
_ON_EDGE = 2e-4  # seams lie on chords of the curve, on either side of those of the outline [m]
_CORNER = 4e-4  # reach of the edge around a corner whose normals are averaged [m]


class GloveRelief:
    """The cross-section of a sewn pattern: a bent strip along its outline, and a rise inside."""

    def __init__(
        self,
        outline: np.ndarray,
        *,
        strip: float,
        puff: float,
        rise: float,
        rise_width: float,
    ) -> None:
        """Shape it.

        Args:
            outline: Sewn edge, the pattern to its left, densely sampled [m], shape (M, 2).
            strip: Width of the strip in the pattern [m].
            puff: Height over run of the bent strip.
            rise: Height of the inside above the strip [m].
            rise_width: Distance over which it rises [m].
        """
        turn = np.linspace(0, np.pi / 2, _SAMPLES)
        run, height = 1 - np.cos(turn), puff * np.sin(turn)
        arc = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(run), np.diff(height)))])
        scale = strip / arc[-1]
        self._outline = outline
        self._strip, self._rise, self._rise_width = strip, rise, rise_width
        self._arc, self._run, self._height = arc * scale, run * scale, height * scale

    def lift(self, points: np.ndarray) -> np.ndarray:
        """Lift points of the pattern [m], shape (N, 2), to the upper layer [m], shape (N, 3)."""
        distance, inward = compute_inward(points, self._outline)
        arc = np.minimum(distance, self._strip)
        bent = arc - np.interp(arc, self._arc, self._run)
        flat = points + (self._strip - self._run[-1] - bent)[:, None] * inward
        share = np.clip((distance - self._strip) / self._rise_width, 0.0, 1.0)
        rise = self._rise * share**2 * (3 - 2 * share)
        return np.column_stack([flat, np.interp(distance, self._arc, self._height) + rise])


def compute_inward(points: np.ndarray, outline: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Compute distance from an outline and the direction away from it.

    Args:
        points: Points on or to the left of the outline [m], shape (N, 2).
        outline: Polyline, densely sampled [m], shape (M, 2).

    Returns:
        Distances [m], shape (N,), and unit directions away from the nearest place, shape (N, 2); on
        the outline its normal to the left.
    """
    start, along = outline[:-1], np.diff(outline, axis=0)
    length = (along**2).sum(axis=1)
    start, along, length = (part[length > 1e-14] for part in (start, along, length))
    # Columns apart: sums over a last axis of two are the slow part of this.
    x, y = (points[:, None, k] - start[:, k] for k in range(2))
    share = np.clip((x * along[:, 0] + y * along[:, 1]) / length, 0.0, 1.0)
    x -= share * along[:, 0]
    y -= share * along[:, 1]
    distances = np.sqrt(x * x + y * y)
    nearest = np.argmin(distances, axis=1)
    rows = np.arange(len(points))
    distance = distances[rows, nearest]
    away = np.column_stack([x[rows, nearest], y[rows, nearest]])
    on_edge = distance < _ON_EDGE
    normals = np.column_stack([-along[:, 1], along[:, 0]]) / np.sqrt(length)[:, None]
    # At a corner, the mean around it.
    away[on_edge] = (distances[on_edge] < _CORNER).astype(np.float64) @ normals
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    return np.where(on_edge, 0.0, distance), away
