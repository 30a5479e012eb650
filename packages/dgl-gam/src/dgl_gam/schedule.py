"""Schedules: trainings in several stages, each from the weights of the one before."""

import dataclasses
import json
import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import torch

from dgl_files.whole import write_text, written_beside
from dgl_gam.checkpoint import load_checkpoint
from dgl_gam.config import YawConfig
from dgl_gam.data.batches import BatchConfig
from dgl_gam.data.folder import GarmentFolder
from dgl_gam.errors import GamCheckpointError
from dgl_gam.run_files import CONFIG_FILE, read_config
from dgl_gam.train import (
    NETWORK_FILE,
    TRAIN_PRESETS,
    GamTrainConfig,
    GamTrainProgress,
    train,
)

__all__ = ["SCHEDULES", "Schedule", "ScheduleStage", "get_schedule", "train_schedule"]


@dataclass(frozen=True, kw_only=True)
class ScheduleStage:
    """Changes of one stage to the schedule's base configuration."""

    name: str
    """Of the stage's folder."""
    steps: int
    """Batches."""
    lr: float
    """Largest learning rate."""
    decay: int | None = None
    """Step at which the learning rate would reach zero; later than the last step for a run that
    ends early."""
    margin: float = 0.04
    """Nearest that a negative may be to the true place, as a share of the diagonal."""
    max_distance: float = 0.02
    """Farthest that a positive may be from the true place, as a share of the diagonal."""
    near_share: float = 0.4
    """Share of the negatives that are taken from near the positive."""
    flat_share: float = 0.4
    """Share of the views that show a garment lying flat; the others show any state."""
    state_weights: tuple[tuple[str, float], ...] = ()
    """Weight of each kind of state in these views, see `BatchConfig`."""
    parts: Literal["all", "features", "yaw"] = "all"
    """Trained part of the network."""
    new_yaw: YawConfig | None = None
    """Sizes of a new yaw network that replaces the one of `start`."""
    groups: int = 4
    """Groups of views in a batch."""
    mirrored_share: float = 0.0
    """Share of the clouds for the yaw that are mirrored; a mirrored garment is turned the other
    way."""
    least_yaw_weight: float = 0.0
    """Smallest weight of a cloud in the loss of the yaw."""

    def configure(self, base: GamTrainConfig, *, seed: int) -> GamTrainConfig:
        """Put the stage's values into a configuration."""
        own = {f.name: getattr(self, f.name) for f in dataclasses.fields(self) if f.name != "name"}
        of_batch = {f.name for f in dataclasses.fields(BatchConfig)} & set(own)
        batch = dataclasses.replace(base.batch, **{name: own[name] for name in of_batch})
        rest = {name: value for name, value in own.items() if name not in of_batch}
        return dataclasses.replace(base, seed=seed, batch=batch, **rest)


@dataclass(frozen=True, kw_only=True)
class Schedule:
    """Stages in their order."""

    stages: tuple[ScheduleStage, ...]
    """The first begins from the start, each other one from the weights of the one before."""
    base: GamTrainConfig = field(default_factory=GamTrainConfig)
    """Configuration shared by all stages."""

    def __post_init__(self) -> None:
        names = [stage.name for stage in self.stages]
        if not names or len(set(names)) != len(names):
            raise ValueError(f"stages must be named, each in its own way; got {names}")
        self.configure(seed=0)  # a value that is out of its range is found now, and not hours later

    @property
    def steps(self) -> int:
        """Steps of all stages together."""
        return sum(stage.steps for stage in self.stages)

    def configure(self, *, seed: int) -> list[GamTrainConfig]:
        """Make the stages' configurations; each adds its number to the seed."""
        return [s.configure(self.base, seed=seed + n) for n, s in enumerate(self.stages)]

    def shorten(self, steps: int) -> "Schedule":
        """Scale the stages to a total number of steps, at least one each."""
        if steps < len(self.stages):
            raise ValueError(
                f"steps must be at least {len(self.stages)}, one for each stage; got {steps}"
            )
        ends = [
            round(steps * sum(s.steps for s in self.stages[: n + 1]) / self.steps)
            for n in range(len(self.stages))
        ]
        stages, done = [], 0
        for number, (stage, end) in enumerate(zip(self.stages, ends, strict=True)):
            left = len(self.stages) - number - 1
            count = min(max(1, end - done), steps - done - left)
            decay = stage.decay and max(count, round(stage.decay * count / stage.steps))
            stages.append(dataclasses.replace(stage, steps=count, decay=decay))
            done += count
        return dataclasses.replace(self, stages=tuple(stages))


def _refine(stage: ScheduleStage) -> ScheduleStage:
    """Give a stage narrower margins, and nearer negatives."""
    return dataclasses.replace(stage, margin=0.03, max_distance=0.015, near_share=0.5)


_STATES = (
    ("crumpled", 2.0),
    ("flung", 2.0),
    ("over_bar", 1.5),
    ("hung_two", 1.5),
    ("side_folded", 1.5),
    ("leg_folded", 1.5),
    ("end_folded", 1.5),
)
"""Weights of kinds of states in later stages."""
_YAW = TRAIN_PRESETS["yaw"]

SCHEDULES: Mapping[str, Schedule] = {
    "shipped": Schedule(
        base=dataclasses.replace(TRAIN_PRESETS["cpu"], save_every=100),
        stages=(
            # The first run was to go on for 12,000 steps; more garments had been made by step
            # 1,900.
            ScheduleStage(name="1_begin", steps=1900, lr=1.5e-3, decay=12_000),
            ScheduleStage(name="2_long", steps=3600, lr=1.5e-3),
            _refine(ScheduleStage(name="3_narrow", steps=1500, lr=1e-3)),
            _refine(ScheduleStage(name="4_fine", steps=750, lr=6e-4)),
            # Once more, with more garments; the yaw, which shares nothing with the features, by
            # itself at the end.
            ScheduleStage(name="5_more", steps=3300, lr=1.2e-3, parts="features"),
            _refine(ScheduleStage(name="6_narrow", steps=1400, lr=9e-4, parts="features")),
            _refine(ScheduleStage(name="7_fine", steps=700, lr=5e-4, parts="features")),
            _refine(
                ScheduleStage(name="8_flat", steps=1300, lr=6e-4, parts="features", flat_share=0.5)
            ),
            # Five times as many garments with all their states, and the hard ones among these more
            # often.
            ScheduleStage(
                name="9_states",
                steps=3200,
                lr=1.2e-3,
                parts="features",
                flat_share=0.25,
                state_weights=_STATES,
            ),
            _refine(
                ScheduleStage(
                    name="10_fine", steps=1400, lr=6e-4, parts="features", state_weights=_STATES
                )
            ),
            ScheduleStage(
                name="11_yaw",
                steps=9000,
                lr=_YAW.lr,
                parts="yaw",
                new_yaw=YawConfig(bins=72, rings=16, width=96),
                groups=_YAW.batch.groups,
                flat_share=_YAW.batch.flat_share,
                state_weights=_YAW.batch.state_weights,
                mirrored_share=_YAW.batch.mirrored_share,
                least_yaw_weight=_YAW.batch.least_yaw_weight,
            ),
        ),
    ),
}
"""Schedules by name: "shipped" is how the weights were made that come along."""


def get_schedule(name: str) -> Schedule:
    """Return a schedule; a `ValueError` lists them."""
    if name not in SCHEDULES:
        raise ValueError(f"schedule must be one of {sorted(SCHEDULES)}; got {name!r}")
    return SCHEDULES[name]


def train_schedule(
    folder: GarmentFolder,
    out: Path,
    schedule: Schedule,
    *,
    start: Path | None = None,
    seed: int = 0,
    is_resumed: bool = False,
    device: str | torch.device = "cpu",
    on_progress: Callable[[GamTrainProgress], None] | None = None,
    stop_after: int | None = None,
) -> Path:
    """Train a network in stages.

    Args:
        folder: Garments to train on. Stages that are finished are not repeated when a run is
            resumed, so that the others may have more garments.
        out: Folder of the run, with a folder for each stage; made if missing.
        schedule: The stages.
        start: Checkpoint that the first stage starts from.
        seed: Of the weights and of everything drawn.
        is_resumed: Whether to go on with the run in `out`; it then ends as it would have without
            the interruption.
        device: Where to compute.
        on_progress: Called after each step; steps are counted over all stages.
        stop_after: Save and stop after this step of all, as an interruption would.

    Returns:
        The network's file; the last stage's when stopped before the end.

    Raises:
        GamCheckpointError: If there is nothing to resume, the run had another schedule, or `start`
            does not fit.
        FileExistsError: If `out` holds a run and `is_resumed` is false.
        FloatingPointError: If the loss is not finite.
    """
    out = Path(out)
    configs = schedule.configure(seed=seed)
    described = {
        "stages": {s.name: c.to_dict() for s, c in zip(schedule.stages, configs, strict=True)}
    }
    _open_run(out, described, is_resumed=is_resumed)
    path, done = start, 0
    for stage, config in zip(schedule.stages, configs, strict=True):
        own = out / stage.name
        finished = own / NETWORK_FILE
        left = None if stop_after is None else stop_after - done
        if not _is_whole(finished, config.steps):
            finished = train(
                folder,
                own,
                config,
                start=path,
                is_resumed=(own / CONFIG_FILE).exists(),
                device=device,
                on_progress=_count_on(on_progress, done, schedule.steps),
                stop_after=left if left is not None and left < config.steps else None,
            )
        path, done = finished, done + config.steps
        if stop_after is not None and stop_after <= done and stage is not schedule.stages[-1]:
            return path
    assert path is not None
    if stop_after is not None and stop_after < done:
        return path
    with written_beside(out / NETWORK_FILE) as partial:
        shutil.copyfile(path, partial)
    return out / NETWORK_FILE


def _open_run(out: Path, described: Mapping[str, Any], *, is_resumed: bool) -> None:
    """Write what the run is, or compare with what it was begun as."""
    path = out / CONFIG_FILE
    if not path.exists():
        if is_resumed:
            raise GamCheckpointError(f"{out} holds no run to resume")
        out.mkdir(parents=True, exist_ok=True)
        write_text(path, json.dumps(described, indent=1))
        return
    if not is_resumed:
        raise FileExistsError(f"{out} holds a run already; resume it or choose another folder")
    if read_config(out) != json.loads(json.dumps(described)):
        raise GamCheckpointError(
            f"{out} was begun with other stages; resume it with the same preset, steps and seed, "
            "or start anew"
        )


def _is_whole(path: Path, steps: int) -> bool:
    return path.exists() and load_checkpoint(path).card.get("steps_done") == steps


def _count_on(
    on_progress: Callable[[GamTrainProgress], None] | None, done: int, steps: int
) -> Callable[[GamTrainProgress], None] | None:
    """Count the steps of one stage on from those of the stages before."""
    if on_progress is None:
        return None
    return lambda p: on_progress(dataclasses.replace(p, step=p.step + done, steps=steps))
