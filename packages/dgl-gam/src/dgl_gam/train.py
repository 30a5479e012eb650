"""Training: a run is a folder with configuration, log, state and result."""

import dataclasses
import json
import logging
import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from importlib import metadata
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import torch
from annotated_types import Interval
from torch import Tensor

from dgl_files.fields import STRICT, check_fields
from dgl_gam._device import find_device
from dgl_gam.checkpoint import Checkpoint, load_checkpoint, save_checkpoint
from dgl_gam.config import NetworkConfig, YawConfig, get_network_config
from dgl_gam.data.batches import Batch, BatchConfig, BatchMaker
from dgl_gam.data.folder import GarmentFolder
from dgl_gam.errors import GamCheckpointError
from dgl_gam.loss import compute_info_nce
from dgl_gam.network import GarmentNetwork
from dgl_gam.run_files import CONFIG_FILE, LOG_FILE, begin_run, save_state

__all__ = ["TRAIN_PRESETS", "GamTrainConfig", "GamTrainProgress", "get_train_config", "train"]

logger = logging.getLogger(__name__)

NETWORK_FILE = "network.safetensors"
Positive = Annotated[int, Interval(ge=1, le=10**9)]


@dataclass(frozen=True, kw_only=True)
class GamTrainConfig:
    """Settings of a training."""

    __pydantic_config__ = STRICT

    network: str = "small"
    """Preset of the network; not used when training starts from other weights."""
    steps: Positive = 3000
    """Batches."""
    lr: float = 1.5e-3
    """Largest learning rate, of AdamW."""
    warmup: Annotated[int, Interval(ge=0, le=10**9)] = 50
    """Steps over which it rises; it then falls to zero as a cosine."""
    decay: int | None = None
    """Step at which the learning rate would reach zero; later than the last step for a run that
    ends early."""
    weight_decay: float = 1e-4
    """Weight decay."""
    temperature: float = 0.07
    """Of InfoNCE."""
    yaw_share: float = 0.3
    """Weight of the yaw's loss beside InfoNCE."""
    max_gradient: float = 1.0
    """Norm that gradients are clipped to."""
    seed: Annotated[int, Interval(ge=0, le=2**63 - 1)] = 0
    """Seed of weights and of all random draws."""
    save_every: Positive = 200
    """Steps between saved states."""
    parts: Literal["all", "features", "yaw"] = "all"
    """Trained part of the network."""
    new_yaw: YawConfig | None = None
    """Sizes of a new yaw network that replaces the one of `start`."""
    batch: BatchConfig = field(default_factory=BatchConfig)
    """Contents of a batch."""

    def __post_init__(self) -> None:
        check_fields(self)
        for name in ("lr", "temperature", "max_gradient"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} must be positive; got {getattr(self, name)}")
        if self.decay is not None and self.decay < self.steps:
            raise ValueError(f"decay must not be below steps; got {self.decay} and {self.steps}")
        if self.new_yaw is not None and self.parts == "features":
            raise ValueError("new_yaw must be None where the yaw is not trained")

    def to_dict(self) -> dict[str, Any]:
        """Plain values, as a run's folder stores them."""
        return dataclasses.asdict(self)


TRAIN_PRESETS: Mapping[str, GamTrainConfig] = {
    # Half of the points and more pairs of them: more is learned in the same time.
    "cpu": GamTrainConfig(batch=BatchConfig(points=1024, positives=48)),
    # Refines what another run has learned: near negatives, narrower margins, a small learning rate.
    "tune": GamTrainConfig(
        steps=600,
        lr=3e-4,
        batch=BatchConfig(positives=48, near_share=0.7, margin=0.03, max_distance=0.015, near=0.15),
    ),
    # The yaw alone: many clouds, also mirrored ones, and more of the states whose yaw is hard to
    # see.
    "yaw": GamTrainConfig(
        steps=3500,
        lr=2e-3,
        parts="yaw",
        batch=BatchConfig(
            groups=16,
            points=1024,
            flat_share=0.25,
            state_weights=(
                ("crumpled", 1.5),
                ("hung_two", 1.5),
                ("sleeve_folded", 1.5),
                ("side_folded", 3.0),
                ("leg_folded", 3.0),
                ("end_folded", 3.0),
                ("flat", 0.5),
            ),
            mirrored_share=0.5,
            least_yaw_weight=0.3,
        ),
    ),
    # Source: paper, section on GAM: 32 pairs, 20 positives, 150 negatives, 40,000 batches.
    "paper": GamTrainConfig(
        network="paper",
        steps=40_000,
        lr=1e-3,
        warmup=500,
        save_every=1000,
        batch=BatchConfig(groups=32, group_size=2),
    ),
}
"""Presets: "cpu" from random weights on a CPU, "tune" and "yaw" from other weights, "paper" for a
GPU."""


def get_train_config(name: str) -> GamTrainConfig:
    """Return a preset; a `ValueError` lists them."""
    if name not in TRAIN_PRESETS:
        raise ValueError(f"preset must be one of {sorted(TRAIN_PRESETS)}; got {name!r}")
    return TRAIN_PRESETS[name]


@dataclass(frozen=True, kw_only=True)
class GamTrainProgress:
    """Progress of a training."""

    step: int
    """Steps done."""
    steps: int
    """Steps to do in all."""
    loss: float
    """InfoNCE of the last batch."""
    accuracy: float
    """Share of its points whose counterpart was the most similar."""
    yaw_loss: float
    """Cross entropy of the yaw."""
    seconds: float
    """Duration of the step [s]."""


def train(
    folder: GarmentFolder,
    out: Path,
    config: GamTrainConfig,
    *,
    start: Path | None = None,
    is_resumed: bool = False,
    device: str | torch.device = "cpu",
    on_progress: Callable[[GamTrainProgress], None] | None = None,
    stop_after: int | None = None,
) -> Path:
    """Train a network for all categories of a folder.

    Args:
        folder: Garments to train on.
        out: Folder of the run; made if missing.
        config: How to train.
        start: Checkpoint whose weights training starts from; the network is then that of the
            checkpoint.
        is_resumed: Whether to go on with the run in `out`. It ends as it would have without the
            interruption, bitwise on a CPU with the same number of threads.
        device: Where to compute.
        on_progress: Called after each step.
        stop_after: Save and stop after this step, as an interruption would.

    Returns:
        The network's file.

    Raises:
        GamCheckpointError: If there is nothing to resume, the run had another configuration, or
            `start` does not fit.
        FileExistsError: If `out` holds a run and `is_resumed` is false.
        ValueError: If the device is not there.
        FloatingPointError: If the loss is not finite.
    """
    device = find_device(device)
    out = Path(out)
    if not is_resumed and (out / CONFIG_FILE).exists():
        raise FileExistsError(f"{out} holds a run already; resume it or choose another folder")
    network = _make_network(folder, config, start).to(device).train()
    parameters = _choose_parameters(network, config)
    optimizer = torch.optim.AdamW(
        parameters.values(), lr=config.lr, weight_decay=config.weight_decay, foreach=False
    )
    described = {
        "train": config.to_dict(),
        "network": json.loads(network.config.to_json()),
        "garments": [f"{h.category} {h.garment_id}" for h in folder.headers],
    }
    done = begin_run(out, described, parameters, optimizer, is_resumed=is_resumed)
    maker = BatchMaker(folder, config.batch, seed=config.seed)
    numbers = [network.config.categories.index(c) for c in folder.categories]
    with (out / LOG_FILE).open("a", encoding="utf-8", buffering=1) as log:
        for step in range(done, config.steps):
            began = time.perf_counter()
            batch = maker.make(step, has_pairs=config.parts != "yaw").to(device)
            category = torch.tensor(numbers, device=device)[batch.category]
            losses = _compute_losses(network, batch, category, config)
            _descend(losses.total, optimizer, config, step)
            progress = losses.report(step, config, seconds=time.perf_counter() - began)
            log.write(json.dumps(dataclasses.asdict(progress)) + "\n")
            if on_progress is not None:
                on_progress(progress)
            is_last = step + 1 in (config.steps, stop_after)
            if is_last or (step + 1) % config.save_every == 0:
                save_state(out, described, parameters, optimizer, step + 1)
            if step + 1 == stop_after:
                break
    card = _make_card(
        folder, config, start, steps_done=min(config.steps, stop_after or config.steps)
    )
    path = out / NETWORK_FILE
    save_checkpoint(path, Checkpoint(network=network.eval(), card=card))
    return path


class _Losses(NamedTuple):
    """Losses of a batch; 0 for what is not trained."""

    total: Tensor
    match: Tensor
    accuracy: Tensor
    yaw: Tensor

    def report(self, step: int, config: GamTrainConfig, *, seconds: float) -> GamTrainProgress:
        """Progress after the step."""
        return GamTrainProgress(
            step=step + 1,
            steps=config.steps,
            loss=self.match.item(),
            accuracy=self.accuracy.item(),
            yaw_loss=self.yaw.item(),
            seconds=seconds,
        )


def _choose_parameters(network: GarmentNetwork, config: GamTrainConfig) -> dict[str, Tensor]:
    """Parameters that are trained, by name."""
    wanted = {"all": (True, False), "yaw": (True,), "features": (False,)}[config.parts]
    return {n: p for n, p in network.named_parameters() if n.startswith("yaw.") in wanted}


def _compute_losses(
    network: GarmentNetwork, batch: Batch, category: Tensor, config: GamTrainConfig
) -> _Losses:
    match = accuracy = yaw = batch.points.new_zeros(())
    if config.parts != "yaw":
        features = network(batch.points, category)
        match, accuracy = compute_info_nce(features, batch, temperature=config.temperature)
    if config.parts != "features":
        logits = network.yaw(batch.turned)
        yaw = network.yaw.compute_loss(logits, batch.yaw, batch.yaw_weight)
    share = 1.0 if config.parts == "yaw" else config.yaw_share
    return _Losses(match + share * yaw, match, accuracy, yaw)


def _descend(
    loss: Tensor, optimizer: torch.optim.Optimizer, config: GamTrainConfig, step: int
) -> None:
    """Make one step of the optimiser."""
    parameters = []
    for group in optimizer.param_groups:
        group["lr"] = _get_lr(config, step)
        parameters += group["params"]
    optimizer.zero_grad(set_to_none=True)
    loss.backward()
    norm = torch.nn.utils.clip_grad_norm_(parameters, config.max_gradient)
    if not torch.isfinite(norm):
        raise FloatingPointError(f"the gradient of step {step + 1} is not finite")
    optimizer.step()


def _make_card(
    folder: GarmentFolder, config: GamTrainConfig, start: Path | None, *, steps_done: int
) -> dict[str, Any]:
    """Model card of a run."""
    return {
        "train": config.to_dict(),
        "earlier": [] if start is None else _describe_earlier(start),
        "steps_done": steps_done,
        **_describe_data(folder),
        "categories": list(folder.categories),
        "versions": {name: metadata.version(name) for name in ("torch", "numpy", "safetensors")},
    }


def _describe_data(folder: GarmentFolder) -> dict[str, Any]:
    """Describe the training data."""
    headers = folder.headers
    return {
        "garments": len(headers),
        "deformed": sum(len(h.state_names) > 1 for h in headers),
        "states": sorted({kind for h in headers for kind in h.state_kinds}),
        "generators": sorted(
            {f"{k} {v}" for h in headers for k, v in h.generator_versions.items()}
        ),
    }


def _describe_earlier(start: Path) -> list[dict[str, Any]]:
    """List the trainings behind the initial weights, oldest first."""
    card = load_checkpoint(start).card
    last = {name: card.get(name, "unknown") for name in ("steps_done", "garments", "deformed")}
    last["parts"] = card.get("train", {}).get("parts", "all")
    return [*card.get("earlier", []), last]


def _make_network(
    folder: GarmentFolder, config: GamTrainConfig, start: Path | None
) -> GarmentNetwork:
    if start is not None:
        network = load_checkpoint(start).network
        unknown = sorted(set(folder.categories) - set(network.config.categories))
        if unknown:
            raise GamCheckpointError(
                f"{start} is for {', '.join(network.config.categories)}; "
                f"the data have {', '.join(unknown)}"
            )
        if config.new_yaw is None:
            return network
        sizes = dataclasses.replace(network.config, yaw=config.new_yaw)
        changed = _make_seeded(sizes, config.seed)
        kept = {n: t for n, t in network.state_dict().items() if not n.startswith("yaw.")}
        changed.load_state_dict(kept, strict=False)
        return changed
    sizes = dataclasses.replace(get_network_config(config.network), categories=folder.categories)
    if config.new_yaw is not None:
        sizes = dataclasses.replace(sizes, yaw=config.new_yaw)
    return _make_seeded(sizes, config.seed)


def _make_seeded(sizes: NetworkConfig, seed: int) -> GarmentNetwork:
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        return GarmentNetwork(sizes)


def _get_lr(config: GamTrainConfig, step: int) -> float:
    if step < config.warmup:
        return config.lr * (step + 1) / config.warmup
    last = config.decay or config.steps
    share = (step - config.warmup) / max(1, last - config.warmup)
    return config.lr * 0.5 * (1 + math.cos(math.pi * share))
