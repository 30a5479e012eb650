"""Heads as hats see them: an oval from above, and random sizes."""

from __future__ import annotations

import numpy as np

from dgl_assets.garments.sizes import SCALE

_EXPONENT = 2.15  # a little fuller than an ellipse, as heads and hat blocks are
_GIRTHS = (0.50, 0.53, 0.55, 0.57, 0.59, 0.61, 0.63)  # children to XXL, life size [m]
_GIRTH_SHARES = (0.08, 0.10, 0.17, 0.26, 0.22, 0.12, 0.05)


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


def draw_head(rng: np.random.Generator) -> tuple[float, float]:
    """Draw a girth at `SCALE` [m], and the factor of the hat's other lengths, which grow less."""
    girth = rng.choice(_GIRTHS, p=_GIRTH_SHARES) + rng.normal(0, 0.004)
    return float(SCALE * girth), SCALE * float((girth / 0.57) ** 0.6)
