"""HALO, its ablations and the baselines: a policy from its checkpoint for all stages."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dexgarmentlab.primitives import PrimitiveMethod
from dgl_assets.robots import DEFAULT_ROBOT
from dgl_assets.robots.importing import load_robot
from dgl_collect.attempt import Attempts
from dgl_collect.demonstration import load_demonstration
from dgl_collect.episodes import DEFAULT_CLOUD
from dgl_collect.evaluation.methods import make_evaluation_attempts
from dgl_collect.options import EvaluationOptions
from dgl_collect.policy_actor import Learned, PolicyActor
from dgl_collect.remote import ServedStages
from dgl_collect.stage_runner import StageRunner
from dgl_sadp import DiffusionPolicy, PolicyRunner, find_policy, load_policy, read_card

if TYPE_CHECKING:
    from dgl_collect.setup import Setup
    from dgl_collect.steps import Demonstration
    from dgl_tasks.declaration import Task

__all__ = [
    "FACTORY",
    "METHODS",
    "CheckpointMethod",
    "check_card",
    "make_actor",
    "make_evaluation_runner",
]

FACTORY = "dexgarmentlab.learned_methods:make_evaluation_runner"
"""Builds the attempts of an evaluation in each worker; see `CollectConfig.attempt_factory`."""


@dataclass(frozen=True, kw_only=True)
class CheckpointMethod:
    """A method of a trained policy; implements `dgl_collect.evaluation.methods.LearnedMethod`."""

    policies: tuple[str, ...]
    """Methods of `dgl train` whose policies it takes."""
    use_gam: bool
    """Hands are sent to matched points first; otherwise the policy begins at the parked arms."""
    is_shipped: bool = False
    """Takes what comes with `dgl_sadp` where no checkpoints are named."""

    def check(self, task: "Task", options: EvaluationOptions) -> None:
        """Check, without loading weights, that there is a fitting policy.

        Raises:
            ValueError: If it is missing, or `check_card` refuses it.
            CheckpointError: If the file is damaged.
        """
        path = self._locate(task, options)
        card = read_card(path)
        demonstration = load_demonstration(task, options.demonstration)
        robot = load_robot(options.robot, options.robots).name
        try:
            check_card(card, demonstration, robot=robot, cloud=options.cloud, is_sent=self.use_gam)
        except ValueError as err:
            raise ValueError(f"{path}: {err}") from err

    def make(self, setup: "Setup", options: EvaluationOptions) -> StageRunner:
        """Make the method; raises as `load` does."""
        return setup.make_runner(self.load(setup.env.task, options))

    def load(self, task: "Task", options: EvaluationOptions) -> PolicyActor:
        """Load the policy, once for all stages; raises as `prepare` does."""
        return self.prepare(task, options)()

    def prepare(self, task: "Task", options: EvaluationOptions) -> Callable[[], PolicyActor]:
        """Load the policy; return a function that makes actors of it, each in a state of its own.

        Raises:
            ValueError: If it is of another method, or `check_card` refuses it.
            CheckpointError: If it is missing or damaged.
        """
        self.check(task, options)
        path = self._locate(task, options)
        policy = load_policy(path, device=options.device)
        if policy.config.method not in self.policies:
            raise ValueError(
                f"{path}: {options.policy} takes a policy of {' or '.join(self.policies)}; "
                f"got {policy.config.method}"
            )
        demonstration = load_demonstration(task, options.demonstration)
        card = read_card(path)
        return lambda: make_actor(
            policy, card, demonstration, is_sent=self.use_gam, chunks=options.chunks
        )

    def prepare_served(
        self, task: "Task", options: EvaluationOptions
    ) -> Callable[[], ServedStages]:
        """Load the policy for a policy server; raises as `prepare` does."""
        make = self.prepare(task, options)
        return lambda: ServedStages(
            policies=make().policies, task=task.id, cloud=options.cloud, is_sent=self.use_gam
        )

    def _locate(self, task: "Task", options: EvaluationOptions) -> Path:
        """Find the policy's file, or the folder of its training."""
        path = options.checkpoints
        if path is None and self.is_shipped:
            return find_policy(task.id)
        if path is None:
            raise ValueError(
                f"--policy {options.policy} needs --checkpoints, the folder of a trained policy"
            )
        return path


METHODS: Mapping[str, CheckpointMethod | PrimitiveMethod] = {
    "halo": CheckpointMethod(policies=("sadp", "sadp-g"), use_gam=True, is_shipped=True),
    "sadp": CheckpointMethod(policies=("sadp", "sadp-g"), use_gam=False),
    "gam-dp3": CheckpointMethod(policies=("dp3",), use_gam=True),
    "dp3": CheckpointMethod(policies=("dp3",), use_gam=False),
    "dp": CheckpointMethod(policies=("dp",), use_gam=False),
    "primitive": PrimitiveMethod(),
    "blind": PrimitiveMethod(is_blind=True),
}
"""HALO; without GAM; without SADP; the baselines; primitives, and their mean ways."""


def make_evaluation_runner(task: str, options: EvaluationOptions) -> Attempts:
    """Build the attempts of an evaluation; see `dgl_collect.CollectConfig.attempt_factory`."""
    return make_evaluation_attempts(task, options, METHODS)


def check_card(
    card: Mapping[str, Any],
    demonstration: "Demonstration",
    *,
    robot: str,
    cloud: str,
    is_sent: bool = True,
) -> None:
    """Compare how a policy was trained with what it is to do.

    Args:
        card: The policy's.
        demonstration: Its learned stages are those that the policy is to act in.
        robot: Name of the robot.
        cloud: Kind of the environment clouds.
        is_sent: Hands are sent to matched points first.

    Raises:
        ValueError: If it was trained on another task, other stages, another robot, start or cloud.
    """
    tasks = card.get("tasks", [demonstration.task])
    if demonstration.task not in tasks:
        raise ValueError(f"the policy must be of task {demonstration.task}; got {', '.join(tasks)}")
    stages, longest = demonstration.learned_stages, card.get("longest", ())
    if len(longest) != len(stages):
        raise ValueError(
            "the policy's card must tell the longest recording of each of the "
            f"{len(stages)} stages; got {list(longest)}"
        )
    if robot != DEFAULT_ROBOT.name:  # `dgl_sadp` trains on no other
        raise ValueError(f"policies are of the robot {DEFAULT_ROBOT.name}; got {robot}")
    if (seen := card.get("cloud", DEFAULT_CLOUD)) != cloud:
        raise ValueError(
            f"the policy must see {seen} clouds, as in its training: --cloud {seen}; got {cloud}"
        )
    if card.get("training", {}).get("with_approach", False) is is_sent:
        wanted, got = ("--gam", "--no-gam") if is_sent else ("--no-gam", "--gam")
        raise ValueError(f"the policy must be trained with {wanted}; got one of {got}")


def make_actor(
    policy: DiffusionPolicy,
    card: Mapping[str, Any],
    demonstration: "Demonstration",
    *,
    is_sent: bool = True,
    chunks: int | None = None,
) -> PolicyActor:
    """Make the actor of a policy in the stages of a demonstration that are learned.

    Args:
        policy: The policy.
        card: Its card, which fits; see `check_card`.
        demonstration: The demonstration.
        is_sent: Hands are sent to matched points first.
        chunks: Predictions in each stage; None for as many as cover its longest recording.
    """
    stages, longest = demonstration.learned_stages, card["longest"]
    return PolicyActor(
        policies={
            stage.name: Learned(
                policy=PolicyRunner(policy, stage=number),
                chunks=chunks or math.ceil(frames / policy.config.action_steps),
            )
            for number, (stage, frames) in enumerate(zip(stages, longest, strict=True), start=1)
        },
        is_sent=is_sent,
    )
