"""Facts about the UR10e arm: kinematics, limits, masses and inertias.

Source: Universal Robots' published Denavit-Hartenberg parameters and ROS 2 description
(BSD-3-Clause). Only numbers are taken; the geometry drawn here is our own.
"""

from dataclasses import dataclass
from math import pi, radians

import numpy as np

from dgl_assets.robots._frames import AXIS_X, rotation_about, transform


@dataclass(frozen=True, kw_only=True)
class ArmJoint:
    """One revolute joint of the arm together with the link that it moves.

    The link frame has z on the joint axis. The next joint sits at `link_to_next`, which is the
    constant part of the standard Denavit-Hartenberg transform, Tz(d) Tx(a) Rx(alpha).
    """

    name: str
    """Joint name without the side prefix."""
    link: str
    """Name of the moved link without the side prefix."""
    a: float
    """Denavit-Hartenberg link length [m]."""
    d: float
    """Denavit-Hartenberg offset along the joint axis [m]."""
    alpha: float
    """Denavit-Hartenberg twist [rad]."""
    limit: float
    """Position limit, symmetric about zero [rad]."""
    speed: float
    """Largest speed [rad/s]."""
    torque: float
    """Largest torque [N m]."""
    mass: float
    """Mass of the link [kg]."""
    com: tuple[float, float, float]
    """Centre of mass [m] in the Denavit-Hartenberg frame at the far end of the link."""
    inertia: tuple[float, float, float, float, float, float]
    """Inertia at the centre of mass [kg m^2], ixx iyy izz ixy ixz iyz, Denavit-Hartenberg axes."""

    @property
    def link_to_next(self) -> np.ndarray:
        """Transform from the next joint's frame to this link's frame, shape (4, 4)."""
        return transform((self.a, 0.0, self.d), rotation_about(AXIS_X, self.alpha))


UR10E: tuple[ArmJoint, ...] = (
    ArmJoint(
        name="shoulder_pan_joint", link="shoulder_link", a=0.0, d=0.1807, alpha=pi / 2,
        limit=2 * pi, speed=radians(120), torque=330.0, mass=7.369, com=(0.021, 0.0, 0.027),
        inertia=(0.03408, 0.03529, 0.02156, 0.00002, -0.00425, 0.00008),
    ),
    ArmJoint(
        name="shoulder_lift_joint", link="upper_arm_link", a=-0.6127, d=0.0, alpha=0.0,
        limit=2 * pi, speed=radians(120), torque=330.0, mass=13.051, com=(0.38, 0.0, 0.158),
        inertia=(0.02814, 0.77068, 0.76943, 0.00005, -0.01561, 0.00002),
    ),
    ArmJoint(
        name="elbow_joint", link="forearm_link", a=-0.57155, d=0.0, alpha=0.0,
        limit=pi, speed=radians(180), torque=150.0, mass=3.989, com=(0.24, 0.0, 0.068),
        inertia=(0.01014, 0.30928, 0.30646, 0.00008, 0.00916, 0.0),
    ),
    ArmJoint(
        name="wrist_1_joint", link="wrist_1_link", a=0.0, d=0.17415, alpha=pi / 2,
        limit=2 * pi, speed=radians(180), torque=54.0, mass=2.100, com=(0.0, 0.007, 0.018),
        inertia=(0.00296, 0.00222, 0.00258, -0.00001, 0.0, -0.00024),
    ),
    ArmJoint(
        name="wrist_2_joint", link="wrist_2_link", a=0.0, d=0.11985, alpha=-pi / 2,
        limit=2 * pi, speed=radians(180), torque=54.0, mass=1.980, com=(0.0, 0.007, 0.018),
        inertia=(0.00296, 0.00222, 0.00258, -0.00001, 0.0, -0.00024),
    ),
    ArmJoint(
        name="wrist_3_joint", link="wrist_3_link", a=0.0, d=0.11655, alpha=0.0,
        limit=2 * pi, speed=radians(180), torque=54.0, mass=0.615, com=(0.0, 0.0, -0.026),
        inertia=(0.00040, 0.00041, 0.00034, 0.0, 0.0, 0.0),
    ),
)  # fmt: skip
"""The six joints, base to flange."""

ARM_BASE_MASS = 4.0
"""Mass of the base [kg]."""
SHOULDER_OFFSET = 0.1762
"""Offset of the upper arm's body along the shoulder_lift axis [m]."""
ELBOW_OFFSET = 0.0393
"""Offset of the forearm's body along the elbow axis [m]."""

ROTATION_EE_TO_FLANGE = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
"""Axes of `ee` in the flange (tool0) frame, as columns: x = flange z, y = -flange x, z = -flange y.

`ee` is the task frame: x along the fingers, y out of the palm.
"""
