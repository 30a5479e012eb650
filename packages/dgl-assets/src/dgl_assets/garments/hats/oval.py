"""The oval of a head, as hats see it from above."""

from __future__ import annotations

import numpy as np

_EXPONENT = 2.15  # a little fuller than an ellipse, as heads and hat blocks are


def compute_oval(
    girth: float, ratio: float, angle: np.ndarray, *, exponent: float = _EXPONENT
) -> np.ndarray:
    """Compute the distance of an oval from its centre.

    Args:
        girth: Length around it [m].
        ratio: Length over width.
        angle: Angles from the front, counter-clockwise from above [rad], shape (N,).
        exponent: 2 is an ellipse; larger is squarer.

    Returns:
        Radii [m], shape (N,).
    """
    turn = np.arange(720) * (2 * np.pi / 720)
    shape = _compute_unit(ratio, turn, exponent)
    points = shape[:, None] * np.column_stack([np.sin(turn), -np.cos(turn)])
    length = np.linalg.norm(np.roll(points, -1, axis=0) - points, axis=1).sum()
    return _compute_unit(ratio, angle, exponent) * (girth / length)


def _compute_unit(ratio: float, angle: np.ndarray, exponent: float) -> np.ndarray:
    """Radii of an oval of half width 1 and half length `ratio`."""
    across, along = np.abs(np.sin(angle)), np.abs(np.cos(angle)) / ratio
    return (across**exponent + along**exponent) ** (-1 / exponent)
