"""Joints and solids of a body, given its measures.

Person frame: standing on z = 0, facing -y, the left hand towards +x. In the rest pose the arms are
raised by `REST_ABDUCTION`, fingers straight, palms towards the trunk, thumbs to the front.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from dgl_assets.people.arm import make_arm
from dgl_assets.people.head import make_head
from dgl_assets.people.leg import make_leg
from dgl_assets.people.measures import PersonMeasures
from dgl_assets.people.skeleton import FINGERS, REST_ABDUCTION, Skeleton, make_joints
from dgl_assets.people.solids import Blend, Ellipsoid
from dgl_assets.people.trunk import make_trunk


@dataclass(frozen=True, kw_only=True, eq=False)
class BodyPlan:
    """Joints, solids and named points of a body in the rest pose."""

    skeleton: Skeleton
    body: Blend
    carving: tuple[Ellipsoid, ...]
    """Solids that are cut out with rounded edges."""
    points: dict[str, np.ndarray]
    """Points near the surface [m] by landmark, each of shape (3,)."""
    arm_frames: dict[str, np.ndarray]
    """Rotation from hanging arms to the rest pose by side, shape (3, 3)."""
    scale: float
    """Stature over that of a man; sets the resolution of the mesh."""


def make_plan(m: PersonMeasures) -> BodyPlan:
    """Lay out a body.

    Source:
        Proportions that the measures do not give are drawn by eye after artists' mannequins.
    """
    joints: dict[str, np.ndarray] = {}
    points: dict[str, np.ndarray] = {}
    trunk = make_trunk(m, joints, points)
    head, carving = make_head(m, joints, points)
    arms, frames, legs = [], {}, []
    for side, sign in (("left", 1.0), ("right", -1.0)):
        frames[side] = Rotation.from_rotvec([0, -sign * REST_ABDUCTION, 0]).as_matrix()
        arms.append(make_arm(m, side, sign, frames[side], joints, points))
        legs.append(make_leg(m, side, sign, joints, points))
    size = m.stature / 1.756
    lower = Blend(0.03 * size, [trunk, Blend(0.012 * size, legs)])
    body = Blend(0.03 * size, [Blend(0.035 * size, [lower, *arms]), head])

    made = make_joints()
    hanging = {"elbow", "wrist", *(f"{f}{k}" for f in FINGERS for k in (1, 2, 3))}
    turned = [
        frames[joint.name.split("_")[0]] if joint.name.split("_")[-1] in hanging else np.eye(3)
        for joint in made
    ]
    skeleton = Skeleton(
        joints=made,
        positions=np.stack([joints[joint.name] for joint in made]),
        frames=np.stack(turned),
    )
    return BodyPlan(
        skeleton=skeleton, body=body, carving=carving, points=points, arm_frames=frames, scale=size
    )
