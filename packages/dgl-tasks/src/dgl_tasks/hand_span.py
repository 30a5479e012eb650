"""Coordinates of hand configurations in the span of a robot's named poses, and actions of them."""

import numpy as np

from dgl_assets.robots import HAND_POSES, SIDES, Robot

__all__ = ["HandPoseActions", "HandSpan"]

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


class HandPoseActions:
    """Converts joint targets to actions of the control mode `pd_hand_poses`, and back.

    For left and right in this order, an action has the targets of the arm's joints [rad] and the
    coordinates of the hand in its `HandSpan`: A = 22 numbers of the default robot. Commands that
    interpolate the hand's named poses are converted to `RESOLUTION`, others to the nearest that
    does. What was converted once is converted back and forth in float32 without any change.
    """

    RESOLUTION = 2.0**-16
    """Coordinates are multiples of this: 2e-5 rad of a finger."""

    def __init__(self, robot: Robot) -> None:
        self._robot, self._span = robot, HandSpan(robot)
        arms = [joint.name for joint in robot.arm_joints]
        hands = [f"hand_{name}" for name in HandSpan.names]
        self.names: tuple[str, ...] = tuple(f"{s}_{n}" for s in SIDES for n in (*arms, *hands))
        """Names of the numbers of an action."""
        lower = [*(j.lower for j in robot.arm_joints), *(0.0 for _ in hands)] * 2
        upper = [*(j.upper for j in robot.arm_joints), *(1.0 for _ in hands)] * 2
        self.bounds: np.ndarray = np.array([lower, upper], dtype=np.float32)
        """Lower and upper bound of each number, shape (2, A)."""

    def from_joints(self, joints: np.ndarray) -> np.ndarray:
        """Compute the actions, shape (..., A), of joint targets [rad], shape (..., D)."""
        parts = []
        for side in SIDES:
            hand = joints[..., self._robot.joint_slice(side, "hand")]
            parts += [joints[..., self._robot.joint_slice(side, "arm")]]
            coordinates = self._span.to_coordinates(hand)
            parts += [np.round(coordinates / self.RESOLUTION) * self.RESOLUTION]
        return np.concatenate(parts, axis=-1)

    def to_joints(self, actions: np.ndarray) -> np.ndarray:
        """Compute the joint targets [rad], shape (..., D), of actions, shape (..., A)."""
        arm, parts = len(self._robot.arm_joints), []
        for half in np.split(actions, 2, axis=-1):
            parts += [half[..., :arm], self._span.to_joints(half[..., arm:])]
        return np.concatenate(parts, axis=-1)
