"""Checks of arrays at the public boundary."""

import numpy as np

__all__ = ["check_cloud"]


def check_cloud(cloud: np.ndarray, name: str, *, min_points: int = 1) -> np.ndarray:
    """Return a cloud as float64 after checking its shape and values.

    Args:
        cloud: Points, shape (N, 3), any real dtype.
        name: What to call it in a message.
        min_points: Smallest number of points that is allowed.

    Raises:
        ValueError: If the shape, the number of points or a value is wrong.
    """
    points = np.asarray(cloud, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != 3:
        raise ValueError(f"{name} must have shape (N, 3); got {points.shape}")
    if points.shape[0] < min_points:
        raise ValueError(f"{name} must have at least {min_points} point(s); got {points.shape[0]}")
    if not np.isfinite(points).all():
        bad = np.flatnonzero(~np.isfinite(points).all(axis=1))
        raise ValueError(
            f"{name} must be finite; got {bad.size} point(s) that are not, first {bad[0]}"
        )
    return points
