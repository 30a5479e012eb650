"""Hands that hold a garment, from known points of it."""

from collections.abc import Iterable

import numpy as np

from dgl_assets.robots import Side
from dgl_tasks.sensing import Sensed

HELD_DISTANCE = 0.12
"""A hand holds the garment while a raised point is this near its grasp point [m]."""
HELD_HEIGHT = 0.05
"""Height over the ground from which cloth counts as raised [m]."""


def is_low(sensed: Sensed, side: Side) -> bool:
    """Tell whether a hand is so low that what it holds need not be raised."""
    return bool(sensed.get_grasp_point(side)[2] < HELD_HEIGHT + HELD_DISTANCE / 2)


def find_empty(sensed: Sensed, sides: Iterable[Side], points: np.ndarray) -> dict[Side, float]:
    """Find the hands that are up and hold nothing of a garment.

    Args:
        sensed: Present grasp points.
        sides: The hands that may hold it.
        points: Known points of the garment [m], shape (N, 3), world frame.

    Returns:
        Distance of the nearest raised point from each of them [m].
    """
    raised = points[points[:, 2] > HELD_HEIGHT]
    empty: dict[Side, float] = {}
    for side in sides:
        if is_low(sensed, side):
            continue
        grasp = sensed.get_grasp_point(side)
        nearest = float(np.linalg.norm(raised - grasp, axis=1).min(initial=np.inf))
        if nearest > HELD_DISTANCE:
            empty[side] = nearest
    return empty
