"""Policies of joint targets, and methods, which also use the environment's controller."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from dgl_assets.robots import Robot
from dgl_tasks.errors import PolicyError
from dgl_tasks.hand_span import HandPoseActions
from dgl_tasks.handling import Handling
from dgl_tasks.inputs import JointControlMode
from dgl_tasks.messages import Part
from dgl_tasks.sensing import SENSOR_CAMERAS

Arrays = Mapping[str, np.ndarray]


@runtime_checkable
class Policy(Protocol):
    """Maps observations to joint targets; anything with these two methods can be evaluated.

    Observations are dictionaries with the keys and shapes of one frame of an episode file:
    `joint_state` (D,), `ee_pose` (2, 7), `image` (480, 640, 3) and `env_point_cloud` (2048, 6).
    """

    def reset(self, observation: Arrays) -> None:
        """Begin an episode; the first observation also has `garment_point_cloud` (2048, 3)."""
        ...

    def act(self, observation: Arrays) -> np.ndarray:
        """Give the next actions, shape (n, A), each carried out within five control steps.

        They are those of the control mode: by default joint targets [rad]. None at all, n = 0, ends
        the episode.
        """
        ...


@runtime_checkable
class ObservingPolicy(Policy, Protocol):
    """A policy that also takes the observations between two calls of `act`."""

    def observe(self, observation: Arrays) -> None:
        """Take the observation after each executed target but the last, which goes to `act`."""
        ...


@runtime_checkable
class Method(Protocol):
    """Acts in a whole episode, with the environment's controller for scripted parts."""

    def run(self, hands: Handling) -> Part:
        """Act from the parked arms on; at the end, arms that are not parked retreat and park."""
        ...


class Nothing:
    """Leaves the garment as it fell; success rules must not accept that."""

    def run(self, hands: Handling) -> Part:
        """Do nothing."""
        del hands
        yield from ()


@dataclass(frozen=True, kw_only=True)
class FromStart:
    """Lets a policy act from the parked arms on."""

    policy: Policy
    """Gives the actions."""
    actions: int
    """Largest number of actions; at least 1."""
    control_mode: JointControlMode = "pd_joint_pos"
    """Kind of the actions."""

    def __post_init__(self) -> None:
        if self.actions < 1:
            raise ValueError(f"actions must be at least 1; got {self.actions}")

    def run(self, hands: Handling) -> Part:
        """Observe, act, and execute until the policy ends the episode or no action is left."""
        sensed = yield from hands.look(*SENSOR_CAMERAS)
        seen = sensed.observe().as_arrays()
        self.policy.reset({**seen, "garment_point_cloud": sensed.see_garment()})
        left = self.actions
        while left > 0:
            actions = np.asarray(self.policy.act(seen))[:left]
            targets = read_actions(actions, hands.motion.robot, self.control_mode)
            if len(targets) == 0:
                return
            left -= len(targets)
            for number, target in enumerate(targets, start=1):
                yield from hands.execute(target[None])
                seen = (yield from hands.observe()).as_arrays()
                if number < len(targets) and isinstance(self.policy, ObservingPolicy):
                    self.policy.observe(seen)


def read_actions(actions: np.ndarray, robot: Robot, mode: JointControlMode) -> np.ndarray:
    """Give the joint targets [rad], shape (n, D), of actions of a control mode, shape (n, A).

    Raises:
        PolicyError: If actions of `pd_hand_poses` have another shape; those of joints are checked
            where they are carried out.
    """
    if mode == "pd_joint_pos" or len(actions) == 0:
        return actions
    converter = HandPoseActions(robot)
    wanted = len(converter.names)
    if actions.ndim != 2 or actions.shape[1] != wanted:
        raise PolicyError(f"actions must have shape (N, {wanted}); got {actions.shape}")
    return converter.to_joints(actions)
