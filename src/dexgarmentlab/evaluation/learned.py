"""HALO, its ablations and the baselines: policies from their checkpoints, by stage."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dgl_collect.demonstration import load_demonstration
from dgl_collect.policy_actor import Learned, PolicyActor
from dgl_sadp import PolicyConfig, PolicyRunner, load_policy, read_card

if TYPE_CHECKING:
    from dgl_tasks.declaration import Task

__all__ = ["METHODS", "LearnedMethod", "check_checkpoints", "count_chunks", "load_actor"]

POLICY_FILE = "policy.safetensors"


@dataclass(frozen=True, kw_only=True)
class LearnedMethod:
    """Which policies a method takes, and whether they begin at the matched points."""

    policies: tuple[str, ...]
    """Methods of `dgl train` whose policies it takes."""
    use_gam: bool
    """Whether points are matched and the hands sent there; otherwise the policy finds its way from the parked arms."""


METHODS: Mapping[str, LearnedMethod] = {
    "halo": LearnedMethod(policies=("sadp", "sadp-g"), use_gam=True),
    "sadp": LearnedMethod(policies=("sadp", "sadp-g"), use_gam=False),
    "gam-dp3": LearnedMethod(policies=("dp3",), use_gam=True),
    "dp3": LearnedMethod(policies=("dp3",), use_gam=False),
    "dp": LearnedMethod(policies=("dp",), use_gam=False),
}
"""HALO; without GAM; without SADP; and the baselines."""


def load_actor(
    name: str, task: "Task", checkpoints: Path, *, chunks: int | None = None, device: str = "cpu"
) -> PolicyActor:
    """Load a policy for each stage that is learned.

    Args:
        name: One of `METHODS`.
        task: What is to be done.
        checkpoints: Folder with `stage_<k>/policy.safetensors` for each learned stage.
        chunks: Predictions that each stage gets; as long as the longest recorded stage when None.
        device: "cpu" or "cuda".

    Raises:
        ValueError: If a policy is of another method, stage or task.
        CheckpointError: If a policy is missing or damaged.
    """
    method = METHODS[name]
    check_checkpoints(task, checkpoints, use_gam=method.use_gam)
    policies = {}
    for number, stage in enumerate(load_demonstration(task.id).learned_stages, start=1):
        path = _locate(checkpoints, number)
        policy = load_policy(path, device=device)
        if policy.config.method not in method.policies:
            raise ValueError(
                f"{path}: {name} takes a policy of {' or '.join(method.policies)}; "
                f"got {policy.config.method}"
            )
        count = chunks or count_chunks(policy.config, read_card(path))
        policies[stage.name] = Learned(policy=PolicyRunner(policy), chunks=count)
    return PolicyActor(policies=policies, is_sent=method.use_gam)


def check_checkpoints(task: "Task", checkpoints: Path, *, use_gam: bool) -> None:
    """Check, without loading weights, that there is a fitting policy for each learned stage.

    Args:
        task: What is to be done.
        checkpoints: Folder with `stage_<k>/policy.safetensors`.
        use_gam: Whether the hands are sent to matched points first; a policy has learned the way there only where they
            are not.

    Raises:
        ValueError: If a policy is missing, of another stage or task, or begins elsewhere.
        CheckpointError: If a file is damaged.
    """
    for number in range(1, len(load_demonstration(task.id).learned_stages) + 1):
        path = _locate(checkpoints, number)
        if not path.is_file():
            raise ValueError(f"--checkpoints must hold a policy for stage {number}; no {path}")
        card = read_card(path)
        if card.get("stage", number) != number:
            raise ValueError(f"{path}: it must be of stage {number}; got {card['stage']}")
        tasks = card.get("tasks", [task.id])
        if task.id not in tasks:
            raise ValueError(f"{path}: it must be of task {task.id}; got {', '.join(tasks)}")
        if card.get("training", {}).get("with_approach", False) is use_gam:
            wanted, got = ("--gam", "--no-gam") if use_gam else ("--no-gam", "--gam")
            raise ValueError(f"{path}: it must be trained with {wanted}; got one of {got}")


def count_chunks(config: PolicyConfig, card: Mapping[str, Any]) -> int:
    """Say how many predictions a stage gets: enough for the longest recording; a policy stays where it has ended.

    Args:
        config: The policy's.
        card: How it was trained.

    Raises:
        ValueError: If the card does not tell how long recordings were.
    """
    frames = card.get("longest")
    if not isinstance(frames, int):
        raise ValueError(f"the policy's card must tell the longest recording; got {frames}")
    return math.ceil(frames / config.action_steps)


def _locate(checkpoints: Path, number: int) -> Path:
    return checkpoints / f"stage_{number}" / POLICY_FILE
