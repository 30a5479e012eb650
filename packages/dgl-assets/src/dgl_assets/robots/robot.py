"""Robots of two equal arms with mirrored hands, with their homes, poses and drive gains."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from dgl_assets.ranges import check_choice
from dgl_assets.robots._frames import transform
from dgl_assets.robots.built_in_trees import build_shadow_tree, build_ur10e_tree
from dgl_assets.robots.gains import DRIVE_GAINS, JointGains
from dgl_assets.robots.hand import ROTATION_HAND_TO_EE
from dgl_assets.robots.layout import HAND_POSES, HOME
from dgl_assets.robots.tree import (
    DEFAULT_LEFT_BASE,
    DEFAULT_RIGHT_BASE,
    SIDES,
    BasePlacement,
    KinematicTree,
    Side,
    TreeJoint,
    join_pair,
    join_side,
)
from dgl_assets.robots.urdf import write_robot
from dgl_assets.robots.visual import (
    LinkMeshes,
    build_pedestal_mesh,
    build_shadow_meshes,
    build_ur10e_meshes,
)


@dataclass(frozen=True, kw_only=True, eq=False)
class ArmPart:
    """An arm that can stand on either side."""

    name: str
    tree: KinematicTree
    """From its base to the frame `ee` (`tree.EE_LINK`); names without a side."""
    home: Mapping[Side, np.ndarray]
    """Start of each side [rad or m], shape (n,), with the fingers forward and the palm down."""
    parked: Mapping[Side, np.ndarray]
    """Pose of each side out of the cameras' way [rad or m], shape (n,)."""
    gains: tuple[JointGains, ...]
    """Drives of the moving joints in the order of the tree."""
    load_meshes: Callable[[], LinkMeshes]
    """Load its mesh files; link names without a side."""


@dataclass(frozen=True, kw_only=True, eq=False)
class HandPart:
    """A hand and its reflection; equal joint values give reflected poses."""

    name: str
    trees: Mapping[Side, KinematicTree]
    """From the link that is mounted on the arm; names without a side, equal on both."""
    mounts: Mapping[Side, np.ndarray]
    """Pose of the first link in `ee`, shape (4, 4)."""
    poses: Mapping[str, np.ndarray]
    """Joint values [rad or m] of open, close, pinch, cradle, smooth and flat, shape (n,)."""
    grasp_point: tuple[float, float, float]
    """Grasp point between the fingers, right hand, in axes of `ee` [m]; left: z negated."""
    ground_links: frozenset[str]
    """Links that the ground stops; the others, at the wrist, pass through it."""
    thumb_links: frozenset[str]
    """Links of the thumb."""
    gains: tuple[JointGains, ...]
    """Drives of the moving joints in the order of the tree."""
    load_meshes: Callable[[Side], LinkMeshes]
    """Load the mesh files of one hand; link names without a side."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Robot:
    """Two equal arms with mirrored hands.

    Its vectors hold left arm, left hand, right arm and right hand in this order, each in the order
    of its own joints.
    """

    arm: ArmPart
    hand: HandPart

    def __post_init__(self) -> None:
        for what in ("links", "joints"):
            of_arm = {item.name for item in getattr(self.arm.tree, what)}
            clash = of_arm & {item.name for item in getattr(self.hand.trees["right"], what)}
            if clash:
                raise ValueError(
                    f"{what} of arm {self.arm.name!r} and hand {self.hand.name!r} must have "
                    f"different names; both have {sorted(clash)}"
                )

    @property
    def name(self) -> str:
        """Names of arm and hand, such as "ur10e+shadow"."""
        if self.arm.name == self.hand.name:
            return self.arm.name
        return f"{self.arm.name}+{self.hand.name}"

    @cached_property
    def arm_joints(self) -> tuple[TreeJoint, ...]:
        """The moving joints of an arm, names without a side."""
        return tuple(j for j in self.arm.tree.joints if j.axis is not None)

    @cached_property
    def hand_joints(self) -> tuple[TreeJoint, ...]:
        """The moving joints of the right hand, names without a side."""
        return tuple(j for j in self.hand.trees["right"].joints if j.axis is not None)

    @property
    def dof(self) -> int:
        """Number of moving joints of both sides, D."""
        return 2 * (len(self.arm_joints) + len(self.hand_joints))

    @cached_property
    def joint_names(self) -> tuple[str, ...]:
        """Order of the D numbers of a state or an action, names with their side."""
        both = (*self.arm_joints, *self.hand_joints)
        return tuple(f"{side}_{joint.name}" for side in SIDES for joint in both)

    def joint_slice(self, side: Side, part: str) -> slice:
        """Give the slice of `part` ("arm", "hand" or "all") of a side in the vector."""
        check_choice("side", side, SIDES)
        start, middle = SIDES.index(side) * self.dof // 2, len(self.arm_joints)
        spans = {"arm": (0, middle), "hand": (middle, self.dof // 2), "all": (0, self.dof // 2)}
        if part not in spans:
            raise ValueError(f"part must be one of {sorted(spans)}; got {part!r}")
        return slice(start + spans[part][0], start + spans[part][1])

    def compute_start(self, pose: str | None = None) -> np.ndarray:
        """Give the joint values with both arms at home [rad or m], shape (D,).

        Args:
            pose: Pose of both hands, such as "open"; all zero when None.
        """
        q = np.zeros(self.dof)
        for side in SIDES:
            q[self.joint_slice(side, "arm")] = self.arm.home[side]
            if pose is not None:
                q[self.joint_slice(side, "hand")] = self.get_hand_pose(pose)
        return q

    def get_hand_pose(self, name: str) -> np.ndarray:
        """Give the joint values of a named pose [rad or m].

        Raises:
            ValueError: If there is no such pose.
        """
        if name not in self.hand.poses:
            raise ValueError(f"hand pose must be one of {sorted(self.hand.poses)}; got {name!r}")
        return self.hand.poses[name]

    def get_grasp_offset(self, side: Side) -> np.ndarray:
        """Give the grasp point between the fingers, in axes of `ee` [m], shape (3,)."""
        check_choice("side", side, SIDES)
        return np.array(self.hand.grasp_point) * (1, 1, 1 if side == "right" else -1)

    def build_side_tree(
        self, side: Side, base: BasePlacement, *, with_hand: bool = True
    ) -> KinematicTree:
        """Build one side under the world-fixed root; see `tree.join_side`."""
        check_choice("side", side, SIDES)
        if not with_hand:
            return join_side(side, base, self.arm.tree)
        return join_side(
            side, base, self.arm.tree, self.hand.trees[side], hand_to_ee=self.hand.mounts[side]
        )

    def build_tree(
        self,
        *,
        left_base: BasePlacement = DEFAULT_LEFT_BASE,
        right_base: BasePlacement = DEFAULT_RIGHT_BASE,
    ) -> KinematicTree:
        """Build both sides under one root; moving joints follow `joint_names`."""
        return join_pair(
            self.build_side_tree("left", left_base), self.build_side_tree("right", right_base)
        )

    def build_urdf(
        self,
        directory: Path | str,
        *,
        left_base: BasePlacement = DEFAULT_LEFT_BASE,
        right_base: BasePlacement = DEFAULT_RIGHT_BASE,
    ) -> Path:
        """Write both sides as one URDF under a world-fixed root.

        The folder is named after the hash of its content and appears whole: several processes may
        build the same robot at once, and a robot that exists is reused.

        Args:
            directory: Folder that holds generated robots; made when missing.
            left_base: Left base placement: x, y, z [m] and yaw [rad], world frame.
            right_base: Right base placement, likewise.

        Returns:
            Path of the URDF; its meshes lie in `meshes/` beside it.
        """
        bases = {"left": left_base, "right": right_base}
        tree = self.build_tree(left_base=left_base, right_base=right_base)
        meshes = LinkMeshes(files={}, by_link={})
        for side in SIDES:
            parts = (self.arm.load_meshes(), self.hand.load_meshes(side))
            for part in parts:
                meshes |= part.with_prefix(f"{side}_")
            base_link = f"{side}_{self.arm.tree.links[0].name}"
            meshes |= build_pedestal_mesh(base_link, bases[side][2])
        return write_robot(directory, f"bimanual_{self.name.replace('+', '_')}", tree, meshes)

    def build_arm_urdf(self, directory: Path | str, side: Side, base: BasePlacement) -> Path:
        """Write one bare arm up to the frame `<side>_ee`, for inverse kinematics.

        It has masses but neither pictures nor collision shapes.

        Args:
            directory: Folder that holds generated robots; made when missing.
            side: "left" or "right"; sets the name prefix.
            base: Base placement: x, y, z [m] and yaw [rad], world frame.

        Returns:
            Path of the URDF.
        """
        tree = self.build_side_tree(side, base, with_hand=False)
        return write_robot(directory, f"{side}_{self.arm.name}", tree, None)


def _park(side: Side) -> np.ndarray:
    """Give home with the arm swung outwards, out of the view of the cameras above."""
    q = HOME[side].copy()
    q[0] += PARK_ANGLE if side == "left" else -PARK_ANGLE
    return q


PARK_ANGLE = 0.9
"""Outward swing of an arm about the vertical, out of the cameras' way [rad]."""

_SHADOW_TREES: dict[Side, KinematicTree] = {side: build_shadow_tree(side) for side in SIDES}

UR10E_ARM = ArmPart(
    name="ur10e",
    tree=build_ur10e_tree(),
    home=HOME,
    parked={side: _park(side) for side in SIDES},
    gains=tuple(DRIVE_GAINS[name] for name in build_ur10e_tree().moving_joint_names),
    load_meshes=build_ur10e_meshes,
)
"""Universal Robots UR10e."""

SHADOW_HAND_PART = HandPart(
    name="shadow",
    trees=_SHADOW_TREES,
    mounts={side: transform((0, 0, 0), ROTATION_HAND_TO_EE) for side in SIDES},
    poses=HAND_POSES,
    # original code: beyond the knuckles, between first and middle finger
    grasp_point=(0.37, 0.025, 0.025),
    ground_links=frozenset(
        link.name
        for link in _SHADOW_TREES["right"].links
        if link.name.startswith(("palm", "ff_", "mf_", "rf_", "lf_", "th_"))
    ),
    thumb_links=frozenset(
        link.name for link in _SHADOW_TREES["right"].links if link.name.startswith("th_")
    ),
    gains=tuple(DRIVE_GAINS[name] for name in _SHADOW_TREES["right"].moving_joint_names),
    load_meshes=build_shadow_meshes,
)
"""Shadow Dexterous Hand."""

DEFAULT_ROBOT = Robot(arm=UR10E_ARM, hand=SHADOW_HAND_PART)
"""The robot of the paper: UR10e arms with Shadow Hands, 60 joints."""
