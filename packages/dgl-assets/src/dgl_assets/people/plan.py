"""Where joints are, and what solids a body is blended from, given its measures.

Person frame: standing on z = 0, facing -y, the left hand towards +x. In the rest pose the arms are held away from the trunk
by `REST_ABDUCTION`, fingers straight, palms towards the trunk, thumbs to the front.
"""

from __future__ import annotations

from dataclasses import dataclass, field

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
class Plan:
    """Joints, solids and named places of a body in the rest pose.

    Attributes:
        skeleton: Joints.
        body: Solids.
        carving: Solids that are cut out with rounded edges.
        places: Points near the surface [m] by name, to find landmarks, each of shape (3,).
        arm_frames: Rotation from hanging arms to the rest pose by side.
        scale: Stature over that of a man: how coarse a mesh may be.
    """

    skeleton: Skeleton
    body: Blend
    carving: tuple[Ellipsoid, ...]
    places: dict[str, np.ndarray] = field(default_factory=dict)
    arm_frames: dict[str, np.ndarray] = field(default_factory=dict)
    scale: float = 1.0


def make_plan(m: PersonMeasures) -> Plan:
    """Lay out a body.

    Args:
        m: Measures.

    Returns:
        The plan.

    Source:
        Sections and ratios that the measures do not give are drawn by eye after artists' mannequins.
    """
    joints: dict[str, np.ndarray] = {}
    places: dict[str, np.ndarray] = {}
    trunk = make_trunk(m, joints, places)
    head, carving = make_head(m, joints, places)
    arms, frames, legs = [], {}, []
    for side, sign in (("left", 1.0), ("right", -1.0)):
        frames[side] = Rotation.from_rotvec([0, -sign * REST_ABDUCTION, 0]).as_matrix()
        arms.append(make_arm(m, side, sign, frames[side], joints, places))
        legs.append(make_leg(m, side, sign, joints, places))
    size = m.stature / 1.756
    lower = Blend(parts=(trunk, Blend(parts=tuple(legs), radius=0.012 * size)), radius=0.03 * size)
    body = Blend(parts=(Blend(parts=(lower, *arms), radius=0.035 * size), head), radius=0.03 * size)

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
    return Plan(
        skeleton=skeleton, body=body, carving=carving, places=places, arm_frames=frames, scale=size
    )
