"""Trained networks as files: safetensors, with the configuration in their metadata."""

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file

from dgl_gam.confidence import Calibration
from dgl_gam.config import NetworkConfig
from dgl_gam.errors import CheckpointError
from dgl_gam.network import GarmentNetwork

__all__ = ["Checkpoint", "load_checkpoint", "save_checkpoint"]

FORMAT = "dgl_gam.network"
VERSION = "1"


@dataclass(frozen=True, kw_only=True, eq=False)
class Checkpoint:
    """A network with what is known about it."""

    network: GarmentNetwork
    """The network, float32, in evaluation mode."""
    calibration: Calibration = field(default_factory=Calibration)
    """From evidence to confidence."""
    card: Mapping[str, Any] = field(default_factory=dict)
    """How it was made: data, steps, seed, versions. Plain values."""


def save_checkpoint(path: Path, checkpoint: Checkpoint, *, is_half: bool = False) -> None:
    """Write a network: beside its place, then renamed.

    Args:
        path: The file, ending in .safetensors; its folder is made.
        checkpoint: What to write.
        is_half: Whether to store 16-bit floats, which halves the file.
    """
    path = Path(path)
    if path.suffix != ".safetensors":
        raise ValueError(f"path must end in .safetensors; got {path}")
    dtype = torch.float16 if is_half else torch.float32
    state = checkpoint.network.state_dict()
    tensors = {name: t.detach().cpu().to(dtype).contiguous() for name, t in state.items()}
    metadata = {
        "format": FORMAT,
        "version": VERSION,
        "network": checkpoint.network.config.to_json(),
        "calibration": checkpoint.calibration.to_json(),
        "card": json.dumps(dict(checkpoint.card)),
    }
    path.parent.mkdir(parents=True, exist_ok=True)
    beside = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        save_file(tensors, beside, metadata=metadata)
        beside.replace(path)
    finally:
        beside.unlink(missing_ok=True)


def load_checkpoint(path: Path) -> Checkpoint:
    """Read a network.

    Raises:
        CheckpointError: If the file is missing, damaged, of another format, or does not fit its own configuration.
    """
    path = Path(path)
    try:
        with safe_open(path, framework="pt") as file:
            metadata = file.metadata() or {}
            found = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    except (OSError, SafetensorError) as err:
        raise CheckpointError(f"{path} cannot be read as a network: {err}") from err
    if metadata.get("format") != FORMAT:
        raise CheckpointError(
            f"{path} is no network of dgl_gam: its format must be {FORMAT!r}; "
            f"got {metadata.get('format')!r}"
        )
    if metadata.get("version") != VERSION:
        raise CheckpointError(
            f"{path}: version must be {VERSION!r}; got {metadata.get('version')!r}"
        )
    try:
        config = NetworkConfig.from_json(metadata["network"])
        calibration = Calibration.from_json(metadata["calibration"])
        card = json.loads(metadata["card"])
        if not isinstance(card, dict):
            raise ValueError(f"a card must be an object; got {metadata['card'][:60]}")
        with torch.device("meta"):  # whatever sizes it claims, nothing is allocated
            wanted = GarmentNetwork(config).state_dict()
    except (KeyError, ValueError, TypeError, RuntimeError) as err:
        reason = " ".join(str(err).split())
        raise CheckpointError(f"{path}: its metadata are damaged: {reason}") from err
    differing = sorted(set(wanted) ^ set(found)) or sorted(
        name for name in wanted if wanted[name].shape != found[name].shape
    )
    if differing:
        raise CheckpointError(
            f"{path}: its tensors do not fit its configuration: {', '.join(differing[:4])}"
        )
    bad = sorted(name for name, t in found.items() if not torch.isfinite(t).all())
    if bad:
        raise CheckpointError(f"{path}: its tensors must be finite; not so: {', '.join(bad[:4])}")
    network = GarmentNetwork(config)
    network.load_state_dict({name: t.to(torch.float32) for name, t in found.items()})
    network.eval()
    return Checkpoint(network=network, calibration=calibration, card=card)
