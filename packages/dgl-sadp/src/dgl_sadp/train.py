"""Training: a run is a folder with its configuration, its log, the state to go on from, and the policy."""

import dataclasses
import json
import math
import os
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from torch import Tensor
from torch.utils.data import DataLoader

from dgl_sadp._train_state import TrainState, hold_interrupts
from dgl_sadp.checkpoint import save_policy
from dgl_sadp.config import PolicyConfig
from dgl_sadp.dataset import EpisodeDataset, split_episodes
from dgl_sadp.errors import CheckpointError, CorruptEpisodeError, TrainingDivergedError
from dgl_sadp.policy import DiffusionPolicy
from dgl_sadp.ranges import join_ranges, measure_episodes
from dgl_sadp.train_config import TrainConfig

if TYPE_CHECKING:
    from torch.utils.tensorboard import SummaryWriter

__all__ = ["Progress", "TrainResult", "Validation", "compute_validation", "train_policy"]

POLICY_FILE = "policy.safetensors"
STATE_FILE = "state.safetensors"
CONFIG_FILE = "config.json"
LOG_FOLDER = "logs"
KEPT_FOLDER = "policies"

# What numbers are drawn for; part of each seed.
_ORDER, _STEP, _VALIDATION = 1, 2, 3


@dataclass(frozen=True, kw_only=True)
class Validation:
    """How the averaged policy does on episodes that were not trained on."""

    epoch: int
    """After how many epochs."""
    loss: float
    """Diffusion loss."""
    error: float
    """Mean distance of generated to commanded targets [rad], over joints and executed steps."""


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


@dataclass(frozen=True, kw_only=True)
class TrainResult:
    """What a training came to."""

    policy: Path
    """The policy's file."""
    steps: int
    """Steps done, over all resumptions."""
    loss: float
    """Mean loss of the last whole epoch; NaN if none was finished."""
    validation: Validation | None
    """The last validation."""
    episodes: int
    """Episodes trained on."""
    validation_episodes: int
    """Episodes validated on."""
    windows: int
    """Windows in an epoch."""
    refused: tuple[CorruptEpisodeError, ...]
    """What is wrong with the files that were left out."""


def train_policy(
    directory: str | Path,
    out: str | Path,
    policy: PolicyConfig,
    config: TrainConfig,
    *,
    stage: int,
    is_resumed: bool = False,
    device: str = "cpu",
    workers: int = 0,
    keep_bytes: int = 2**30,
    on_progress: Callable[[Progress], None] | None = None,
    stop_after: int | None = None,
) -> TrainResult:
    """Train a policy for one stage.

    Files that are damaged or hold values that are not finite are left out, logged and listed in the result.

    Ctrl-C ends the step in progress, saves, and raises `KeyboardInterrupt`; a second one stops at once.

    Args:
        directory: Folder of episode files.
        out: Folder of the run; made if missing. It holds `policy.safetensors` (the averaged weights), `state.safetensors`,
            `config.json`, `logs` for TensorBoard and the policies kept on the way.
        policy: What is trained.
        config: How it is trained.
        stage: Number of the stage, from 1.
        is_resumed: Whether to go on with the run in `out`. It ends as it would have without the interruption, bitwise on a
            CPU with the same number of threads.
        device: "cpu" or "cuda".
        workers: Processes that read episodes beside this one.
        keep_bytes: Memory for frames of episodes, in all processes [byte]; what does not fit is read each time.
        on_progress: Called after each step.
        stop_after: Save and stop after this step, as an interruption would.

    Raises:
        ValueError: If an argument is out of range, or the episodes do not fit the policy.
        FileNotFoundError: If the folder holds no episode.
        FileExistsError: If `out` holds a run and `is_resumed` is false.
        CheckpointError: If there is nothing to resume, or it was begun with something else.
        TrainingDivergedError: If the loss is not finite.
    """
    out = Path(out)
    if device not in ("cpu", "cuda"):
        raise ValueError(f"device must be 'cpu' or 'cuda'; got {device!r}")
    if device == "cuda" and not torch.cuda.is_available():
        raise ValueError("device 'cuda': torch finds no CUDA device here")
    if workers < 0:
        raise ValueError(f"workers must be at least 0; got {workers}")
    if (out / CONFIG_FILE).exists() != is_resumed:
        if is_resumed:
            raise CheckpointError(f"{out} holds no run to resume")
        raise FileExistsError(f"{out} holds a run already; resume it or choose another folder")
    data = _Data.open(directory, policy, config, stage, keep_bytes=keep_bytes // max(1, workers))
    with _own_accelerator():
        run = _Run(out, policy, config, data, device=device, workers=workers)
        run.begin(is_resumed=is_resumed)
        run.train(on_progress, stop_after)
        return run.describe_result()


@torch.no_grad()
def compute_validation(
    policy: DiffusionPolicy, dataset: EpisodeDataset, *, epoch: int, windows: int, seed: int
) -> Validation:
    """Measure a policy on windows of a dataset, evenly spread.

    Args:
        policy: In evaluation mode.
        dataset: Episodes that were not trained on.
        epoch: To be noted.
        windows: Most windows; generation is measured on a quarter of them.
        seed: Of noise and points; the same in all validations of a run, so that they can be compared.
    """
    if policy.training:
        raise ValueError("the policy must be in evaluation mode")
    chosen = np.unique(np.linspace(0, len(dataset) - 1, min(windows, len(dataset))).astype(int))
    losses, errors = [], []
    size = 64
    for number, start in enumerate(range(0, len(chosen), size)):
        part = chosen[start : start + size]
        generator = torch.Generator().manual_seed(_draw_seed(seed, _VALIDATION, number))
        batch = _to(
            torch.utils.data.default_collate([dataset[int(i)] for i in part]), policy.device
        )
        losses.append((policy(batch, generator).item(), len(part)))
        batch = {key: values[::4] for key, values in batch.items()}
        actions = policy.predict(batch, policy.encode_stage(batch, generator), generator)
        executed = policy.config.executed
        distance = (actions - batch["action"])[:, executed].abs().mean().item()
        errors.append((distance, len(actions)))
    return Validation(epoch=epoch, loss=_mean(losses), error=_mean(errors))


@dataclass(frozen=True, kw_only=True)
class _Data:
    """Episodes for a run, divided."""

    train: EpisodeDataset
    validation: EpisodeDataset | None
    ranges: Mapping[str, Any]
    refused: tuple[CorruptEpisodeError, ...]
    tasks: tuple[str, ...]

    @classmethod
    def open(
        cls,
        directory: str | Path,
        policy: PolicyConfig,
        config: TrainConfig,
        stage: int,
        *,
        keep_bytes: int,
    ) -> "_Data":
        found = EpisodeDataset(
            directory,
            stage,
            policy.horizon,
            policy.observation_steps,
            policy.action_steps,
            observation_keys=policy.frame_keys,
            keep_bytes=keep_bytes,
            skip_corrupt=True,
            with_approach=config.with_approach,
        )
        measured = measure_episodes(found, ("action", *policy.frame_keys, *policy.stage_keys))
        whole = measured.dataset
        count = len(whole.episodes)
        train, validation = np.arange(count), np.arange(0)
        if config.validation_share > 0:
            train, validation = split_episodes(count, config.validation_share, config.split_seed)
        held_out = whole.select(validation) if len(validation) else None
        if held_out is not None:
            held_out.keep_bytes = 0  # A few windows now and then: the memory is for training.
        return cls(
            train=whole.select(train),
            validation=held_out,
            ranges=join_ranges([measured.ranges[number] for number in train]),
            refused=(*found.refused, *measured.refused),
            tasks=tuple(sorted({episode.task for episode in whole.episodes})),
        )

    def describe(self) -> dict[str, Any]:
        """Name what a run learns from."""
        parts = {"episodes": self.train, "validation_episodes": self.validation}
        names = {
            key: [] if part is None else [episode.path.name for episode in part.episodes]
            for key, part in parts.items()
        }
        return {
            "stage": self.train.stage,
            "tasks": list(self.tasks),
            "windows": len(self.train),
            **names,
        }


class _Batches:
    """The batches of a whole run from some step on, as lists of windows; each epoch has its own order."""

    def __init__(self, windows: int, config: TrainConfig, start: int) -> None:
        self.windows, self.config, self.start = windows, config, start
        self.in_epoch = -(-windows // config.batch)

    def __len__(self) -> int:
        return self.in_epoch * self.config.epochs - self.start

    def __iter__(self) -> Iterator[list[int]]:
        for epoch in range(self.start // self.in_epoch, self.config.epochs):
            rng = np.random.default_rng([self.config.seed, _ORDER, epoch])
            order = rng.permutation(self.windows).tolist()
            first = max(0, self.start - epoch * self.in_epoch)
            for number in range(first, self.in_epoch):
                yield order[number * self.config.batch : (number + 1) * self.config.batch]


class _Run:
    """One training in its folder."""

    def __init__(
        self,
        out: Path,
        policy: PolicyConfig,
        config: TrainConfig,
        data: _Data,
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
        optimizer = torch.optim.AdamW(
            model.parameters(),
            lr=config.learning_rate,
            betas=config.betas,
            eps=1e-8,
            weight_decay=config.weight_decay,
            fused=True,
        )
        schedule = get_cosine_schedule_with_warmup(
            optimizer, min(config.warmup_steps, self.steps // 10), self.steps
        )
        ema = EMAModel(
            model.parameters(),
            decay=config.ema_decay,
            use_ema_warmup=True,
            inv_gamma=1.0,
            power=config.ema_power,
            foreach=True,
        )
        self.state = TrainState(model, ema, optimizer, schedule)
        # What accelerate wraps shares weights and moments with what the state holds.
        self.model, self.optimizer = self.accelerator.prepare(model, optimizer)
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
            batch_sampler=_Batches(len(self.data.train), self.config, state.step),
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

    def describe_result(self) -> TrainResult:
        """Say what the training came to."""
        validation = self.data.validation
        return TrainResult(
            policy=self.out / POLICY_FILE,
            steps=self.state.step,
            loss=self.state.last.get("loss", math.nan),
            validation=self._get_validation(),
            episodes=len(self.data.train.episodes),
            validation_episodes=0 if validation is None else len(validation.episodes),
            windows=len(self.data.train),
            refused=self.data.refused,
        )

    def _step(self, batch: Mapping[str, Tensor]) -> float:
        state, device = self.state, self.accelerator.device
        seed = _draw_seed(self.config.seed, _STEP, state.step)
        generator = torch.Generator(device).manual_seed(seed)
        loss = self.model(_to(batch, device), generator, self.config.augmentation)
        value = loss.item()
        if not math.isfinite(value):
            raise TrainingDivergedError(
                f"the loss of step {state.step + 1} is not finite; lower learning_rate "
                f"({self.config.learning_rate:g}) and start anew"
            )
        self.accelerator.backward(loss)
        self.optimizer.step()
        state.schedule.step()
        self.optimizer.zero_grad(set_to_none=True)
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
        writer.add_scalar("error_deg/validation", math.degrees(found.error), self.state.step)

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
        rate = self.state.schedule.get_last_lr()[0]
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
            validation=self._get_validation(),
        )

    def _get_validation(self) -> Validation | None:
        found = self.state.last.get("validation")
        return None if found is None else Validation(**found)


@contextmanager
def _own_accelerator() -> Iterator[None]:
    """Forget accelerate's settings afterwards, which are global, unless the caller had made some before.

    Else one process could not train with two precisions, or on two devices, one after the other.
    """
    from accelerate.state import AcceleratorState

    is_ours = not AcceleratorState._shared_state  # noqa: SLF001 - there is no public way to ask
    try:
        yield
    finally:
        if is_ours:
            AcceleratorState._reset_state(reset_partial_state=True)  # noqa: SLF001 - nor to reset


def _draw_seed(seed: int, purpose: int, number: int) -> int:
    """Return a seed for one thing that is drawn, unlike those of all others."""
    return int(np.random.SeedSequence([seed, purpose, number]).generate_state(1, np.uint64)[0] >> 1)


def _to(batch: Mapping[str, Tensor], device: torch.device) -> dict[str, Tensor]:
    return {key: tensor.to(device, non_blocking=True) for key, tensor in batch.items()}


def _mean(values: list[tuple[float, int]]) -> float:
    return sum(value * count for value, count in values) / sum(count for _, count in values)


def _write_whole(path: Path, text: str) -> None:
    beside = path.with_name(f".{path.name}.{os.getpid()}.part")
    beside.write_text(text, encoding="utf-8")
    beside.replace(path)
