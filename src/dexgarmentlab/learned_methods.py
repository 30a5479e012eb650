"""HALO, its ablations and the baselines: policies from their checkpoints, one for each stage."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dexgarmentlab.primitives import PrimitiveMethod
from dgl_collect.attempt import Attempts
from dgl_collect.demonstration import load_demonstration
from dgl_collect.evaluation.methods import LearnedMethod, make_evaluation_attempts
from dgl_collect.options import EvaluationOptions
from dgl_collect.policy_actor import Learned, PolicyActor
from dgl_collect.stage_runner import StageRunner
from dgl_sadp import PolicyConfig, PolicyRunner, load_policy, read_card

if TYPE_CHECKING:
    from dgl_collect.setup import Setup
    from dgl_tasks.declaration import Task

__all__ = ["FACTORY", "METHODS", "CheckpointMethod", "count_chunks", "make_evaluation_runner"]

FACTORY = "dexgarmentlab.learned_methods:make_evaluation_runner"
"""Builds the attempts of an evaluation in each worker; see `CollectConfig.attempt_factory`."""
POLICY_FILE = "policy.safetensors"


@dataclass(frozen=True, kw_only=True)
class CheckpointMethod:
    """A method of trained policies; implements `dgl_collect.evaluation.methods.LearnedMethod`."""

    policies: tuple[str, ...]
    """Methods of `dgl train` whose policies it takes."""
    use_gam: bool
    """Hands are sent to matched points first; otherwise the policy begins at the parked arms."""

    def check(self, task: "Task", options: EvaluationOptions) -> None:
        """Check, without loading weights, that there is a fitting policy for each learned stage.

        Raises:
            ValueError: If a policy is missing, of another stage, task, start or cloud.
            CheckpointError: If a file is damaged.
        """
        if options.checkpoints is None:
            raise ValueError(
                f"--policy {options.policy} needs --checkpoints, a folder of trained policies"
            )
        for number, _, path in _locate(task, options):
            if not path.is_file():
                raise ValueError(f"--checkpoints must hold a policy for stage {number}; no {path}")
            card = read_card(path)
            if card.get("stage", number) != number:
                raise ValueError(f"{path}: it must be of stage {number}; got {card['stage']}")
            tasks = card.get("tasks", [task.id])
            if task.id not in tasks:
                raise ValueError(f"{path}: it must be of task {task.id}; got {', '.join(tasks)}")
            if (cloud := card.get("cloud", "segmented")) != options.cloud:
                raise ValueError(
                    f"{path}: its training saw {cloud} clouds; evaluate it with --cloud {cloud}; "
                    f"got --cloud {options.cloud}"
                )
            if card.get("training", {}).get("with_approach", False) is self.use_gam:
                wanted, got = ("--gam", "--no-gam") if self.use_gam else ("--no-gam", "--gam")
                raise ValueError(f"{path}: it must be trained with {wanted}; got one of {got}")

    def make(self, setup: "Setup", options: EvaluationOptions) -> StageRunner:
        """Make the method; raises as `load` does."""
        return setup.make_runner(self.load(setup.env.task, options))

    def load(self, task: "Task", options: EvaluationOptions) -> PolicyActor:
        """Load a policy for each learned stage.

        Raises:
            ValueError: If a policy is of another method, stage or task.
            CheckpointError: If a policy is missing or damaged.
        """
        self.check(task, options)
        policies = {}
        for _, name, path in _locate(task, options):
            policy = load_policy(path, device=options.device)
            if policy.config.method not in self.policies:
                raise ValueError(
                    f"{path}: {options.policy} takes a policy of {' or '.join(self.policies)}; "
                    f"got {policy.config.method}"
                )
            chunks = options.chunks or count_chunks(policy.config, read_card(path))
            policies[name] = Learned(policy=PolicyRunner(policy), chunks=chunks)
        return PolicyActor(policies=policies, is_sent=self.use_gam)


METHODS: Mapping[str, LearnedMethod] = {
    "halo": CheckpointMethod(policies=("sadp", "sadp-g"), use_gam=True),
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


def count_chunks(config: PolicyConfig, card: Mapping[str, Any]) -> int:
    """Count the predictions of a stage that cover the longest recording; a policy then stays there.

    Args:
        config: The policy's.
        card: Its training card.

    Raises:
        ValueError: If the card does not tell the length of recordings.
    """
    frames = card.get("longest")
    if not isinstance(frames, int):
        raise ValueError(f"the policy's card must tell the longest recording; got {frames}")
    return math.ceil(frames / config.action_steps)


def _locate(task: "Task", options: EvaluationOptions) -> Iterator[tuple[int, str, Path]]:
    """Give number, name and checkpoint of each learned stage."""
    assert options.checkpoints is not None
    stages = load_demonstration(task, options.demonstration).learned_stages
    for number, stage in enumerate(stages, start=1):
        yield number, stage.name, options.checkpoints / f"stage_{number}" / POLICY_FILE
