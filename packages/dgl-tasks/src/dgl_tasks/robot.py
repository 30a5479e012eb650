"""The two UR10e arms with Shadow Hands as one ManiSkill agent."""

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Literal

import numpy as np
import torch
from mani_skill.agents.base_agent import BaseAgent, Keyframe
from mani_skill.agents.controllers.pd_joint_pos import PDJointPosControllerConfig
from mani_skill.agents.registration import register_agent
from mani_skill.utils.structs import Actor, Pose
from sapien import Pose as SapienPose

from dgl_assets.robots import (
    DEFAULT_LEFT_BASE,
    DEFAULT_RIGHT_BASE,
    HOME_CONFIGURATION,
    JOINT_NAMES,
    PUBLISHED_GAINS,
    SIDES,
    UR10E,
    BasePlacement,
    Side,
    arm_joint_names,
    build_bimanual_urdf,
    hand_joint_names,
)

GroundContact = Literal["hands", "all", "none"]

DEFAULT_ROBOT_DIRECTORY = Path.home() / ".cache" / "dexgarmentlab" / "robots"
"""Where generated robot files are kept between runs."""

SIDE_COLLISION_BITS: dict[Side, int] = {"left": 27, "right": 28}
"""Bits of collision group 2: shapes that share one ignore each other, so a side ignores itself."""
GROUND_COLLISION_BIT = 30
"""Bit of collision group 2 shared by a ground and the links that pass through it.

The same bit as ManiSkill's mobile robots use.
"""


@dataclass(frozen=True, kw_only=True)
class DriveGains:
    """Position drives of the joints of one group, in the order of the group."""

    stiffness: tuple[float, ...]
    """Proportional gains [N m / rad]."""
    damping: tuple[float, ...]
    """Derivative gains [N m s / rad]."""
    force_limit: tuple[float, ...]
    """Largest drive torques [N m]."""


# The published arm gains give a time constant of 88 ms at the shoulder, 5 cm of lag at 0.6 m/s. The
# drives are integrated implicitly here, which allows stiffer ones; torques stay the robot's own.
ARM_GAINS = DriveGains(
    stiffness=(20000, 20000, 12000, 3200, 3200, 3200),
    damping=(700, 700, 300, 60, 60, 60),
    force_limit=tuple(joint.torque for joint in UR10E),
)


def _hand_gains() -> DriveGains:
    names = [name.removeprefix("left_") for name in hand_joint_names("left")]
    gains = [PUBLISHED_GAINS[name] for name in names]
    return DriveGains(
        # The weakest published joints would need half a second to close; a hand pose takes 20 steps.
        stiffness=tuple(max(1.0, g.stiffness) for g in gains),
        damping=tuple(g.damping for g in gains),
        force_limit=tuple(g.force_limit for g in gains),
    )


HAND_GAINS = _hand_gains()


@register_agent()
class BimanualUR10eShadow(BaseAgent):
    """Two UR10e arms with Shadow Hands under one fixed root; gravity does not act on them.

    The action of `pd_joint_pos` is 60 absolute joint positions [rad] in the order of
    `dgl_assets.robots.JOINT_NAMES`. Where the bases stand is a class attribute: make a variant with
    `make_agent_class`.
    """

    uid = "bimanual_ur10e_shadow"
    left_base: BasePlacement = DEFAULT_LEFT_BASE
    """Left base: x, y, z [m] and yaw [rad], world frame."""
    right_base: BasePlacement = DEFAULT_RIGHT_BASE
    """Right base, likewise."""
    ground_contact: GroundContact = "hands"
    """Which links a marked ground stops: palms and fingers, everything, or nothing."""
    directory: Path = DEFAULT_ROBOT_DIRECTORY
    """Folder for the generated robot files."""

    def _load_articulation(self, initial_pose: SapienPose | Pose | None = None) -> None:
        self.urdf_path = str(
            build_bimanual_urdf(
                self.directory, left_base=self.left_base, right_base=self.right_base
            )
        )
        # The bases are placed inside the file, so the root stands at the world's origin.
        super()._load_articulation(SapienPose() if initial_pose is None else initial_pose)

    def _after_loading_articulation(self) -> None:
        for link in self.robot.get_links():
            side = link.name.split("_", 1)[0]
            if side in SIDE_COLLISION_BITS:
                link.set_collision_group_bit(2, SIDE_COLLISION_BITS[side], 1)
            if not self._meets_ground(link.name):
                link.set_collision_group_bit(2, GROUND_COLLISION_BIT, 1)
        for joint in self.robot.active_joints:
            gains = PUBLISHED_GAINS[joint.name.split("_", 1)[1]]
            for entity_joint in joint._objs:  # noqa: SLF001  ManiSkill has no armature setter
                entity_joint.set_armature(np.array([gains.armature], dtype=np.float32))

    def _after_init(self) -> None:
        index = {joint.name: i for i, joint in enumerate(self.robot.active_joints)}
        order = [index[name] for name in JOINT_NAMES]
        self._from_articulation = torch.tensor(order, device=self.device)
        self._to_articulation = torch.argsort(self._from_articulation)
        self._ee_links = [self.robot.links_map[f"{side}_ee"] for side in SIDES]
        self.keyframes = {
            "home": Keyframe(
                pose=SapienPose(),
                qpos=HOME_CONFIGURATION[self._to_articulation.cpu().numpy()].astype(np.float32),
            )
        }

    @property
    def _controller_configs(self) -> dict:
        groups = {}
        for side in SIDES:
            for part, names, gains in (
                ("arm", arm_joint_names(side), ARM_GAINS),
                ("hand", hand_joint_names(side), HAND_GAINS),
            ):
                groups[f"{side}_{part}"] = PDJointPosControllerConfig(
                    joint_names=list(names),
                    lower=None,
                    upper=None,
                    stiffness=gains.stiffness,
                    damping=gains.damping,
                    force_limit=gains.force_limit,
                    normalize_action=False,
                )
        return {"pd_joint_pos": groups}

    def _meets_ground(self, link_name: str) -> bool:
        if self.ground_contact != "hands":
            return self.ground_contact == "all"
        part = link_name.split("_", 1)[-1]
        return part.startswith(("palm", "ff_", "mf_", "rf_", "lf_", "th_"))

    def get_joint_state(self) -> torch.Tensor:
        """Read the joint positions [rad], shape (B, 60), in the order of JOINT_NAMES."""
        return self.robot.get_qpos()[:, self._from_articulation]

    def get_joint_velocity(self) -> torch.Tensor:
        """Read the joint velocities [rad/s], shape (B, 60), in the order of JOINT_NAMES."""
        return self.robot.get_qvel()[:, self._from_articulation]

    def set_joint_state(self, positions: torch.Tensor | np.ndarray) -> None:
        """Place the joints at rest; the drives keep the targets of the last action.

        Args:
            positions: Joint positions [rad], shape (60,) or (B, 60), in the order of JOINT_NAMES.
        """
        # A copy: torch warns about read-only arrays such as HOME_CONFIGURATION.
        if isinstance(positions, np.ndarray):
            positions = torch.from_numpy(np.array(positions, dtype=np.float32))
        q = positions.to(device=self.device, dtype=torch.float32)
        if q.shape[-1] != len(JOINT_NAMES) or q.ndim > 2:
            raise ValueError(f"positions must have shape (60,) or (B, 60); got {tuple(q.shape)}")
        self.reset(q[..., self._to_articulation])

    def get_ee_poses(self) -> torch.Tensor:
        """Read the poses of both `ee` frames, left first: xyz [m] and wxyz, shape (B, 2, 7), world."""
        return torch.stack([link.pose.raw_pose for link in self._ee_links], dim=1)


@lru_cache(maxsize=64)
def make_agent_class(
    *,
    left_base: BasePlacement = DEFAULT_LEFT_BASE,
    right_base: BasePlacement = DEFAULT_RIGHT_BASE,
    ground_contact: GroundContact = "hands",
    directory: Path = DEFAULT_ROBOT_DIRECTORY,
) -> type[BimanualUR10eShadow]:
    """Make the agent class for a task's base placement, to be given as `robot_uids`.

    Args:
        left_base: Left base: x, y, z [m] and yaw [rad], world frame.
        right_base: Right base, likewise.
        ground_contact: Which links meet a ground marked by `let_robot_pass`: "hands" (palms and
            fingers: a flat grasp brings the forearm housing below z = 0), "all" or "none".
        directory: Folder for the generated robot files.

    Returns:
        A subclass of `BimanualUR10eShadow`; equal arguments give the same class.
    """
    choices = ("hands", "all", "none")
    if ground_contact not in choices:
        raise ValueError(f"ground_contact must be one of {choices}; got {ground_contact!r}")
    return type(
        "BimanualUR10eShadow",
        (BimanualUR10eShadow,),
        {
            "left_base": left_base,
            "right_base": right_base,
            "ground_contact": ground_contact,
            "directory": directory,
            "__doc__": BimanualUR10eShadow.__doc__,
        },
    )


def let_robot_pass(actor: Actor) -> None:
    """Mark a ground, table or prop that the links outside of `ground_contact` pass through."""
    actor.set_collision_group_bit(2, GROUND_COLLISION_BIT, 1)
