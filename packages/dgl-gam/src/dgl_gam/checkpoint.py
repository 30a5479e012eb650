"""Trained networks as files: safetensors, with the configuration in their metadata."""

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import torch
from annotated_types import Interval
from safetensors.numpy import save_file

from dgl_files.fields import check_value, decode_json, show, tell
from dgl_gam._tensor_file import SEALED, open_arrays, seal
from dgl_gam.confidence import Calibration
from dgl_gam.config import NetworkConfig
from dgl_gam.errors import CheckpointError
from dgl_gam.network import GarmentNetwork

__all__ = ["Checkpoint", "load_checkpoint", "save_checkpoint"]

FORMAT = "dgl_gam.network"
MAX_BYTES = 2**30
"""Of the weights in a file."""
_CARD: Mapping[str, Any] = {
    "train": dict[str, Any],
    "earlier": list[dict[str, Any]],
    "steps_done": Annotated[int, Interval(ge=0, le=2**40)],
    "garments": Annotated[int, Interval(ge=0, le=2**40)],
    "deformed": Annotated[int, Interval(ge=0, le=2**40)],
    "states": list[str],
    "generators": list[str],
    "categories": list[str],
    "versions": dict[str, str],
}
"""Fields of the card that a training writes; none of them must be there."""


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
    arrays = {name: t.detach().cpu().to(dtype).contiguous().numpy() for name, t in state.items()}
    metadata = {
        "format": FORMAT,
        "version": SEALED,
        "network": checkpoint.network.config.to_json(),
        "calibration": checkpoint.calibration.to_json(),
        "card": json.dumps(dict(checkpoint.card), allow_nan=False),
    }
    path.parent.mkdir(parents=True, exist_ok=True)
    beside = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        save_file(arrays, beside, metadata=seal(metadata, arrays))
        beside.replace(path)
    finally:
        beside.unlink(missing_ok=True)


def load_checkpoint(path: Path) -> Checkpoint:
    """Read a network.

    Its configuration is checked, and compared with the shapes of the weights, before any of these is read.

    Raises:
        CheckpointError: If the file is missing, damaged, of another format, or does not fit its own configuration.
    """
    path = Path(path)
    with open_arrays(path, what="a network", error=CheckpointError) as file:
        found_format = file.metadata.get("format")
        if found_format != FORMAT:
            raise CheckpointError(
                f"{path} is no network of dgl_gam: its format must be {FORMAT!r}; "
                f"got {show(found_format)}"
            )
        file.check_version("version")
        try:
            config = NetworkConfig.from_json(file.metadata["network"])
            calibration = Calibration.from_json(file.metadata["calibration"])
            card = _read_card(file.metadata["card"])
        except KeyError as err:
            raise CheckpointError(f"{path}: its metadata are damaged: they lack {err}") from err
        except ValueError as err:
            raise CheckpointError(f"{path}: its metadata are damaged: {err}") from err
        with torch.device("meta"):  # Whatever sizes it claims, nothing is allocated.
            wanted = GarmentNetwork(config).state_dict()
        shapes = {name: shape for name, (shape, _) in file.found.items()}
        differing = sorted(set(wanted) ^ set(shapes)) or sorted(
            name for name in wanted if tuple(wanted[name].shape) != shapes[name]
        )
        if differing:
            raise CheckpointError(
                f"{path}: its tensors do not fit its configuration: {', '.join(map(tell, differing[:4]))}"
            )
        file.check_types(("F16", "F32"), max_bytes=MAX_BYTES)
        state = {name: torch.from_numpy(array) for name, array in file.read().items()}
    bad = sorted(name for name, t in state.items() if not torch.isfinite(t).all())
    if bad:
        raise CheckpointError(f"{path}: its tensors must be finite; not so: {', '.join(bad[:4])}")
    network = GarmentNetwork(config)
    network.load_state_dict({name: t.to(torch.float32) for name, t in state.items()})
    network.eval()
    return Checkpoint(network=network, calibration=calibration, card=card)


def _read_card(text: str) -> dict[str, Any]:
    """Check the fields that a training writes, where they are there; others may be of any kind."""
    card = decode_json(text)
    if not isinstance(card, dict):
        raise ValueError(f"a card must be an object; got {show(card)}")
    for name, hint in _CARD.items():
        if name in card:
            check_value(f"card.{name}", card[name], hint)
    for part in (*card.get("earlier", []), card):
        check_value("card.train", part.get("train", {}), dict[str, Any])
        for each in (part, part.get("train", {})):
            check_value("card.parts", each.get("parts", "all"), str)
    return card
