"""Sag and length of a garment that hangs between two hands, from its cloud."""

from dataclasses import dataclass

import numpy as np

MIDDLE = 0.3
"""Part of the span around its middle in which the upper edge is measured."""
_LOWEST = 0.005
# quantile of the heights that counts as the lower end: a few stray points do not


@dataclass(frozen=True, kw_only=True)
class Hanging:
    """A garment held by two hands."""

    sag: float
    """Depth of its upper edge midway between the hands [m]; infinite if nothing is seen there."""
    length: float
    """Length below the hands [m]."""


def measure_hanging(points: np.ndarray, left: np.ndarray, right: np.ndarray) -> Hanging:
    """Measure sag and length of a hanging garment.

    Args:
        points: Visible points of the garment [m], shape (N, 3), N at least 1, world frame.
        left: Grasp point of the left hand [m], shape (3,).
        right: The same of the right hand.

    Raises:
        ValueError: If the shapes are other ones, or both hands are at one place.
    """
    points, left, right = (np.asarray(a, dtype=float) for a in (points, left, right))
    if points.ndim != 2 or points.shape[1] != 3 or len(points) == 0:
        raise ValueError(f"points must have shape (N, 3) with N of 1 or more; got {points.shape}")
    if left.shape != (3,) or right.shape != (3,):
        raise ValueError(f"hands must have shape (3,); got {left.shape} and {right.shape}")
    along = (right - left)[:2]
    span = float(np.linalg.norm(along))
    if span < 1e-6:
        raise ValueError("the hands must be apart; got the same place for both")
    height = (left[2] + right[2]) / 2
    at = (points[:, :2] - (left + right)[:2] / 2) @ along / span
    middle = points[np.abs(at) < MIDDLE * span / 2, 2]
    return Hanging(
        sag=float(height - middle.max()) if len(middle) else np.inf,
        length=float(height - np.quantile(points[:, 2], _LOWEST)),
    )
