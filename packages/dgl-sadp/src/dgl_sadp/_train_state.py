"""The state of a training: all that it takes to go on as if it had not been interrupted."""

import dataclasses
import signal
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Annotated, Any

import torch
from annotated_types import Interval
from torch import Tensor

from dgl_files.fields import check_value
from dgl_sadp._values_file import check_shapes, open_values, read_tensors, write_values
from dgl_sadp.errors import CheckpointError
from dgl_sadp.policy import DiffusionPolicy
from dgl_sadp.validation import Validation

if TYPE_CHECKING:
    from diffusers.training_utils import EMAModel
    from torch.optim.lr_scheduler import LambdaLR

__all__ = ["Interrupts", "TrainState", "hold_interrupts"]

_KIND = "dgl_sadp.training"
_VALUES: Mapping[str, Any] = {
    "step": Annotated[int, Interval(ge=0, le=2**40)],
    "loss_sum": float,
    "last": dict[str, Any],
    "average_step": Annotated[int, Interval(ge=0, le=2**40)],
    "schedules": list[dict[str, Any]],
    "described": dict[str, Any],
}
"""The plain values of a state, all of which must be there."""
_VALIDATION = {field.name for field in dataclasses.fields(Validation)}
_MOMENTS = ("step", "exp_avg", "exp_avg_sq", "momentum_buffer")  # Of AdamW and of Muon.


class TrainState:
    """State of a training; random numbers follow from the seed and the step.

    Random numbers are not among it: whatever is drawn in a step follows from the seed and the
    step's number.
    """

    def __init__(
        self,
        policy: DiffusionPolicy,
        ema: "EMAModel",
        optimizers: Sequence[torch.optim.Optimizer],
        schedules: "Sequence[LambdaLR]",
    ) -> None:
        self.policy = policy
        self.ema = ema
        self.optimizers = optimizers
        self.schedules = schedules
        self.step = 0
        self.loss_sum = 0.0
        self.last: dict[str, Any] = {}

    def save(self, path: Path, described: Mapping[str, Any]) -> None:
        """Write everything.

        Args:
            path: The file.
            described: What the training was begun with.
        """
        tensors: dict[str, Tensor] = {}
        parameters = dict(self.policy.named_parameters())
        for (name, parameter), average in zip(
            parameters.items(), self.ema.shadow_params, strict=True
        ):
            tensors[f"weight/{name}"] = parameter
            tensors[f"average/{name}"] = average
            for optimizer in self.optimizers:
                if parameter in optimizer.state:
                    for key, moment in optimizer.state[parameter].items():
                        tensors[f"{key}/{name}"] = moment
        for name, buffer in self.policy.normalizer.named_buffers():
            tensors[f"range/{name}"] = buffer
        values = {
            "step": self.step,
            "loss_sum": self.loss_sum,
            "last": self.last,
            "average_step": self.ema.optimization_step,
            "schedules": [each.state_dict() for each in self.schedules],
            "described": described,
        }
        write_values(path, tensors, kind=_KIND, values=values)

    def load(self, path: Path, described: Mapping[str, Any]) -> None:
        """Put everything back.

        Raises:
            CheckpointError: If the file is damaged, or of a training that was begun with something
                else.
        """
        with open_values(path, kind=_KIND) as (file, values):
            try:
                _check_values(values, schedules=[each.state_dict() for each in self.schedules])
            except ValueError as err:
                raise CheckpointError(f"{path}: {err}") from err
            before = values["described"]
            for part, now in described.items():
                if before.get(part) != now:
                    raise CheckpointError(
                        f"{path.parent} was begun with another {part} "
                        f"({_find_difference(before.get(part), now)}); resume it with the same, "
                        "or start anew"
                    )
            parameters = dict(self.policy.named_parameters())
            buffers = {f"range/{name}": b for name, b in self.policy.normalizer.named_buffers()}
            wanted = {
                f"{kind}/{name}": parameter
                for kind in ("weight", "average")
                for name, parameter in parameters.items()
            }
            check_shapes(file, {**wanted, **buffers}, has_more=True)
            tensors = read_tensors(file)
        for name, buffer in buffers.items():
            if not torch.equal(buffer.cpu(), tensors[name]):
                raise CheckpointError(
                    f"{path.parent} was begun with other values in its episodes "
                    f"({name.removeprefix('range/')}); start anew"
                )
        with torch.no_grad():
            for (name, parameter), average in zip(
                parameters.items(), self.ema.shadow_params, strict=True
            ):
                parameter.copy_(tensors[f"weight/{name}"])
                average.copy_(tensors[f"average/{name}"])
                moments = {
                    key: tensors[f"{key}/{name}"].to(parameter.device)
                    for key in _MOMENTS
                    if f"{key}/{name}" in tensors
                }
                for key, moment in moments.items():
                    if moment.shape not in (parameter.shape, torch.Size([])):
                        raise CheckpointError(
                            f"{path}: {key}/{name} must have shape {tuple(parameter.shape)}; "
                            f"got {tuple(moment.shape)}"
                        )
                for optimizer in self.optimizers:
                    if moments and any(parameter is p for p in optimizer.param_groups[0]["params"]):
                        optimizer.state[parameter] = moments
        self.ema.optimization_step = values["average_step"]
        for optimizer, schedule, kept in zip(
            self.optimizers, self.schedules, values["schedules"], strict=True
        ):
            schedule.load_state_dict(kept)
            for group, rate in zip(optimizer.param_groups, kept["_last_lr"], strict=True):
                group["lr"] = rate
        self.step, self.loss_sum = int(values["step"]), float(values["loss_sum"])
        self.last = values["last"]

    @contextmanager
    def averaged(self) -> Iterator[DiffusionPolicy]:
        """Lend the policy with its averaged weights, in evaluation mode."""
        parameters = list(self.policy.parameters())
        self.ema.store(parameters)
        self.ema.copy_to(parameters)
        self.policy.eval()
        try:
            yield self.policy
        finally:
            self.ema.restore(parameters)
            self.policy.train()


class Interrupts:
    """Request to stop."""

    def __init__(self) -> None:
        self.is_asked = False


@contextmanager
def hold_interrupts(*, is_repeated: bool = False) -> Iterator[Interrupts]:
    """Note the first SIGINT, so that a step can be finished and saved; raise at the second.

    Only the main thread can do so; elsewhere signals do not arrive anyway.

    Args:
        is_repeated: Whether both the terminal and a launcher tell of one interruption. Then none
            raises.
    """
    held = Interrupts()
    if threading.current_thread() is not threading.main_thread():
        yield held
        return

    def note(number: int, frame: FrameType | None) -> None:
        if held.is_asked and not is_repeated:
            raise KeyboardInterrupt
        held.is_asked = True

    before = signal.signal(signal.SIGINT, note)
    try:
        yield held
    finally:
        signal.signal(signal.SIGINT, before)


def _check_values(values: Mapping[str, Any], *, schedules: Sequence[Mapping[str, Any]]) -> None:
    """Check the plain values of a state; a `ValueError` says what is wrong."""
    for name, hint in _VALUES.items():
        check_value(name, values.get(name), hint)
    last = values["last"]
    check_value("last.loss", last.get("loss", 0.0), float)
    check_value("last.validation", last.get("validation"), dict[str, float] | None)
    if set(last.get("validation") or _VALIDATION) != _VALIDATION:
        raise ValueError(f"last.validation must have {sorted(_VALIDATION)}")
    if len(values["schedules"]) != len(schedules):
        raise ValueError(f"schedules must be {len(schedules)}; got {len(values['schedules'])}")
    for kept, now in zip(values["schedules"], schedules, strict=True):
        _check_schedule(kept, now)


def _check_schedule(kept: Mapping[str, Any], now: Mapping[str, Any]) -> None:
    """Compare the state of a learning-rate schedule with the present one, but for numbers."""
    if set(kept) != set(now):
        raise ValueError(f"schedules must have {sorted(now)}; got {sorted(kept)}")
    for key, value in now.items():
        name = f"schedules.{key}"
        if isinstance(value, list):
            check_value(name, kept[key], list[float | None])
            if [each is None for each in kept[key]] != [each is None for each in value]:
                raise ValueError(f"{name} must be like {value}; got {kept[key]}")
        else:
            check_value(name, kept[key], type(value))


def _find_difference(before: object, now: object) -> str:
    """Name the first thing that two configurations differ in."""
    if isinstance(before, dict) and isinstance(now, dict):
        for key in (*now, *before):
            if before.get(key) != now.get(key):
                return f"{key}: {_find_difference(before.get(key), now.get(key))}"
    if isinstance(before, list) and isinstance(now, list):
        return (
            f"{len(before)} entries then, {len(now)} now" if len(before) != len(now) else "entries"
        )
    return f"{before!r} then, {now!r} now"
