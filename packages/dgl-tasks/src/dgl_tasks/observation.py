"""Observation of a policy, and the rates of control and recording."""

from dataclasses import dataclass

import numpy as np

CONTROL_FREQUENCY = 60
"""Control steps a second."""
STEPS_PER_ACTION = 5
"""Control steps of an action; also those between two recorded frames."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Observation:
    """Measurements at one instant; world frame, float32 unless stated."""

    joint_state: np.ndarray
    """Measured joint positions [rad], shape (D,)."""
    ee_pose: np.ndarray
    """Left and right end effector, position [m] and unit quaternion wxyz, shape (2, 7)."""
    image: np.ndarray
    """Environment camera, RGB, shape (480, 640, 3), uint8."""
    env_point_cloud: np.ndarray
    """Position [m] and colour in [0, 1] of what `CloudKind` says, shape (2048, 6)."""

    def as_arrays(self) -> dict[str, np.ndarray]:
        """Give the arrays by the keys of episode files."""
        return {key: getattr(self, key) for key in self.__dataclass_fields__}
