"""Trained networks as files: safetensors, with the configuration in their metadata."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import torch
from annotated_types import Interval

from dgl_files.fields import check_value, decode_json, show
from dgl_files.tensors import open_tensors, write_tensors
from dgl_gam.confidence import Calibration
from dgl_gam.config import NetworkConfig
from dgl_gam.errors import GamCheckpointError
from dgl_gam.network import GarmentNetwork

__all__ = ["Checkpoint", "load_checkpoint", "save_checkpoint"]

FORMAT, VERSION = "dgl_gam.network", "2"
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
    """Data, steps, seed and versions of the training. Plain values."""


def save_checkpoint(path: Path, checkpoint: Checkpoint, *, is_half: bool = False) -> None:
    """Write a network; the file appears whole.

    Args:
        path: The file, ending in .safetensors; its folder is made.
        checkpoint: What to write.
        is_half: Whether to store 16-bit floats, which halves the file.
    """
    dtype = torch.float16 if is_half else torch.float32
    state = checkpoint.network.state_dict()
    arrays = {name: t.detach().cpu().to(dtype).contiguous().numpy() for name, t in state.items()}
    metadata = {
        "format": FORMAT,
        "version": VERSION,
        "network": checkpoint.network.config.to_json(),
        "calibration": checkpoint.calibration.to_json(),
        "card": json.dumps(dict(checkpoint.card), allow_nan=False),
    }
    write_tensors(Path(path), arrays, metadata)


def load_checkpoint(path: Path) -> Checkpoint:
    """Read a network.

    Its configuration is checked, and compared with the shapes of the weights, before any of these
    is read.

    Raises:
        GamCheckpointError: If the file is missing, damaged, of another format, or does not fit its
            own configuration.
    """
    path = Path(path)
    with open_tensors(path, what="a network of dgl_gam", error=GamCheckpointError) as file:
        file.check_format(FORMAT)
        file.check_version(wanted=VERSION, earlier=("1",))
        try:
            config = NetworkConfig.from_json(file.metadata["network"])
            calibration = Calibration.from_json(file.metadata["calibration"])
            card = _read_card(file.metadata["card"])
        except KeyError as err:
            raise GamCheckpointError(f"{path}: its metadata are damaged: they lack {err}") from err
        except ValueError as err:
            raise GamCheckpointError(f"{path}: its metadata are damaged: {err}") from err
        with torch.device("meta"):  # Whatever sizes it claims, nothing is allocated.
            wanted = GarmentNetwork(config).state_dict()
        file.check_shapes({name: tuple(tensor.shape) for name, tensor in wanted.items()})
        file.check_types(("F16", "F32"), max_bytes=MAX_BYTES)
        state = {n: torch.from_numpy(array) for n, array in file.read(is_finite=True).items()}
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
