"""Policies as files: safetensors, with the configuration and how it was made as JSON."""

import dataclasses
from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import Annotated, Any

import torch
from annotated_types import Interval, Len

from dgl_files.fields import check_value, from_plain
from dgl_sadp._values_file import check_shapes, open_values, read_tensors, write_values
from dgl_sadp.config import PolicyConfig
from dgl_sadp.errors import CheckpointError
from dgl_sadp.policy import DiffusionPolicy

__all__ = ["POLICY_FILE", "find_policy", "load_policy", "read_card", "save_policy"]

POLICY_FILE = "policy.safetensors"
"""Name of the file in the folder of a training."""
MAX_WEIGHTS = 2**29
"""Of a policy: twice as many as the largest preset has; 2 GiB."""

_KIND = "dgl_sadp.policy"
_CARD: Mapping[str, Any] = {
    "tasks": Annotated[list[Annotated[str, Len(0, 200)]], Len(1, 1000)],
    "cloud": Annotated[str, Len(0, 200)],
    "windows": Annotated[int, Interval(ge=1, le=2**40)],
    "longest": Annotated[list[Annotated[int, Interval(ge=1, le=10**6)]], Len(1, 1000)],
    "episodes": list[str],
    "validation_episodes": list[str],
    "training": dict[str, Any],
    "epochs_done": Annotated[int, Interval(ge=0, le=2**40)],
    "steps_done": Annotated[int, Interval(ge=0, le=2**40)],
    "loss": float,
    "validation": dict[str, float] | None,
    "versions": dict[str, str],
    "measured": Annotated[str, Len(1, 1000)],
    "license": Annotated[str, Len(1, 200)],
}
"""Fields of the card that are read; none of them must be there."""


def save_policy(
    path: str | Path,
    policy: DiffusionPolicy,
    card: Mapping[str, Any] | None = None,
    *,
    is_half: bool = False,
) -> None:
    """Write a policy with its normalisers: beside its place, then renamed.

    Args:
        path: The file, ending in .safetensors; its folder is made.
        policy: What to write.
        card: How it was made: task, data, epochs, seed, versions. Plain values.
        is_half: Write the weights in 16 bits (float16). Ranges of the data stay in 32.

    Raises:
        ValueError: If the path has another ending, or a weight does not fit into 16 bits.
    """
    state = policy.state_dict()
    if is_half:
        for name, _ in policy.named_parameters():
            state[name] = state[name].half()
            if not state[name].isfinite().all():
                raise ValueError(f"{name} must lie within the range of float16")
    values = {"policy": dataclasses.asdict(policy.config), "card": dict(card or {})}
    write_values(Path(path), state, kind=_KIND, values=values)


def load_policy(path: str | Path, *, device: str | torch.device = "cpu") -> DiffusionPolicy:
    """Read a policy, in evaluation mode.

    Its configuration is checked, and compared with the shapes of the tensors, before any of them is
    read.

    Args:
        path: The file, or the folder of a training.
        device: Where its weights go.

    Raises:
        CheckpointError: If the file is missing, damaged, of another format, or does not fit its own
            configuration.
    """
    path = _find_file(Path(path))
    with open_values(path, kind=_KIND) as (file, values):
        _read_card(path, values)
        try:
            config = from_plain(PolicyConfig, values.get("policy"))
        except ValueError as err:
            raise CheckpointError(f"{path}: its configuration is wrong: {err}") from err
        with torch.device("meta"):  # Whatever sizes it claims, nothing is allocated.
            wanted = DiffusionPolicy(config).state_dict()
        count = sum(tensor.numel() for tensor in wanted.values())
        if count > MAX_WEIGHTS:
            raise CheckpointError(
                f"{path}: it must have at most {MAX_WEIGHTS} weights; got {count}"
            )
        check_shapes(file, wanted)
        found = read_tensors(file)
        policy = DiffusionPolicy.make(config, seed=0)
        policy.load_state_dict(found)
    return policy.to(device).eval()


def read_card(path: str | Path) -> dict[str, Any]:
    """Read how a policy was made, without its weights.

    Args:
        path: The file, or the folder of a training.

    Raises:
        CheckpointError: If the file is no whole policy, or a field of the card is of a wrong type.
    """
    path = _find_file(Path(path))
    with open_values(path, kind=_KIND) as (_, values):
        return _read_card(path, values)


def find_policy(task: str) -> Path:
    """Find the policy of a task that comes with this package.

    Raises:
        CheckpointError: If there is none; the message tells how to make one.
    """
    path = Path(
        str(resources.files("dgl_sadp") / "policies" / f"{task.partition('-')[0]}.safetensors")
    )
    if not path.is_file():
        raise CheckpointError(
            f"no policy of {task} comes with this package; collect episodes with `dgl collect "
            f"{task} --matcher gam --episodes 104 --out DIR`, and train one with `dgl train sadp-g "
            f"--data DIR/episodes --out RUN`, for --checkpoints RUN"
        )
    return path


def _find_file(path: Path) -> Path:
    return path / POLICY_FILE if path.is_dir() else path


def _read_card(path: Path, values: Mapping[str, Any]) -> dict[str, Any]:
    """Check the fields that are read, where they are there; others may be of any kind."""
    card = values.get("card")
    if not isinstance(card, dict):
        raise CheckpointError(f"{path}: it has no card")
    try:
        for name, hint in _CARD.items():
            if name in card:
                check_value(f"card.{name}", card[name], hint)
        training = card.get("training", {})
        if "with_approach" in training:
            check_value("card.training.with_approach", training["with_approach"], bool)
    except ValueError as err:
        raise CheckpointError(f"{path}: {err}") from err
    return card
