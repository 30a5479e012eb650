"""Collision shapes of the UR10e and the Shadow Hand, in link frames.

The same shapes are written into the URDF and handed to the cloth contact. Sizes follow MuJoCo
Menagerie's models where those use primitives; the fingertips, which are meshes there, become
capsules whose cap ends at the tip.
"""

from dataclasses import replace
from math import sqrt

from dgl_assets.robots.arm import ELBOW_OFFSET, SHOULDER_OFFSET, UR10E
from dgl_assets.robots.collision import CollisionShape, Quaternion, Vector3
from dgl_assets.robots.hand import FINGERTIP_OFFSET, HAND_MASS, THUMB_TIP_OFFSET
from dgl_assets.robots.tree import Side

_S = sqrt(0.5)
_ALONG: dict[str, Quaternion] = {
    "x": (_S, 0.0, _S, 0.0),
    "y": (_S, -_S, 0.0, 0.0),
    "z": (1.0, 0.0, 0.0, 0.0),
}


def _capsule(
    link: str, radius: float, half_length: float, centre: Vector3, axis: str = "z"
) -> CollisionShape:
    shape = CollisionShape(link=link, kind="capsule", radius=radius, half_length=half_length)
    return replace(shape, xyz=centre, wxyz=_ALONG[axis])


def _sphere(link: str, radius: float, centre: Vector3 = (0.0, 0.0, 0.0)) -> CollisionShape:
    return CollisionShape(link=link, kind="sphere", radius=radius, xyz=centre)


def _box(link: str, half_size_mm: Vector3, centre_mm: Vector3) -> CollisionShape:
    hx, hy, hz = (v / 1000 for v in half_size_mm)
    x, y, z = (v / 1000 for v in centre_mm)
    return CollisionShape(link=link, kind="box", half_size=(hx, hy, hz), xyz=(x, y, z))


_UPPER_ARM, _FOREARM = UR10E[1].a, UR10E[2].a
_ARM_SHAPES: tuple[CollisionShape, ...] = (
    _capsule("base_link", 0.075, 0.025, (0, 0, 0.075)),
    _capsule("shoulder_link", 0.078, 0.08, (0, 0, 0.1307)),
    _capsule("upper_arm_link", 0.078, 0.08, (0, 0, SHOULDER_OFFSET - 0.05)),
    _capsule("upper_arm_link", 0.060, 0.30, (_UPPER_ARM / 2, 0, SHOULDER_OFFSET), "x"),
    _capsule("forearm_link", 0.058, 0.065, (0, 0, ELBOW_OFFSET + 0.08)),
    _capsule("forearm_link", 0.043, 0.28, (_FOREARM / 2, 0, ELBOW_OFFSET), "x"),
    _capsule("wrist_1_link", 0.050, 0.07, (0, 0, ELBOW_OFFSET + 0.06)),
    _capsule("wrist_2_link", 0.046, 0.065, (0, 0, 0.05)),
    _capsule("wrist_2_link", 0.046, 0.043, (0, 0.028, 0.11985), "y"),
    # Menagerie has a cylinder of this size; the box is the square inside its circle.
    _box("wrist_3_link", (33, 33, 20), (0, 0, 97)),
)

FINGER_RADIUS = 0.009
"""Radius of the proximal and middle phalanges [m]."""
DISTAL_RADIUS = 0.008
"""Radius of the distal phalanges [m]."""


def _distal(link: str, tip: float, radius: float) -> CollisionShape:
    """Make the capsule whose segment starts at the joint and whose cap ends at the tip."""
    half = (tip - radius) / 2
    return _capsule(link, radius, half, (0, 0, half))


def _finger_shapes(finger: str) -> tuple[CollisionShape, ...]:
    r = FINGER_RADIUS
    return (
        # A cylinder along x in Menagerie; without its edges it is this short capsule.
        _capsule(f"{finger}_knuckle", r, 0.004, (0, 0, 0), "x"),
        _capsule(f"{finger}_proximal", r, 0.020, (0, 0, 0.025)),
        _capsule(f"{finger}_middle", r, 0.0125, (0, 0, 0.0125)),
        _distal(f"{finger}_distal", FINGERTIP_OFFSET, DISTAL_RADIUS),
    )


_HAND_SHAPES: tuple[CollisionShape, ...] = (
    # The forearm housing tapers to the wrist.
    _box("hand_forearm", (48, 42, 62), (0, 0, 75)),
    _box("hand_forearm", (35, 35, 35), (0, -10, 181)),
    _capsule("wrist", 0.0135, 0.010, (0, 0, 0), "x"),
    _sphere("wrist", 0.011, (-0.026, 0, 0.034)),
    _sphere("wrist", 0.011, (0.031, 0, 0.034)),
    _box("palm", (31, 3.5, 49), (11, 8.5, 38)),
    _box("palm", (18, 8.5, 49), (-2, -3.5, 38)),
    _box("palm", (13, 8.5, 5), (29, -3.5, 82)),
    _box("palm", (13, 7, 9), (26.5, -1, 70)),
    _box("palm", (10.5, 13.5, 12), (31.5, -8.5, 1)),
    _box("palm", (11, 2.5, 15), (12.5, -15, 4)),
    _box("palm", (9, 12, 2), (11, 0, 89)),
    _box("palm", (10, 12, 20), (-30, 0, 9)),
    *_finger_shapes("ff"),
    *_finger_shapes("mf"),
    *_finger_shapes("rf"),
    _box("lf_metacarpal", (11, 12, 25), (2, 0, 33)),
    *_finger_shapes("lf"),
    _sphere("th_base", 0.013),
    _capsule("th_proximal", 0.0105, 0.009, (0, 0, 0.020)),
    _sphere("th_hub", 0.011),
    _capsule("th_middle", 0.009, 0.009, (0, 0, 0.012)),
    _sphere("th_middle", 0.010, (0, 0, 0.030)),
    _distal("th_distal", THUMB_TIP_OFFSET, FINGER_RADIUS),
)


def link_shapes(side: Side, link: str) -> tuple[CollisionShape, ...]:
    """List the shapes of a link, named without a side; none of a pure frame.

    The arms are equal on both sides; the left hand is the right one reflected in x of each link
    frame (every hand shape is symmetric under the reflection up to its centre).
    """
    sign = -1 if side == "left" and link in HAND_MASS else 1
    return tuple(
        replace(shape, xyz=(sign * shape.xyz[0], *shape.xyz[1:]))
        for shape in (*_ARM_SHAPES, *_HAND_SHAPES)
        if shape.link == link
    )
