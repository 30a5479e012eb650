"""One training in its folder."""

import dataclasses
import json
import math
import os
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING

import torch
from torch import Tensor
from torch.utils.data import DataLoader

from dgl_sadp._random import STEP, draw_seed
from dgl_sadp._train_data import Batches, TrainData
from dgl_sadp._train_state import TrainState, hold_interrupts
from dgl_sadp.checkpoint import save_policy
from dgl_sadp.config import PolicyConfig
from dgl_sadp.errors import TrainingDivergedError
from dgl_sadp.optimizers import make_optimizers
from dgl_sadp.policy import DiffusionPolicy
from dgl_sadp.train_config import TrainConfig
from dgl_sadp.validation import Validation, compute_validation

if TYPE_CHECKING:
    from torch.utils.tensorboard import SummaryWriter

__all__ = ["CONFIG_FILE", "POLICY_FILE", "Progress", "TrainRun"]

POLICY_FILE = "policy.safetensors"
STATE_FILE = "state.safetensors"
CONFIG_FILE = "config.json"
LOG_FOLDER = "logs"
KEPT_FOLDER = "policies"


@dataclass(frozen=True, kw_only=True)
class Progress:
    """How training goes, after a step."""

    step: int
    """Steps done."""
    steps: int
    """Steps to do in all."""
    epoch: int
    """Number of the present epoch, from 1."""
    epochs: int
    """Epochs in all."""
    loss: float
    """Loss of the last batch."""
    seconds_left: float
    """Time that the rest will take [s], from the mean of this run's steps."""
    validation: Validation | None
    """The last validation."""


class TrainRun:
    """One training in its folder."""

    def __init__(
        self,
        out: Path,
        policy: PolicyConfig,
        config: TrainConfig,
        data: TrainData,
        *,
        device: str,
        workers: int,
    ) -> None:
        from accelerate import Accelerator
        from diffusers.optimization import get_cosine_schedule_with_warmup
        from diffusers.training_utils import EMAModel

        self.out, self.config, self.data, self.workers = out, config, data, workers
        self.in_epoch = -(-len(data.train) // config.batch)
        self.steps = self.in_epoch * config.epochs
        self.accelerator = Accelerator(cpu=device == "cpu", mixed_precision=config.precision)
        if self.accelerator.num_processes != 1:
            raise ValueError(
                f"training runs in one process; got {self.accelerator.num_processes} of them"
            )
        model = DiffusionPolicy.make(policy, seed=config.seed)
        model.normalizer.fit(data.ranges)
        model.to(self.accelerator.device).train()
        optimizers = make_optimizers(model, config)
        warmup = min(config.warmup_steps, self.steps // 10)
        schedules = [
            get_cosine_schedule_with_warmup(each, warmup, self.steps) for each in optimizers
        ]
        ema = EMAModel(
            model.parameters(),
            decay=config.ema_decay,
            use_ema_warmup=True,
            inv_gamma=1.0,
            power=config.ema_power,
            foreach=True,
        )
        self.state = TrainState(model, ema, optimizers, schedules)
        # What accelerate wraps shares weights and moments with what the state holds.
        self.model, *self.optimizers = self.accelerator.prepare(model, *optimizers)
        self.described = json.loads(
            json.dumps(
                {
                    "policy": dataclasses.asdict(policy),
                    "training": dataclasses.asdict(config),
                    "data": data.describe(),
                }
            )
        )

    def begin(self, *, is_resumed: bool) -> None:
        """Make the folder, or go on from what it holds."""
        if not is_resumed:
            self.out.mkdir(parents=True, exist_ok=True)
            _write_whole(self.out / CONFIG_FILE, json.dumps(self.described, indent=1))
        elif (self.out / STATE_FILE).exists():  # Or else it was interrupted before its first state.
            self.state.load(self.out / STATE_FILE, self.described)

    def train(self, on_progress: Callable[[Progress], None] | None, stop_after: int | None) -> None:
        """Do the steps that are left."""
        from torch.utils.tensorboard import SummaryWriter

        state = self.state
        if state.step >= self.steps:
            return
        loader = DataLoader(
            self.data.train,  # type: ignore[arg-type] - has the methods of a map-style dataset
            batch_sampler=Batches(len(self.data.train), self.config, state.step),
            num_workers=self.workers,
            pin_memory=self.accelerator.device.type == "cuda",
            generator=torch.Generator().manual_seed(self.config.seed),
        )
        began, first = time.perf_counter(), state.step
        writer = SummaryWriter(str(self.out / LOG_FOLDER), purge_step=state.step)
        try:
            with hold_interrupts() as interrupts:
                for batch in loader:
                    loss = self._step(batch)
                    self._log(writer, loss)
                    is_last = state.step in (self.steps, stop_after)
                    self._end_epoch(writer, is_last=is_last or interrupts.is_asked)
                    if on_progress is not None:
                        mean = (time.perf_counter() - began) / (state.step - first)
                        on_progress(self._tell(loss, mean))
                    if interrupts.is_asked:
                        raise KeyboardInterrupt
                    if is_last:
                        break
        finally:
            writer.close()

    @property
    def validation(self) -> Validation | None:
        """The last validation."""
        found = self.state.last.get("validation")
        return None if found is None else Validation(**found)

    def _step(self, batch: Mapping[str, Tensor]) -> float:
        state, device = self.state, self.accelerator.device
        seed = draw_seed(self.config.seed, STEP, state.step)
        generator = torch.Generator(device).manual_seed(seed)
        loss = self.model(_to(batch, device), generator, self.config.augmentation)
        value = loss.item()
        if not math.isfinite(value):
            raise TrainingDivergedError(
                f"the loss of step {state.step + 1} is not finite; lower learning_rate "
                f"({self.config.learning_rate:g}) and start anew"
            )
        self.accelerator.backward(loss)
        for optimizer, schedule in zip(self.optimizers, state.schedules, strict=True):
            optimizer.step()
            schedule.step()
            optimizer.zero_grad(set_to_none=True)
        state.ema.step(state.policy.parameters())
        state.step += 1
        state.loss_sum += value
        return value

    def _end_epoch(self, writer: "SummaryWriter", *, is_last: bool) -> None:
        """At the end of an epoch, and when training stops: validate and save, as far as it is time."""
        state, config = self.state, self.config
        is_epoch = state.step % self.in_epoch == 0
        epoch = state.step // self.in_epoch
        if is_epoch:
            state.last["loss"] = state.loss_sum / self.in_epoch
            state.loss_sum = 0.0
            writer.add_scalar("loss/epoch", state.last["loss"], state.step)
            if self.data.validation is not None and (
                epoch % config.validate_every == 0 or epoch == config.epochs
            ):
                self._validate(writer, epoch)
            if config.keep_every and epoch % config.keep_every == 0:
                self._save_policy(self.out / KEPT_FOLDER / f"epoch-{epoch:05d}.safetensors")
        if is_last or (is_epoch and epoch % config.save_every == 0):
            self._save_policy(self.out / POLICY_FILE)
            state.save(self.out / STATE_FILE, self.described)

    def _validate(self, writer: "SummaryWriter", epoch: int) -> None:
        assert self.data.validation is not None
        with self.state.averaged() as policy:
            found = compute_validation(
                policy,
                self.data.validation,
                epoch=epoch,
                windows=self.config.validation_windows,
                seed=self.config.seed,
            )
        self.state.last["validation"] = dataclasses.asdict(found)
        writer.add_scalar("loss/validation", found.loss, self.state.step)
        for name, error in {"mean": found.error, "largest": found.largest_error}.items():
            writer.add_scalar(f"error_deg/{name}", math.degrees(error), self.state.step)

    def _save_policy(self, path: Path) -> None:
        card = {
            **self.described["data"],
            "training": self.described["training"],
            "epochs_done": self.state.step // self.in_epoch,
            "steps_done": self.state.step,
            **self.state.last,
            "versions": {
                name: metadata.version(name)
                for name in ("dgl-sadp", "torch", "diffusers", "numpy", "safetensors")
            },
        }
        with self.state.averaged() as policy:
            save_policy(path, policy, card)

    def _log(self, writer: "SummaryWriter", loss: float) -> None:
        writer.add_scalar("loss/step", loss, self.state.step)
        rate = self.state.schedules[0].get_last_lr()[0]
        writer.add_scalar("learning_rate", rate, self.state.step)

    def _tell(self, loss: float, seconds: float) -> Progress:
        step = self.state.step
        return Progress(
            step=step,
            steps=self.steps,
            epoch=min(self.config.epochs, (step - 1) // self.in_epoch + 1),
            epochs=self.config.epochs,
            loss=loss,
            seconds_left=seconds * (self.steps - step),
            validation=self.validation,
        )


def _to(batch: Mapping[str, Tensor], device: torch.device) -> dict[str, Tensor]:
    return {key: tensor.to(device, non_blocking=True) for key, tensor in batch.items()}


def _write_whole(path: Path, text: str) -> None:
    beside = path.with_name(f".{path.name}.{os.getpid()}.part")
    beside.write_text(text, encoding="utf-8")
    beside.replace(path)
