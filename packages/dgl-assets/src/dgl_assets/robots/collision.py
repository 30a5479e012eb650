"""Collision shapes of the arm and the hand in link frames: capsules, boxes and spheres.

The same shapes are written into the URDF and handed to the cloth contact. Sizes follow MuJoCo
Menagerie's models where those use primitives; the fingertips, which are meshes there, become
capsules whose cap ends at the tip.
"""

from dataclasses import dataclass, replace
from math import sqrt
from typing import Literal

import numpy as np

from dgl_assets.robots._frames import rotation_from_quaternion
from dgl_assets.robots.arm import ELBOW_OFFSET, SHOULDER_OFFSET, UR10E
from dgl_assets.robots.hand import FINGERTIP_OFFSET, HAND_MASS, SIDES, THUMB_TIP_OFFSET, Side

ShapeKind = Literal["capsule", "box", "sphere", "cylinder", "mesh"]
Vector3 = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]


@dataclass(frozen=True, kw_only=True)
class CollisionShape:
    """One convex shape fixed in a link.

    A capsule is the set of points within `radius` of a segment of length 2 `half_length` along
    the local z axis; a cylinder lies along the same axis; a mesh stands for its convex hull.
    """

    link: str
    """Link that carries the shape."""
    kind: ShapeKind
    radius: float = 0.0
    """Radius [m] of a capsule, cylinder or sphere; zero for others."""
    half_length: float = 0.0
    """Half length [m] of a capsule's segment, without its caps, or of a cylinder."""
    half_size: Vector3 = (0.0, 0.0, 0.0)
    """Half sizes [m] of a box along its local axes."""
    xyz: Vector3 = (0.0, 0.0, 0.0)
    """Centre [m] in the link frame."""
    wxyz: Quaternion = (1.0, 0.0, 0.0, 0.0)
    """Orientation in the link frame."""
    mesh: str = ""
    """File name of a mesh of the robot, in the link frame."""

    def __post_init__(self) -> None:
        sizes = {
            "capsule": (self.radius, self.half_length),
            "sphere": (self.radius,),
            "box": self.half_size,
            "cylinder": (self.radius, self.half_length),
            "mesh": (1.0 if self.mesh else 0.0,),
        }
        if self.kind not in sizes:
            raise ValueError(f"kind must be one of {sorted(sizes)}; got {self.kind!r}")
        if min(sizes[self.kind]) <= 0.0:
            raise ValueError(f"a {self.kind} needs positive sizes; got {sizes[self.kind]}")


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
    """List the shapes of one link, all named without the side prefix; empty for a pure frame."""
    shapes = collision_shapes(side)
    return tuple(replace(s, link=link) for s in shapes if s.link == f"{side}_{link}")


def collision_shapes(side: Side) -> tuple[CollisionShape, ...]:
    """List all primitives of one side's arm and hand.

    The arms are equal on both sides; the left hand is the right one reflected in x of each link
    frame (every hand shape is symmetric under the reflection up to its centre).

    Args:
        side: "left" or "right".

    Returns:
        Shapes with prefixed link names, arm first, poses in link frames.
    """
    if side not in SIDES:
        raise ValueError(f"side must be one of {SIDES}; got {side!r}")
    shapes = []
    for shape in (*_ARM_SHAPES, *_HAND_SHAPES):
        x, y, z = shape.xyz
        is_mirrored = side == "left" and shape.link in HAND_MASS
        shapes.append(
            replace(shape, link=f"{side}_{shape.link}", xyz=(-x if is_mirrored else x, y, z))
        )
    return tuple(shapes)


def hand_link_extent(side: Side, link: str) -> tuple[np.ndarray, np.ndarray]:
    """Compute the bounds [m] of a link's shapes, low and high, each (3,), link frame."""
    lows, highs = [], []
    for shape in link_shapes(side, link):
        R = rotation_from_quaternion(np.array(shape.wxyz))
        if shape.kind == "box":
            reach = np.abs(R) @ np.array(shape.half_size)
        else:
            reach = np.abs(R[:, 2]) * shape.half_length + shape.radius
        lows.append(np.array(shape.xyz) - reach)
        highs.append(np.array(shape.xyz) + reach)
    return np.min(lows, axis=0), np.max(highs, axis=0)
