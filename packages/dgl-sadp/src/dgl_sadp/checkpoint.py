"""Policies as files: safetensors, with the configuration and how it was made as JSON."""

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch

from dgl_sadp._tensor_file import read_header, read_tensors, write_tensors
from dgl_sadp.config import PolicyConfig, from_plain
from dgl_sadp.errors import CheckpointError
from dgl_sadp.policy import DiffusionPolicy

__all__ = ["load_policy", "read_card", "save_policy"]

_KIND = "dgl_sadp.policy"


def save_policy(
    path: str | Path, policy: DiffusionPolicy, card: Mapping[str, Any] | None = None
) -> None:
    """Write a policy with its normalisers: beside its place, then renamed.

    Args:
        path: The file, ending in .safetensors; its folder is made.
        policy: What to write.
        card: How it was made: task, stage, data, epochs, seed, versions. Plain values.

    Raises:
        ValueError: If the path has another ending.
    """
    values = {"policy": dataclasses.asdict(policy.config), "card": dict(card or {})}
    write_tensors(Path(path), policy.state_dict(), kind=_KIND, values=values)


def load_policy(path: str | Path, *, device: str | torch.device = "cpu") -> DiffusionPolicy:
    """Read a policy, in evaluation mode.

    Raises:
        CheckpointError: If the file is missing, damaged, of another format, or does not fit its own configuration.
    """
    path = Path(path)
    found, values = read_tensors(path, kind=_KIND)
    try:
        config = from_plain(PolicyConfig, values.get("policy"))
    except ValueError as err:
        raise CheckpointError(f"{path}: its configuration is wrong: {err}") from err
    policy = DiffusionPolicy.make(config, seed=0)
    wanted = policy.state_dict()
    differing = sorted(set(wanted) ^ set(found)) or sorted(
        name for name in wanted if wanted[name].shape != found[name].shape
    )
    if differing:
        raise CheckpointError(
            f"{path}: its tensors do not fit its configuration: {', '.join(differing[:4])}"
        )
    bad = sorted(name for name, tensor in found.items() if not torch.isfinite(tensor).all())
    if bad:
        raise CheckpointError(f"{path}: its tensors must be finite; not so: {', '.join(bad[:4])}")
    policy.load_state_dict(found)
    return policy.to(device).eval()


def read_card(path: str | Path) -> dict[str, Any]:
    """Read how a policy was made, without its weights.

    Raises:
        CheckpointError: If the file is no whole policy.
    """
    card = read_header(Path(path), kind=_KIND).get("card")
    if not isinstance(card, dict):
        raise CheckpointError(f"{path}: it has no card")
    return card
