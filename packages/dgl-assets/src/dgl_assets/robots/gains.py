"""Drive gains of the arm and the hand.

Source: MuJoCo Menagerie's UR10e and Shadow Hand models, with the changes that are told below.
"""

from dataclasses import dataclass, replace

from dgl_assets.robots.arm import UR10E
from dgl_assets.robots.hand import SHADOW_HAND


@dataclass(frozen=True, kw_only=True)
class JointGains:
    """Proportional-derivative drive of one joint; a sliding one has N and m for N m and rad."""

    stiffness: float
    """Proportional gain [N m / rad]."""
    damping: float
    """Derivative gain [N m s / rad]."""
    force_limit: float
    """Largest drive torque [N m]."""
    armature: float
    """Rotor inertia seen at the joint [kg m^2]."""
    friction: float = 0.0
    """Dry friction [N m]."""


# The published arm gains give a time constant of 88 ms at the shoulder, 5 cm of lag at 0.6 m/s. An
# implicit integrator allows stiffer drives; torques stay the robot's own.
_ARM_DRIVES = ((20000, 700), (20000, 700), (12000, 300), (3200, 60), (3200, 60), (3200, 60))

# The weakest published joints (0.4 and 0.5 N m / rad) would need half a second; a hand pose takes
# 20 steps. They get 1 N m / rad, as the other joints of the fingers have.
_FINGER = JointGains(stiffness=1.0, damping=0.05, force_limit=1, armature=0.0002, friction=0.01)
_HAND_DRIVES = {
    "WRJ2": replace(_FINGER, stiffness=10, damping=0.5, force_limit=10),
    "WRJ1": replace(_FINGER, stiffness=8, damping=0.5, force_limit=5),
    "THJ5": replace(_FINGER, force_limit=3),
    "THJ4": replace(_FINGER, force_limit=2),
    "THJ2": replace(_FINGER, stiffness=1.5),
}

DRIVE_GAINS: dict[str, JointGains] = {
    **{
        joint.name: JointGains(
            stiffness=stiffness, damping=damping, force_limit=joint.torque, armature=0.1
        )
        for joint, (stiffness, damping) in zip(UR10E, _ARM_DRIVES, strict=True)
    },
    **{joint.name: _HAND_DRIVES.get(joint.name, _FINGER) for joint in SHADOW_HAND},
}
"""Gains in the tasks by joint name without the side prefix."""
