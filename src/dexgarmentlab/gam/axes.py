"""Up axis of a file of points, which the file does not tell."""

from typing import Literal

import numpy as np

__all__ = ["Up", "describe_axes", "turn_up"]

Up = Literal["x", "y", "z", "-x", "-y", "-z"]
_TURNS: dict[Up, list[list[float]]] = {
    "x": [[0, 1, 0], [0, 0, 1], [1, 0, 0]],
    "y": [[1, 0, 0], [0, 0, -1], [0, 1, 0]],
    "z": [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
    "-x": [[0, -1, 0], [0, 0, 1], [-1, 0, 0]],
    "-y": [[1, 0, 0], [0, 0, 1], [0, -1, 0]],
    "-z": [[1, 0, 0], [0, -1, 0], [0, 0, -1]],
}
"""Rotations that carry each axis to z."""
_THINNER = 1.5  # how much thinner than its height a cloud is along another axis before that is said


def turn_up(points: np.ndarray, up: Up) -> np.ndarray:
    """Turn points so that an axis becomes z.

    Args:
        points: Shape (N, 3).
        up: The axis that is up in them.

    Returns:
        Shape (N, 3), float64. No mirror image: left stays left.
    """
    return points @ np.array(_TURNS[up]).T


def describe_axes(points: np.ndarray, up: Up | None) -> tuple[str, ...]:
    """Describe the assumed up axis and size.

    Args:
        points: Shape (N, 3), z up.
        up: What the user said about it.

    Returns:
        One line, and one more where the points are thinner along another axis than along z, as what
        lies flat is not.
    """
    extent = np.ptp(points, axis=0) if len(points) else np.zeros(3)
    size = " x ".join(f"{length:.3g}" for length in extent)
    lines = [
        f"{up or 'z'} is taken to be up; its size is {size}, in whatever unit: matches depend on "
        "no unit"
    ]
    thin = int(extent[:2].argmin())
    if extent[2] > _THINNER * extent[thin]:
        # The axis has another name in the file if that was turned.
        row = np.array(_TURNS[up or "z"])[thin]
        axis = "xyz"[int(np.abs(row).argmax())]
        lines.append(
            f"it is thinnest along {axis}, not along the axis that is up: if it lies flat and is "
            "seen from above, "
            f"say --up {axis} or --up -{axis}, towards the camera"
        )
    return tuple(lines)
