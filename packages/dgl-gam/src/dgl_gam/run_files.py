"""The files of a training's folder: its configuration, its log, and the state that it goes on from."""

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import Tensor

from dgl_gam.errors import CheckpointError

__all__ = ["CONFIG_FILE", "LOG_FILE", "begin_run", "save_state", "write_whole"]

CONFIG_FILE = "config.json"
LOG_FILE = "log.jsonl"
STATE_FILE = "state.safetensors"
_FORMAT = "dgl_gam.training"


def begin_run(
    out: Path,
    described: Mapping[str, Any],
    parameters: Mapping[str, Tensor],
    optimizer: torch.optim.Optimizer,
    *,
    is_resumed: bool,
) -> int:
    """Make a run's folder, or put back what the run in it has learned; returns the steps done.

    Raises:
        CheckpointError: If there is nothing to resume, or the run was begun as another.
    """
    if not is_resumed:
        out.mkdir(parents=True, exist_ok=True)
        write_whole(out / CONFIG_FILE, json.dumps(described, indent=1))
        return 0
    if not (out / CONFIG_FILE).exists():
        raise CheckpointError(f"{out} holds no run to resume")
    try:
        before = json.loads((out / CONFIG_FILE).read_text(encoding="utf-8"))
    except ValueError as err:
        raise CheckpointError(f"{out / CONFIG_FILE} cannot be read: {err}") from err
    _compare(out, before, described)
    done = 0
    if (out / STATE_FILE).exists():  # or else it was interrupted before its first state
        done = _load_state(out / STATE_FILE, described, parameters, optimizer)
    _trim_log(out / LOG_FILE, done)
    return done


def save_state(
    out: Path,
    described: Mapping[str, Any],
    parameters: Mapping[str, Tensor],
    optimizer: torch.optim.Optimizer,
    step: int,
) -> None:
    """Save weights and moments beside the state that there is, then rename."""
    path = out / STATE_FILE
    tensors = {}
    for name, parameter in parameters.items():
        tensors[f"weight/{name}"] = parameter.detach().cpu().contiguous()
        for key in ("exp_avg", "exp_avg_sq", "step"):
            if parameter in optimizer.state:
                tensors[f"{key}/{name}"] = optimizer.state[parameter][key].cpu().contiguous()
    beside = path.with_name(f".{path.name}.{os.getpid()}.part")
    meta = {"format": _FORMAT, "step": str(step), "described": json.dumps(described)}
    save_file(tensors, beside, metadata=meta)
    beside.replace(path)


def _load_state(
    path: Path,
    described: Mapping[str, Any],
    parameters: Mapping[str, Tensor],
    optimizer: torch.optim.Optimizer,
) -> int:
    """Put weights and moments back; returns the steps done."""
    try:
        with safe_open(path, framework="pt") as file:
            meta = file.metadata() or {}
            # Cloned: the file is mapped, and will be replaced while these are in use.
            tensors = {name: file.get_tensor(name).clone() for name in file.keys()}  # noqa: SIM118
    except (OSError, SafetensorError) as err:
        raise CheckpointError(f"{path} cannot be read: {err}") from err
    if meta.get("format") != _FORMAT:
        raise CheckpointError(f"{path} is no state of a training; got {meta.get('format')!r}")
    _compare(path.parent, json.loads(meta["described"]), described)
    wanted = {f"weight/{name}" for name in parameters}
    if not wanted <= set(tensors):
        raise CheckpointError(f"{path} lacks weights of the network")
    for name, parameter in parameters.items():
        with torch.no_grad():
            parameter.copy_(tensors[f"weight/{name}"])
        if f"exp_avg/{name}" in tensors:
            optimizer.state[parameter] = {
                key: tensors[f"{key}/{name}"].to("cpu" if key == "step" else parameter.device)
                for key in ("step", "exp_avg", "exp_avg_sq")
            }
    return int(meta["step"])


def _compare(out: Path, before: Any, described: Mapping[str, Any]) -> None:
    """Refuse to go on with a run as another one."""
    now = json.loads(json.dumps(described))
    for part in now:
        if not isinstance(before, dict) or before.get(part) != now[part]:
            raise CheckpointError(
                f"{out} was begun with another {part}; resume it with the same, or start anew"
            )


def _trim_log(path: Path, step: int) -> None:
    """Keep the lines of the steps that are not done again."""
    if path.exists():
        lines = path.read_text(encoding="utf-8").splitlines()
        write_whole(path, "".join(line + "\n" for line in lines[:step]))


def write_whole(path: Path, text: str) -> None:
    """Write a text file beside its place, then rename it."""
    beside = path.with_name(f".{path.name}.{os.getpid()}.part")
    beside.write_text(text, encoding="utf-8")
    beside.replace(path)
