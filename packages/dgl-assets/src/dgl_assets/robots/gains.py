"""Drive gains of the arm and the hand: published ones, and those of the tasks.

Source of the published ones: MuJoCo Menagerie's UR10e and Shadow Hand models.
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


def _arm(stiffness: float, damping: float, force_limit: float) -> JointGains:
    return JointGains(stiffness=stiffness, damping=damping, force_limit=force_limit, armature=0.1)


def _hand(stiffness: float, damping: float, force_limit: float) -> JointGains:
    gains = JointGains(
        stiffness=stiffness, damping=damping, force_limit=force_limit, armature=0.0002
    )
    return replace(gains, friction=0.01)


_ARM_GAINS = (
    _arm(4000, 350, 330),
    _arm(4000, 350, 330),
    _arm(3500, 200, 150),
    _arm(3200, 30, 56),
    _arm(3200, 30, 56),
    _arm(3200, 30, 56),
)
_FINGER_GAINS = {
    "J5": _hand(1, 0.05, 1),
    "J4": _hand(1, 0.05, 1),
    "J3": _hand(1, 0.05, 1),
    # J2 and J1 of the real finger share one tendon; the published gain is that of the pair.
    "J2": _hand(0.5, 0.05, 1),
    "J1": _hand(0.5, 0.05, 1),
}
_SPECIAL_GAINS = {
    "WRJ2": _hand(10, 0.5, 10),
    "WRJ1": _hand(8, 0.5, 5),
    "THJ5": _hand(0.4, 0.05, 3),
    "THJ4": _hand(1, 0.05, 2),
    "THJ3": _hand(0.5, 0.05, 1),
    "THJ2": _hand(1.5, 0.05, 1),
    "THJ1": _hand(1, 0.05, 1),
}

PUBLISHED_GAINS: dict[str, JointGains] = {
    **{joint.name: gains for joint, gains in zip(UR10E, _ARM_GAINS, strict=True)},
    **{
        joint.name: _SPECIAL_GAINS.get(joint.name) or _FINGER_GAINS[joint.name[-2:]]
        for joint in SHADOW_HAND
    },
}
"""Gains by joint name without the side prefix."""

# The published arm gains give a time constant of 88 ms at the shoulder, 5 cm of lag at 0.6 m/s. An
# implicit integrator allows stiffer drives; torques stay the robot's own.
_ARM_DRIVES = ((20000, 700), (20000, 700), (12000, 300), (3200, 60), (3200, 60), (3200, 60))

DRIVE_GAINS: dict[str, JointGains] = {
    **{
        joint.name: JointGains(
            stiffness=stiffness,
            damping=damping,
            force_limit=joint.torque,
            armature=PUBLISHED_GAINS[joint.name].armature,
        )
        for joint, (stiffness, damping) in zip(UR10E, _ARM_DRIVES, strict=True)
    },
    **{
        # The weakest published joints would need half a second; a hand pose takes 20 steps.
        joint.name: replace(
            PUBLISHED_GAINS[joint.name],
            stiffness=max(1.0, PUBLISHED_GAINS[joint.name].stiffness),
        )
        for joint in SHADOW_HAND
    },
}
"""Gains in the tasks by joint name without the side prefix."""
