"""Drives for joints of which nobody has published gains."""

import numpy as np

from dgl_assets.robots.gains import JointGains
from dgl_assets.robots.importing.convert import compute_moments
from dgl_assets.robots.tree import KinematicTree

FREQUENCY = 40.0
"""Natural frequency of a drive [rad/s]: it answers within a few control steps of 1/60 s."""
ARM_ARMATURE, HAND_ARMATURE = 0.1, 0.0002
"""Rotor inertias [kg m^2], those published for the UR10e and the Shadow Hand."""
FINGER_STIFFNESS = 1.0
"""Least stiffness of a finger that holds cloth [N m / rad], that of the Shadow Hand."""
SLIDE_STIFFNESS = 1000.0
"""Least stiffness of a joint that slides [N / m]."""
LARGEST_SWING = 0.5
"""Torque limit of joints whose file gives none: what holds the drive at this error [rad or m]."""


def choose_gains(
    tree: KinematicTree, positions: np.ndarray, *, is_hand: bool, load: float = 0.0
) -> tuple[JointGains, ...]:
    """Choose critically damped drives from the inertia that each joint moves.

    Args:
        tree: Arm or hand.
        positions: Where it usually is [rad or m], shape (n,).
        is_hand: Whether fingers are driven, rather than an arm.
        load: Mass at the end of an arm [kg].
    """
    gains = []
    moments = compute_moments(tree, positions.tolist())
    poses = tree.compute_link_poses(
        dict(zip(tree.moving_joint_names, positions.tolist(), strict=True))
    )
    end = poses[tree.links[-1].name][:3, 3]
    moving = [joint for joint in tree.joints if joint.axis is not None]
    for joint, moment in zip(moving, moments, strict=True):
        is_slide = joint.kind == "prismatic"
        armature = HAND_ARMATURE if is_hand else ARM_ARMATURE
        T = poses[joint.child]
        lever = np.cross(T[:3, :3] @ np.array(joint.axis), end - T[:3, 3])
        inertia = moment + armature + load * (1.0 if is_slide else float(lever @ lever))
        least = SLIDE_STIFFNESS if is_slide else (FINGER_STIFFNESS if is_hand else 0.0)
        stiffness = max(least, FREQUENCY**2 * inertia)
        gains.append(
            JointGains(
                stiffness=stiffness,
                damping=2.0 * float(np.sqrt(stiffness * inertia)),
                force_limit=joint.effort or LARGEST_SWING * stiffness,
                armature=armature,
            )
        )
    return tuple(gains)
