"""Symmetric categories and their equivalent rotations."""

from collections.abc import Mapping
from typing import Literal

import numpy as np

from dgl_gam.data.correspondence import SIDE_WEIGHT
from dgl_gam.data.garment_file import GarmentData

__all__ = ["SYMMETRY", "find_turned"]

SYMMETRY: Mapping[str, Literal["revolution"]] = {"Bowl_Hat": "revolution"}
"""Symmetry by category. "revolution": the front is hardly to be told. Canonical coordinates are
then polar (distance along the profile from the top, angle about the axis) and are turned about
their origin."""
_CORNERS = 3  # vertices that a place between vertices is interpolated from


def find_turned(
    target: GarmentData, vertices: np.ndarray, angles: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Find the places that vertices come to when a body of revolution is turned about its axis.

    Args:
        target: A garment with canonical coordinates.
        vertices: Ids, shape (K,).
        angles: Turns [rad], shape (A,).

    Returns:
        Vertices around each place, shape (A, K, 3), int64, and their weights, which add up to 1, of
        the same shape.
    """
    own = target.canonical[vertices].astype(np.float64)
    cos, sin = np.cos(angles)[:, None], np.sin(angles)[:, None]
    wanted = np.stack(
        [
            cos * own[:, 0] - sin * own[:, 1],
            sin * own[:, 0] + cos * own[:, 1],
            np.broadcast_to(own[:, 2] * SIDE_WEIGHT, (len(angles), len(own))),
        ],
        axis=2,
    )
    there = target.canonical.astype(np.float64) * [1.0, 1.0, SIDE_WEIGHT]
    squared = (there**2).sum(axis=1) - 2 * wanted @ there.T + (wanted**2).sum(axis=2)[..., None]
    count = min(_CORNERS, len(there))
    corners = np.argpartition(squared, count - 1, axis=2)[..., :count]
    near = np.maximum(np.take_along_axis(squared, corners, axis=2), 0.0)
    weights = 1.0 / (near + 1e-9)
    return corners, weights / weights.sum(axis=2, keepdims=True)
