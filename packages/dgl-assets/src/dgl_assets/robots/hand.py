"""Facts about the Shadow Dexterous Hand (E3M5): joints, limits and masses.

The table is that of the right hand. Hand frame: z along the fingers, -y out of the palm, +x to the
thumb side. The left hand is its reflection in x, so equal joint values give reflected poses.

Source: published numbers on which the Shadow models of MuJoCo Menagerie (Apache-2.0) and dex-urdf
agree. Only numbers are taken; the geometry drawn here is our own.
"""

from math import cos, radians, sin

import numpy as np

from dgl_assets.robots._frames import AXIS_Y, AXIS_Z, rotation_about, transform
from dgl_assets.robots.tree import TreeJoint


def _joint(
    name: str,
    parent: str,
    child: str,
    xyz: tuple[float, float, float],
    axis: tuple[float, float, float],
    limits_deg: tuple[float, float],
    effort: float,
    rotation: np.ndarray | None = None,
) -> TreeJoint:
    """Make a joint at `xyz` [m] in its parent; `axis` is in its own frame, after `rotation`."""
    lower, upper = (radians(limit) for limit in limits_deg)
    return TreeJoint(
        name=name,
        parent=parent,
        child=child,
        joint_to_parent=transform(xyz, rotation),
        axis=axis,
        lower=lower,
        upper=upper,
        effort=effort,
        speed=2.0 if name.startswith("WR") else 4.0,
    )


_X, _PLUS_Y, _MINUS_Y = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, -1.0, 0.0)
_O = (0.0, 0.0, 0.0)
PROXIMAL_LENGTH = 0.045
"""Distance from J3 to J2 of a finger [m]."""
MIDDLE_LENGTH = 0.025
"""Distance from J2 to J1 of a finger [m]."""
FINGERTIP_OFFSET = 0.026
"""Distance from J1 of a finger to its tip [m]."""
THUMB_TIP_OFFSET = 0.0275
"""Distance from THJ1 to the thumb's tip [m]."""


def _finger(
    prefix: str, base: str, xyz: tuple[float, float, float], axis: tuple[float, float, float]
) -> list[TreeJoint]:
    """List J4 to J1 of one finger whose J4 sits at `xyz` in link `base`."""
    p = prefix.lower()
    return [
        _joint(f"{prefix}J4", base, f"{p}_knuckle", xyz, axis, (-20, 20), 2.0),
        _joint(f"{prefix}J3", f"{p}_knuckle", f"{p}_proximal", _O, _X, (-15, 90), 2.0),
        _joint(
            f"{prefix}J2", f"{p}_proximal", f"{p}_middle", (0, 0, PROXIMAL_LENGTH), _X, (0, 90), 2.0
        ),
        _joint(
            f"{prefix}J1", f"{p}_middle", f"{p}_distal", (0, 0, MIDDLE_LENGTH), _X, (0, 90), 2.0
        ),
    ]


SHADOW_HAND: tuple[TreeJoint, ...] = (
    _joint("WRJ2", "hand_forearm", "wrist", (0, -0.010, 0.21301), _PLUS_Y, (-30, 10), 10.0),
    _joint("WRJ1", "wrist", "palm", (0, 0, 0.034), _X, (-40, 28), 30.0),
    *_finger("FF", "palm", (0.033, 0, 0.095), _MINUS_Y),
    *_finger("MF", "palm", (0.011, 0, 0.099), _MINUS_Y),
    *_finger("RF", "palm", (-0.011, 0, 0.095), _PLUS_Y),
    _joint(
        "LFJ5",
        "palm",
        "lf_metacarpal",
        (-0.033, 0, 0.02071),
        (cos(radians(55)), 0, sin(radians(55))),
        (0, 45),
        2.0,
    ),
    *_finger("LF", "lf_metacarpal", (0, 0, 0.06579), _PLUS_Y),
    _joint(
        "THJ5",
        "palm",
        "th_base",
        (0.034, -0.00858, 0.029),
        (0, 0, -1),
        (-60, 60),
        5.0,
        rotation_about(AXIS_Y, radians(45)),
    ),
    _joint("THJ4", "th_base", "th_proximal", _O, _X, (0, 70), 3.0),
    _joint("THJ3", "th_proximal", "th_hub", (0, 0, 0.038), _X, (-12, 12), 2.0),
    _joint("THJ2", "th_hub", "th_middle", _O, _MINUS_Y, (-40, 40), 2.0),
    _joint(
        "THJ1",
        "th_middle",
        "th_distal",
        (0, 0, 0.032),
        _X,
        (-15, 90),
        1.0,
        rotation_about(AXIS_Z, radians(-90)),
    ),
)
"""The 24 joints of the right hand in finger-wise order: wrist, first to little finger, thumb."""

HAND_TIPS: dict[str, tuple[str, float]] = {
    "ff_tip": ("ff_distal", FINGERTIP_OFFSET),
    "mf_tip": ("mf_distal", FINGERTIP_OFFSET),
    "rf_tip": ("rf_distal", FINGERTIP_OFFSET),
    "lf_tip": ("lf_distal", FINGERTIP_OFFSET),
    "th_tip": ("th_distal", THUMB_TIP_OFFSET),
}
"""Fingertip frames: distal link and distance along its z [m]."""

_PHALANX_MASS = {"knuckle": 0.008, "proximal": 0.030, "middle": 0.017, "distal": 0.013}
HAND_MASS: dict[str, float] = {
    "hand_forearm": 3.0,
    "wrist": 0.1,
    "palm": 0.3,
    **{f"{f}_{part}": m for f in ("ff", "mf", "rf", "lf") for part, m in _PHALANX_MASS.items()},
    "lf_metacarpal": 0.030,
    "th_base": 0.010,
    "th_proximal": 0.040,
    "th_hub": 0.005,
    "th_middle": 0.020,
    "th_distal": 0.017,
}
"""Mass of each link [kg]."""

ROTATION_HAND_TO_EE = np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]])
"""Axes of the hand's forearm frame in `ee`, as columns: hand x = ee z, y = -ee y, z = ee x."""
