"""Coordinates of hand configurations in the span of a robot's named poses."""

import numpy as np

from dgl_assets.robots import HAND_POSES, Robot

__all__ = ["HandSpan"]

_ORIGIN = "open"


class HandSpan:
    """Converts the joints of a robot's hand to weights of its named poses, and back.

    The open hand has the coordinates 0, another named pose a one at its own place. Robots have
    poses of the same names, so that the coordinates of one robot's hand mean the same of another's.
    """

    names: tuple[str, ...] = tuple(name for name in HAND_POSES if name != _ORIGIN)
    """Names of the poses, in the order of the coordinates."""

    def __init__(self, robot: Robot) -> None:
        self._origin = robot.get_hand_pose(_ORIGIN)
        self._steps = np.stack([robot.get_hand_pose(name) - self._origin for name in self.names])
        self._inverse = np.linalg.pinv(self._steps)

    def to_coordinates(self, joints: np.ndarray) -> np.ndarray:
        """Compute the coordinates, shape (..., P), that come nearest to joints [rad], (..., H)."""
        return (np.asarray(joints, dtype=float) - self._origin) @ self._inverse

    def to_joints(self, coordinates: np.ndarray) -> np.ndarray:
        """Compute the joints [rad], shape (..., H), of coordinates, shape (..., P)."""
        return self._origin + np.asarray(coordinates, dtype=float) @ self._steps
