"""One training in its folder, as one process does it, alone or with others beside it."""

import dataclasses
import json
import math
import time
from collections.abc import Callable, Mapping
from contextlib import nullcontext
from dataclasses import dataclass
from datetime import timedelta
from functools import partial
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING

import torch
from torch import Tensor
from torch.utils.data import DataLoader

from dgl_files.whole import write_text
from dgl_sadp._random import STEP, draw_seed
from dgl_sadp._train_data import Batches, TrainData, collate_windows
from dgl_sadp._train_result import TrainProgress, TrainResult
from dgl_sadp._train_state import TrainState
from dgl_sadp.checkpoint import POLICY_FILE, save_policy
from dgl_sadp.config import PolicyConfig
from dgl_sadp.errors import TrainingDivergedError
from dgl_sadp.optimizers import make_optimizers
from dgl_sadp.policy import DiffusionPolicy
from dgl_sadp.train_config import TrainConfig
from dgl_sadp.validation import Validation, compute_validation

if TYPE_CHECKING:
    from torch.utils.tensorboard import SummaryWriter

__all__ = ["CONFIG_FILE", "PATIENCE", "TrainJob", "run_job"]

STATE_FILE = "state.safetensors"
CONFIG_FILE = "config.json"
LOG_FOLDER = "logs"
KEPT_FOLDER = "policies"

PATIENCE = timedelta(hours=2)
"""Longest wait of processes for the first one, which validates and saves."""


@dataclass(frozen=True, kw_only=True)
class TrainJob:
    """Arguments of a training; see `train_policy`."""

    out: Path
    policy: PolicyConfig
    config: TrainConfig
    data: TrainData
    device: str
    devices: int
    """Processes that share each batch."""
    workers: int
    is_resumed: bool
    stop_after: int | None


def run_job(
    job: TrainJob,
    on_progress: Callable[[TrainProgress], None] | None,
    is_asked_to_stop: Callable[[], bool],
) -> TrainResult | None:
    """Run this process's part; return None if it was stopped, with everything saved."""
    run = TrainRun(job)
    run.begin(is_resumed=job.is_resumed)
    is_whole = run.train(on_progress, job.stop_after, is_asked_to_stop)
    return run.result if is_whole else None


class TrainRun:
    """One training in its folder; of several processes only the first writes."""

    def __init__(self, job: TrainJob) -> None:
        from accelerate import Accelerator
        from accelerate.utils import InitProcessGroupKwargs
        from diffusers.optimization import get_cosine_schedule_with_warmup
        from diffusers.training_utils import EMAModel

        self.out, self.config, self.data, self.workers = job.out, job.config, job.data, job.workers
        config = job.config
        self.accelerator = Accelerator(
            cpu=job.device == "cpu",
            mixed_precision=config.precision,
            kwargs_handlers=[InitProcessGroupKwargs(timeout=PATIENCE)],
        )
        if self.accelerator.num_processes != job.devices:
            raise ValueError(
                f"devices must be the {self.accelerator.num_processes} process(es) that a launcher "
                f"has started; got {job.devices}"
            )
        self.batches = Batches(
            counts=job.data.train.counts,
            config=config,
            process=self.accelerator.process_index,
            processes=job.devices,
        )
        self.in_epoch, self.steps = self.batches.in_epoch, self.batches.steps
        model = DiffusionPolicy.make(job.policy, seed=config.seed)
        model.normalizer.fit(job.data.ranges)
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
                    "policy": dataclasses.asdict(job.policy),
                    "training": dataclasses.asdict(config),
                    "data": job.data.describe(),
                }
            )
        )

    def begin(self, *, is_resumed: bool) -> None:
        """Make the folder, or go on from what it holds."""
        if not is_resumed:
            if self.accelerator.is_main_process:
                self.out.mkdir(parents=True, exist_ok=True)
                write_text(self.out / CONFIG_FILE, json.dumps(self.described, indent=1))
        elif (self.out / STATE_FILE).exists():  # Or else it was interrupted before its first state.
            self.state.load(self.out / STATE_FILE, self.described)

    def train(
        self,
        on_progress: Callable[[TrainProgress], None] | None,
        stop_after: int | None,
        is_asked_to_stop: Callable[[], bool],
    ) -> bool:
        """Do the steps that are left; return whether it was not asked to stop before."""
        from torch.utils.tensorboard import SummaryWriter

        state = self.state
        if state.step >= self.steps:
            return True
        loader = DataLoader(
            self.data.train,  # type: ignore[arg-type] - has the methods of a map-style dataset
            batch_sampler=self.batches.iterate(state.step),
            collate_fn=partial(collate_windows, group=self.config.group),
            num_workers=self.workers,
            pin_memory=self.accelerator.device.type == "cuda",
            generator=torch.Generator().manual_seed(self.config.seed),
        )
        is_stopped = False
        began, first = time.perf_counter(), state.step
        log = nullcontext()
        if self.accelerator.is_main_process:
            log = SummaryWriter(str(self.out / LOG_FOLDER), purge_step=first)
        with log as writer:
            for batch in loader:
                loss, is_stopped = self._step(batch, is_asked_to_stop)
                is_last = is_stopped or state.step in (self.steps, stop_after)
                if writer is not None:
                    self._record(writer, loss, is_last=is_last)
                    if on_progress is not None:
                        mean = (time.perf_counter() - began) / (state.step - first)
                        on_progress(self._tell(loss, mean))
                if is_last:
                    break
        self.accelerator.wait_for_everyone()  # None ends before everything is written.
        return not is_stopped

    @property
    def result(self) -> TrainResult:
        """Result so far."""
        held_out = self.data.validation
        return TrainResult(
            policy=self.out / POLICY_FILE,
            steps=self.state.step,
            loss=self.state.last.get("loss", math.nan),
            validation=self.validation,
            episodes=len(self.data.train.episodes),
            validation_episodes=0 if held_out is None else len(held_out.episodes),
            windows=len(self.data.train),
            refused=self.data.refused,
        )

    @property
    def validation(self) -> Validation | None:
        """The last validation."""
        found = self.state.last.get("validation")
        return None if found is None else Validation(**found)

    def _step(
        self, batch: Mapping[str, Tensor], is_asked_to_stop: Callable[[], bool]
    ) -> tuple[float, bool]:
        """Do a step; return the batch's loss, and whether a process was asked to stop."""
        state, device = self.state, self.accelerator.device
        share = self.batches.get_share(state.step)
        seed = draw_seed(self.config.seed, STEP, state.step)
        generator = torch.Generator(device).manual_seed(seed)
        loss = self.model(_to(batch, device), generator, self.config.augmentation, share)
        loss = loss * share.weight
        # All processes learn the same of it, so that all go on or none does.
        shared = torch.stack([loss.detach(), loss.new_tensor(float(is_asked_to_stop()))])
        means = self.accelerator.reduce(shared, "mean")
        assert isinstance(means, Tensor)
        value, asked = means.tolist()
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
        return value, asked > 0

    def _record(self, writer: "SummaryWriter", loss: float, *, is_last: bool) -> None:
        """Log a step; validate and save if it is time."""
        state, config = self.state, self.config
        writer.add_scalar("loss/step", loss, state.step)
        writer.add_scalar("learning_rate", state.schedules[0].get_last_lr()[0], state.step)
        state.loss_sum += loss
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
        if not all(map(math.isfinite, (found.loss, found.error, found.largest_error))):
            raise TrainingDivergedError(
                f"the validation after epoch {epoch} is not finite; lower learning_rate "
                f"({self.config.learning_rate:g}) and start anew"
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

    def _tell(self, loss: float, seconds: float) -> TrainProgress:
        step = self.state.step
        return TrainProgress(
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
