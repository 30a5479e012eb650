"""The trees of the UR10e and the Shadow Hand."""

import numpy as np

from dgl_assets.robots._frames import rotation_from_quaternion, transform
from dgl_assets.robots.arm import ARM_BASE_MASS, ROTATION_EE_TO_FLANGE, UR10E
from dgl_assets.robots.built_in_shapes import link_shapes
from dgl_assets.robots.collision import CollisionShape
from dgl_assets.robots.hand import HAND_MASS, HAND_TIPS, SHADOW_HAND
from dgl_assets.robots.tree import (
    EE_LINK,
    KinematicTree,
    Side,
    TreeJoint,
    TreeLink,
    make_frame_link,
    reflect_joint,
)


def build_ur10e_tree() -> KinematicTree:
    """Build the bare arm from `base_link` to `ee`, names without a side."""
    # A solid cylinder, radius 75 mm, height 99 mm, as in the manufacturer's description.
    radius, height = 0.075, 0.099
    lateral = ARM_BASE_MASS * (3 * radius**2 + height**2) / 12
    links = [
        TreeLink(
            name="base_link",
            mass=ARM_BASE_MASS,
            inertial_to_link=transform((0, 0, height / 2)),
            inertia=np.diag([lateral, lateral, ARM_BASE_MASS * radius**2 / 2]),
            collision=link_shapes("right", "base_link"),
        )
    ]
    joints = []
    parent = "base_link"
    # Universal Robots' DH frames are those of the ROS base turned half round about z.
    joint_to_parent = transform((0, 0, 0), np.diag([-1.0, -1.0, 1.0]))
    for spec in UR10E:
        joints.append(
            TreeJoint(
                name=spec.name,
                parent=parent,
                child=spec.link,
                joint_to_parent=joint_to_parent,
                axis=(0.0, 0.0, 1.0),
                lower=-spec.limit,
                upper=spec.limit,
                effort=spec.torque,
                speed=spec.speed,
            )
        )
        ixx, iyy, izz, ixy, ixz, iyz = spec.inertia
        links.append(
            TreeLink(
                name=spec.link,
                mass=spec.mass,
                inertial_to_link=spec.link_to_next @ transform(spec.com),
                inertia=np.array([[ixx, ixy, ixz], [ixy, iyy, iyz], [ixz, iyz, izz]]),
                collision=link_shapes("right", spec.link),
            )
        )
        parent, joint_to_parent = spec.link, spec.link_to_next
    joints.append(
        TreeJoint(
            name="ee_joint",
            parent=parent,
            child=EE_LINK,
            joint_to_parent=joint_to_parent @ transform((0, 0, 0), ROTATION_EE_TO_FLANGE),
        )
    )
    links.append(make_frame_link(EE_LINK))
    return KinematicTree(links=tuple(links), joints=tuple(joints))


def build_shadow_tree(side: Side) -> KinematicTree:
    """Build one hand from `hand_forearm` to the fingertips, names without a side."""
    joints = [*(SHADOW_HAND if side == "right" else map(reflect_joint, SHADOW_HAND))]
    links = [_hand_link(side, link) for link in ("hand_forearm", *(j.child for j in joints))]
    for tip, (distal, offset) in HAND_TIPS.items():
        frame = transform((0, 0, offset))
        joints.append(
            TreeJoint(name=f"{tip}_joint", parent=distal, child=tip, joint_to_parent=frame)
        )
        links.append(make_frame_link(tip))
    return KinematicTree(links=tuple(links), joints=tuple(joints))


def _hand_link(side: Side, link: str) -> TreeLink:
    """Make a hand link with the inertia of a solid box around its collision shapes."""
    mass = HAND_MASS[link]
    shapes = link_shapes(side, link)
    low, high = _measure_extent(shapes)
    xx, yy, zz = (high - low) ** 2
    return TreeLink(
        name=link,
        mass=mass,
        inertial_to_link=transform((low + high) / 2),
        inertia=mass / 12 * np.diag([yy + zz, xx + zz, xx + yy]),
        collision=shapes,
    )


def _measure_extent(shapes: tuple[CollisionShape, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Bounds of a link's shapes [m], low and high, each (3,), link frame."""
    lows, highs = [], []
    for shape in shapes:
        R = rotation_from_quaternion(np.array(shape.wxyz))
        if shape.kind == "box":
            reach = np.abs(R) @ np.array(shape.half_size)
        else:
            reach = np.abs(R[:, 2]) * shape.half_length + shape.radius
        lows.append(np.array(shape.xyz) - reach)
        highs.append(np.array(shape.xyz) + reach)
    return np.min(lows, axis=0), np.max(highs, axis=0)
