"""The 60-number state and action vector, its home configuration and the named hand poses."""

import numpy as np

from dgl_assets.robots.arm import UR10E
from dgl_assets.robots.hand import SHADOW_HAND, SIDES, Side

ARM_DOF = len(UR10E)
HAND_DOF = len(SHADOW_HAND)
SIDE_DOF = ARM_DOF + HAND_DOF


def arm_joint_names(side: Side) -> tuple[str, ...]:
    """List the six arm joints of a side, base to flange."""
    return tuple(f"{side}_{joint.name}" for joint in UR10E)


def hand_joint_names(side: Side) -> tuple[str, ...]:
    """List the 24 hand joints of a side: WRJ2-1, FFJ4-1, MFJ4-1, RFJ4-1, LFJ5-1, THJ5-1."""
    return tuple(f"{side}_{joint.name}" for joint in SHADOW_HAND)


JOINT_NAMES: tuple[str, ...] = tuple(
    name for side in SIDES for name in (*arm_joint_names(side), *hand_joint_names(side))
)
"""Order of the 60 numbers: left arm 6, left hand 24, right arm 6, right hand 24."""


def joint_slice(side: Side, part: str) -> slice:
    """Give the slice of `part` ("arm", "hand" or "all") of a side in the 60-vector."""
    start = SIDES.index(side) * SIDE_DOF
    spans = {
        "arm": slice(start, start + ARM_DOF),
        "hand": slice(start + ARM_DOF, start + SIDE_DOF),
        "all": slice(start, start + SIDE_DOF),
    }
    if part not in spans:
        raise ValueError(f"part must be one of {sorted(spans)}; got {part!r}")
    return spans[part]


def _frozen(values: np.ndarray) -> np.ndarray:
    values.setflags(write=False)
    return values


HOME_CONFIGURATION: np.ndarray = _frozen(
    np.concatenate(
        [
            (-1.57, -1.84, -2.5, -1.89, -1.57, 0.0),
            np.zeros(HAND_DOF),
            (1.57, -1.3, 2.5, -1.25, 1.57, 0.0),
            np.zeros(HAND_DOF),
        ]
    )
)
"""Start of every episode [rad], shape (60,), in the order of JOINT_NAMES, read-only."""

# Poses of one person's hand, shared by both sides; "flat" is "open" with the thumb beside the palm.
_POSE_NAMES = ("open", "close", "pinch", "cradle", "smooth", "flat")
_POSE_ROWS = {
    "WRJ2": (-0.061508, 0.079341, -0.135955, -0.160608, -0.066714, -0.061508),
    "WRJ1": (-0.078995, -0.015047, 0.057547, 0.095421, 0.166427, -0.078995),
    "FFJ4": (-0.349066, 0.267737, -0.349066, -0.329501, -0.243158, -0.349066),
    "FFJ3": (0.022615, 0.711540, 0.568936, 0.004190, 0.233356, 0.022615),
    "FFJ2": (0.018516, 0.951351, 1.155622, 0.066234, 0.673720, 0.018516),
    "FFJ1": (0.018516, 0.878066, 0.744316, 0.066227, 0.064479, 0.018516),
    "MFJ4": (-0.083472, -0.085316, -0.170137, -0.092732, -0.162202, -0.083472),
    "MFJ3": (0.000000, 0.853322, 0.061512, 0.014665, 0.512784, 0.000000),
    "MFJ2": (0.007556, 0.787673, 0.071965, 0.042325, 0.165908, 0.007556),
    "MFJ1": (0.007556, 0.787673, 0.071965, 0.042325, 0.088087, 0.007556),
    "RFJ4": (-0.095097, 0.034025, 0.032490, -0.049715, 0.194555, -0.095097),
    "RFJ3": (0.007978, 0.676241, 0.000000, 0.011056, 0.339687, 0.007978),
    "RFJ2": (0.023610, 1.124213, 0.034489, 0.070814, 0.471966, 0.023610),
    "RFJ1": (0.023610, 0.873929, 0.034489, 0.070814, 0.000000, 0.023610),
    "LFJ5": (0.068555, 0.219334, 0.000000, 0.065280, 0.126723, 0.068555),
    "LFJ4": (-0.349066, 0.000176, -0.349066, -0.349066, 0.098258, -0.349066),
    "LFJ3": (0.047992, 0.414303, 0.087935, 0.048728, 0.340770, 0.047992),
    "LFJ2": (0.034659, 1.313391, 0.051463, 0.050298, 0.161393, 0.034659),
    "LFJ1": (0.034460, 0.758441, 0.051463, 0.050298, 0.056563, 0.034460),
    "THJ5": (-0.068903, 0.976555, 0.332827, 0.535379, 0.614344, -0.500000),
    "THJ4": (0.639038, 1.102938, 0.536996, 0.807512, 0.508355, 0.000000),
    "THJ3": (-0.151108, 0.058905, 0.078964, 0.196262, -0.031981, -0.151108),
    "THJ2": (-0.082611, -0.012796, 0.329580, 0.580378, 0.053134, -0.082611),
    "THJ1": (0.028021, 0.057510, 0.248389, 0.014075, 0.070668, 0.028021),
}

HAND_POSES: dict[str, np.ndarray] = {
    name: _frozen(np.array([_POSE_ROWS[joint.name][column] for joint in SHADOW_HAND]))
    for column, name in enumerate(_POSE_NAMES)
}
"""Named hand poses [rad], each of shape (24,), finger-wise, valid for either hand, read-only."""
