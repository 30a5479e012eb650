"""Files of a training's folder: configuration, log and state."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import torch
from annotated_types import Interval
from torch import Tensor

from dgl_files.fields import check_value, decode_json
from dgl_files.tensors import TensorFile, open_tensors, write_tensors
from dgl_files.whole import write_text
from dgl_gam.errors import GamCheckpointError

__all__ = ["CONFIG_FILE", "LOG_FILE", "begin_run", "read_config", "save_state"]

CONFIG_FILE = "config.json"
LOG_FILE = "log.jsonl"
STATE_FILE = "state.safetensors"
_FORMAT, _VERSION = "dgl_gam.training", "2"
_MAX_BYTES = 2**32
_MOMENTS = ("exp_avg", "exp_avg_sq")


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
        GamCheckpointError: If there is nothing to resume, or the run was begun as another.
    """
    if not is_resumed:
        out.mkdir(parents=True, exist_ok=True)
        write_text(out / CONFIG_FILE, json.dumps(described, indent=1))
        return 0
    if not (out / CONFIG_FILE).exists():
        raise GamCheckpointError(f"{out} holds no run to resume")
    _compare(out, read_config(out), described)
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
    arrays = {}
    for name, parameter in parameters.items():
        arrays[f"weight/{name}"] = parameter.detach().cpu().contiguous().numpy()
        for key in (*_MOMENTS, "step"):
            if parameter in optimizer.state:
                moment = optimizer.state[parameter][key].detach().cpu().contiguous()
                arrays[f"{key}/{name}"] = moment.numpy()
    meta = {
        "format": _FORMAT,
        "version": _VERSION,
        "step": str(step),
        "described": json.dumps(described),
    }
    write_tensors(path, arrays, meta)


def read_config(out: Path) -> Any:
    """Read what a run was begun as.

    Raises:
        GamCheckpointError: If its file is damaged.
    """
    path = out / CONFIG_FILE
    try:
        return decode_json(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as err:
        raise GamCheckpointError(f"{path} cannot be read: {err}") from err


def _load_state(
    path: Path,
    described: Mapping[str, Any],
    parameters: Mapping[str, Tensor],
    optimizer: torch.optim.Optimizer,
) -> int:
    """Put weights and moments back; returns the steps done."""
    with open_tensors(path, what="a state of a training", error=GamCheckpointError) as file:
        file.check_format(_FORMAT)
        if "version" in file.metadata:  # The first states have none.
            file.check_version(wanted=_VERSION, earlier=("1",))
        try:
            before = decode_json(file.metadata.get("described", ""))
            step = decode_json(file.metadata.get("step", ""))
            check_value("step", step, Annotated[int, Interval(ge=0, le=2**40)])
        except ValueError as err:
            raise GamCheckpointError(f"{path}: its metadata are damaged: {err}") from err
        _compare(path.parent, before, described)
        _check_arrays(file, parameters)
        tensors = {name: torch.from_numpy(array) for name, array in file.read().items()}
    for name, parameter in parameters.items():
        with torch.no_grad():
            parameter.copy_(tensors[f"weight/{name}"])
        if f"exp_avg/{name}" in tensors:
            optimizer.state[parameter] = {
                key: tensors[f"{key}/{name}"].to("cpu" if key == "step" else parameter.device)
                for key in ("step", *_MOMENTS)
            }
    return step


def _check_arrays(file: TensorFile, parameters: Mapping[str, Tensor]) -> None:
    """Compare a state's arrays with the network's parameters, before any is read."""
    file.check_types(("F32",), max_bytes=_MAX_BYTES)
    for name, parameter in parameters.items():
        wanted = {f"weight/{name}": tuple(parameter.shape)}
        if f"exp_avg/{name}" in file.found:
            wanted |= {f"{key}/{name}": tuple(parameter.shape) for key in _MOMENTS}
            wanted[f"step/{name}"] = ()
        for key, shape in wanted.items():
            if key not in file.found:
                raise GamCheckpointError(f"{file.path} lacks {key}, of the network")
            if file.found[key][0] != shape:
                raise GamCheckpointError(
                    f"{file.path}: {key} must have shape {shape}; got {file.found[key][0]}"
                )


def _compare(out: Path, before: Any, described: Mapping[str, Any]) -> None:
    """Refuse to go on with a run as another one."""
    now = json.loads(json.dumps(described))
    for part in now:
        if not isinstance(before, dict) or before.get(part) != now[part]:
            raise GamCheckpointError(
                f"{out} was begun with another {part}; resume it with the same, or start anew"
            )


def _trim_log(path: Path, step: int) -> None:
    """Keep the lines of the steps that are not done again."""
    if path.exists():
        lines = path.read_text(encoding="utf-8", errors="replace").splitlines()
        write_text(path, "".join(line + "\n" for line in lines[:step]))
