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
        ValueError: If it holds no real numbers, or the shape, the number of points or a value is
            wrong.
    """
    try:
        given = np.asarray(cloud)
        if given.dtype.kind == "c":
            raise TypeError("they are complex")
        points = np.asarray(given, dtype=np.float64)
    except (TypeError, ValueError) as err:
        raise ValueError(f"{name} must be real numbers of shape (N, 3): {err}") from err
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
