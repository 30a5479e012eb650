"""The kinematic tree of one or two arms with hands, as data, and its forward kinematics."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from dgl_assets.robots._frames import AXIS_Z, rotation_about, transform
from dgl_assets.robots.collision import CollisionShape

Side = Literal["left", "right"]
SIDES: tuple[Side, ...] = ("left", "right")
REFLECTION = np.diag([-1.0, 1.0, 1.0, 1.0])
"""Reflection in x of each frame: it makes a left hand of a right one."""

BasePlacement = tuple[float, float, float, float]
"""Placement of an arm's base: x, y, z [m] and yaw [rad], world frame."""

ROOT_LINK = "root"
EE_LINK = "ee"
"""The frame that tasks command: x along the fingers, y out of the palm; every arm ends in it."""
DEFAULT_LEFT_BASE: BasePlacement = (-0.8, 0.0, 0.5, 0.0)
"""Left base of the folding and flinging tasks: x, y, z [m], yaw [rad]."""
DEFAULT_RIGHT_BASE: BasePlacement = (0.8, 0.0, 0.5, 0.0)
"""Right base of the folding and flinging tasks."""


@dataclass(frozen=True, kw_only=True)
class TreeLink:
    """A rigid link with its inertia and collision shapes."""

    name: str
    mass: float
    """Mass [kg]; zero for a pure frame."""
    inertial_to_link: np.ndarray
    """Transform of the inertial frame (origin at the centre of mass), shape (4, 4)."""
    inertia: np.ndarray
    """Inertia at the centre of mass [kg m^2], inertial axes, shape (3, 3)."""
    collision: tuple[CollisionShape, ...] = ()


@dataclass(frozen=True, kw_only=True)
class TreeJoint:
    """A joint of the tree; `axis` is None for a fixed one."""

    name: str
    parent: str
    child: str
    joint_to_parent: np.ndarray
    """Constant transform from the joint frame to the parent link, shape (4, 4)."""
    axis: tuple[float, float, float] | None = None
    kind: Literal["revolute", "prismatic"] = "revolute"
    """Motion of a joint with an axis."""
    lower: float = 0.0
    """Lower limit [rad or m]."""
    upper: float = 0.0
    """Upper limit [rad or m]."""
    effort: float = 0.0
    """Largest torque [N m] or force [N]."""
    speed: float = 0.0
    """Largest speed [rad/s or m/s]."""


@dataclass(frozen=True, kw_only=True)
class KinematicTree:
    """Links and joints, each parent before its children; the root frame is the world."""

    links: tuple[TreeLink, ...]
    joints: tuple[TreeJoint, ...]

    @property
    def moving_joint_names(self) -> tuple[str, ...]:
        """Names of the joints that move, in the order of the tree."""
        return tuple(joint.name for joint in self.joints if joint.axis is not None)

    def take_chain(self, link: str) -> "KinematicTree":
        """Keep the links and joints from the root to a link."""
        by_child = {joint.child: joint for joint in self.joints}
        joints, at = [], link
        while at in by_child:
            joints.append(by_child[at])
            at = by_child[at].parent
        kept = {at, *(joint.child for joint in joints)}
        return KinematicTree(
            links=tuple(item for item in self.links if item.name in kept),
            joints=tuple(reversed(joints)),
        )

    def compute_link_poses(self, positions: Mapping[str, float]) -> dict[str, np.ndarray]:
        """Compute every link's pose in the world.

        Args:
            positions: Joint positions [rad or m] by name; every moving joint must be present.

        Returns:
            Transforms link to world, shape (4, 4), by link name.

        Raises:
            ValueError: If a moving joint has no position.
        """
        missing = sorted(set(self.moving_joint_names) - set(positions))
        if missing:
            raise ValueError(f"positions must name every moving joint; missing {missing}")
        poses = {self.links[0].name: np.eye(4)}
        for joint in self.joints:
            T = poses[joint.parent] @ joint.joint_to_parent
            if joint.axis is not None:
                axis, value = np.array(joint.axis), positions[joint.name]
                if joint.kind == "prismatic":
                    T = T @ transform(axis * value)
                else:
                    T = T @ transform(np.zeros(3), rotation_about(axis, value))
            poses[joint.child] = T
        return poses


def join_side(
    side: Side,
    base: BasePlacement,
    arm: KinematicTree,
    hand: KinematicTree | None = None,
    *,
    hand_to_ee: np.ndarray | None = None,
) -> KinematicTree:
    """Put an arm, and a hand on its frame `ee`, under the world-fixed root.

    Args:
        side: "left" or "right"; every name gets it as a prefix.
        base: Placement of the arm's first link.
        arm: The arm; its link `ee` carries the hand.
        hand: The hand, without names of the arm; None for a bare arm.
        hand_to_ee: Pose of the hand's first link in `ee`, shape (4, 4); given with a hand.
    """
    x, y, z, yaw = base
    joints = [
        TreeJoint(
            name="base_joint",
            parent=ROOT_LINK,
            child=arm.links[0].name,
            joint_to_parent=transform((x, y, z), rotation_about(AXIS_Z, yaw)),
        ),
        *arm.joints,
    ]
    links = list(arm.links)
    if hand is not None:
        assert hand_to_ee is not None
        mount = TreeJoint(
            name="hand_mount",
            parent=EE_LINK,
            child=hand.links[0].name,
            joint_to_parent=hand_to_ee,
        )
        joints += [mount, *hand.joints]
        links += hand.links

    def prefixed(name: str) -> str:
        return name if name == ROOT_LINK else f"{side}_{name}"

    def prefix_link(link: TreeLink) -> TreeLink:
        shapes = tuple(replace(s, link=prefixed(s.link)) for s in link.collision)
        return replace(link, name=prefixed(link.name), collision=shapes)

    def prefix_joint(joint: TreeJoint) -> TreeJoint:
        ends = {"parent": prefixed(joint.parent), "child": prefixed(joint.child)}
        return replace(joint, name=prefixed(joint.name), **ends)

    return KinematicTree(
        links=(make_frame_link(ROOT_LINK), *map(prefix_link, links)),
        joints=tuple(map(prefix_joint, joints)),
    )


def join_pair(left: KinematicTree, right: KinematicTree) -> KinematicTree:
    """Put both sides under one root."""
    return KinematicTree(links=left.links + right.links[1:], joints=left.joints + right.joints)


def make_frame_link(name: str) -> TreeLink:
    """Make a link that is a pure frame."""
    return TreeLink(name=name, mass=0.0, inertial_to_link=np.eye(4), inertia=np.zeros((3, 3)))


def reflect_joint(joint: TreeJoint) -> TreeJoint:
    """Reflect a joint by `REFLECTION`; an equal value gives the reflected pose."""
    axis = joint.axis
    if axis is not None:
        x, y, z = axis
        # the direction of a slide is reflected; that of a turn is reflected and reversed
        axis = (-x, y, z) if joint.kind == "prismatic" else (x, -y, -z)
    reflected = REFLECTION @ joint.joint_to_parent @ REFLECTION
    return replace(joint, joint_to_parent=reflected, axis=axis)
