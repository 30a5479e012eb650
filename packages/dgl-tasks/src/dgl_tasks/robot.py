"""Two arms with hands as one ManiSkill agent: UR10e with Shadow Hands, or others."""

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
import torch
from gymnasium.spaces import Box
from mani_skill.agents.base_agent import BaseAgent
from mani_skill.agents.controllers.base_controller import ControllerConfig
from mani_skill.agents.controllers.pd_ee_pose import PDEEPoseControllerConfig
from mani_skill.agents.controllers.pd_joint_pos import (
    PDJointPosController,
    PDJointPosControllerConfig,
)
from mani_skill.agents.registration import register_agent
from mani_skill.utils.structs import Actor, Pose
from sapien import Pose as SapienPose

from dgl_assets.robots import (
    DEFAULT_LEFT_BASE,
    DEFAULT_RIGHT_BASE,
    DEFAULT_ROBOT,
    SIDES,
    BasePlacement,
    Robot,
    Side,
)
from dgl_tasks.hand_span import HandPoseActions
from dgl_tasks.robot_files import ROBOT_DIRECTORY, writing_robot_files

SIDE_COLLISION_BITS: dict[Side, int] = {"left": 27, "right": 28}
"""Bits of collision group 2: shapes that share one ignore each other, a side itself."""
GROUND_COLLISION_BIT = 30
"""Bit of collision group 2 shared by a ground and the links that pass through it.

The same bit as ManiSkill's mobile robots use.
"""


class JointTargetController(PDJointPosController):
    """ManiSkill's controller of joint positions, with targets passed to SAPIEN directly.

    ManiSkill takes each of 60 joints through torch at every control step, which costs half as much
    as the rigid bodies' simulation. Limitations: PhysX on the CPU.
    """

    def set_drive_targets(self, targets: torch.Tensor) -> None:
        """Set the drives' targets [rad], shape (1, n), in the order of the controller's joints."""
        for joint, target in zip(self.joints, targets.numpy().reshape(-1, 1), strict=True):
            joint._objs[0].set_drive_target(target)  # noqa: SLF001  ManiSkill has no quicker way


@dataclass
class JointTargetControllerConfig(PDJointPosControllerConfig):
    """`PDJointPosControllerConfig` for a `JointTargetController`."""

    controller_cls = JointTargetController


@register_agent()
class BimanualUR10eShadow(BaseAgent):
    """Two UR10e arms with Shadow Hands under one fixed root; gravity does not act on them.

    The action of `pd_joint_pos` is 60 absolute joint positions [rad] in the order of
    `DEFAULT_ROBOT.joint_names`, that of `pd_hand_poses` the 22 numbers of
    `dgl_tasks.hand_span.HandPoseActions`. That of `pd_ee_pose` has, for left and right, the pose of
    `ee` in the world (xyz [m] and intrinsic XYZ Euler angles [rad]) and 24 joint positions of the
    hand; an arm that cannot reach its pose stays. Robot and bases are class attributes;
    `make_agent_class` makes variants.
    """

    uid = "bimanual_ur10e_shadow"
    model: Robot = DEFAULT_ROBOT
    """Description of the robot; D is its number of joints, in the order of its `joint_names`."""
    left_base: BasePlacement = DEFAULT_LEFT_BASE
    """Left base: x, y, z [m] and yaw [rad], world frame."""
    right_base: BasePlacement = DEFAULT_RIGHT_BASE
    """Right base, likewise."""

    def _load_articulation(self, initial_pose: SapienPose | Pose | None = None) -> None:
        with writing_robot_files():
            path = self.model.build_urdf(
                ROBOT_DIRECTORY, left_base=self.left_base, right_base=self.right_base
            )
        self.urdf_path = str(path)
        # The bases are placed inside the file, so the root stands at the world's origin.
        super()._load_articulation(SapienPose() if initial_pose is None else initial_pose)

    def _after_loading_articulation(self) -> None:
        for link in self.robot.get_links():
            side = link.name.split("_", 1)[0]
            if side in SIDE_COLLISION_BITS:
                link.set_collision_group_bit(2, SIDE_COLLISION_BITS[side], 1)
            if link.name.split("_", 1)[-1] not in self.model.hand.ground_links:
                link.set_collision_group_bit(2, GROUND_COLLISION_BIT, 1)
        armatures = [g.armature for g in (*self.model.arm.gains, *self.model.hand.gains)] * 2
        by_name = dict(zip(self.model.joint_names, armatures, strict=True))
        for joint in self.robot.active_joints:
            for entity_joint in joint._objs:  # noqa: SLF001  ManiSkill has no setter
                entity_joint.set_armature(np.array([by_name[joint.name]], dtype=np.float32))

    def _after_init(self) -> None:
        index = {joint.name: i for i, joint in enumerate(self.robot.active_joints)}
        order = [index[name] for name in self.model.joint_names]
        self._from_articulation = torch.tensor(order, device=self.device)
        self._to_articulation = torch.argsort(self._from_articulation)
        self._ee_links = [self.robot.links_map[f"{side}_ee"] for side in SIDES]

    @property
    def _controller_configs(self) -> dict:
        joints: dict[str, JointTargetControllerConfig] = {}
        poses: dict[str, ControllerConfig] = {}
        bases = {"left": self.left_base, "right": self.right_base}
        for side in SIDES:
            for part, drives in (("arm", self.model.arm.gains), ("hand", self.model.hand.gains)):
                drive = {
                    "joint_names": list(self.model.joint_names[self.model.joint_slice(side, part)]),
                    "stiffness": tuple(g.stiffness for g in drives),
                    "damping": tuple(g.damping for g in drives),
                    "force_limit": tuple(g.force_limit for g in drives),
                    "normalize_action": False,
                }
                group = f"{side}_{part}"
                joints[group] = JointTargetControllerConfig(lower=None, upper=None, **drive)
                poses[group] = joints[group]
                if part == "arm":
                    with writing_robot_files():
                        urdf = self.model.build_arm_urdf(ROBOT_DIRECTORY, side, bases[side])
                    poses[group] = PDEEPoseControllerConfig(
                        pos_lower=-np.inf,
                        pos_upper=np.inf,
                        rot_lower=-np.inf,
                        rot_upper=np.inf,
                        ee_link=f"{side}_ee",
                        urdf_path=str(urdf),
                        use_delta=False,
                        **drive,
                    )
        return {"pd_joint_pos": joints, "pd_hand_poses": joints, "pd_ee_pose": poses}

    @cached_property
    def hand_links(self) -> dict[str, Side]:
        """Sides of the hands' links, by the link's name."""
        trees = self.model.hand.trees
        return {f"{side}_{link.name}": side for side in SIDES for link in trees[side].links}

    @cached_property
    def hand_pose_actions(self) -> HandPoseActions:
        """Converts joint targets to actions of `pd_hand_poses`, and back."""
        return HandPoseActions(self.model)

    # Instance properties in ManiSkill, too, but inferred as another type of space.
    @property
    def single_action_space(self) -> Box:  # pyright: ignore[reportIncompatibleMethodOverride]
        """Space of the actions of the present control mode."""
        if self.control_mode == "pd_hand_poses":
            return Box(*self.hand_pose_actions.bounds)
        space = super().single_action_space
        assert isinstance(space, Box)
        return space

    @property
    def action_space(self) -> Box:  # pyright: ignore[reportIncompatibleMethodOverride]
        """The same space; there is one environment."""
        return self.single_action_space

    def set_action(self, action: torch.Tensor) -> None:
        """Set the targets of the drives: an action of the present control mode, shape (1, A)."""
        if self.control_mode == "pd_hand_poses":
            action = torch.from_numpy(self.read_targets(action[0].numpy()))[None]
        super().set_action(action.to(torch.float32))

    def read_targets(self, action: np.ndarray) -> np.ndarray:
        """Give the joint targets [rad], shape (..., D), of actions of a mode of joint targets."""
        if self.control_mode == "pd_hand_poses":
            return self.hand_pose_actions.to_joints(action)
        return action

    def make_action(self, targets: np.ndarray) -> np.ndarray:
        """Give the action, shape (..., A), of joint targets [rad], shape (..., D)."""
        if self.control_mode == "pd_hand_poses":
            return self.hand_pose_actions.from_joints(targets)
        return targets

    def read_joints(self) -> np.ndarray:
        """Read the joint positions [rad], shape (D,), float32, in the order of the model."""
        return self.robot.get_qpos()[0, self._from_articulation].numpy()

    def read_velocities(self) -> np.ndarray:
        """Read the joint velocities [rad/s], shape (D,), float32, in the order of the model."""
        return self.robot.get_qvel()[0, self._from_articulation].numpy()

    def read_hands(self) -> np.ndarray:
        """Read the poses of left and right `ee`: xyz [m] and wxyz, shape (2, 7), float32, world."""
        # past ManiSkill's tensors, which cost ten times as much
        poses = [link._objs[0].entity_pose for link in self._ee_links]  # noqa: SLF001
        return np.stack([np.concatenate([pose.p, pose.q]) for pose in poses])

    def set_joint_state(self, positions: np.ndarray) -> None:
        """Place the joints at rest; the drives keep the targets of the last action.

        Args:
            positions: Joint positions [rad], shape (D,), in the order of the model.
        """
        q = np.array(positions, dtype=np.float32)
        if q.shape != (self.model.dof,):
            raise ValueError(f"positions must have shape ({self.model.dof},); got {q.shape}")
        self.reset(torch.from_numpy(q)[self._to_articulation])


@lru_cache(maxsize=64)
def make_agent_class(
    *,
    robot: Robot = DEFAULT_ROBOT,
    left_base: BasePlacement = DEFAULT_LEFT_BASE,
    right_base: BasePlacement = DEFAULT_RIGHT_BASE,
) -> type[BimanualUR10eShadow]:
    """Make the agent class for a task's base placement, ManiSkill's `robot_uids`.

    Args:
        robot: Which arms and hands.
        left_base: Left base: x, y, z [m] and yaw [rad], world frame.
        right_base: Right base, likewise.

    Returns:
        A subclass of `BimanualUR10eShadow`; equal arguments give the same class.
    """
    return type(
        "BimanualUR10eShadow",
        (BimanualUR10eShadow,),
        {
            "model": robot,
            "left_base": left_base,
            "right_base": right_base,
            "__doc__": BimanualUR10eShadow.__doc__,
        },
    )


def let_robot_through(actor: Actor) -> None:
    """Mark an object that no link of the robot touches."""
    for bit in SIDE_COLLISION_BITS.values():
        actor.set_collision_group_bit(2, bit, 1)


def let_robot_pass(actor: Actor) -> None:
    """Mark a ground or an object that only palms and fingers touch."""
    actor.set_collision_group_bit(2, GROUND_COLLISION_BIT, 1)
