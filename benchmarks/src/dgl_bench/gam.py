"""Speed of the affordance model: the time of a pair, and clouds a second in batches."""

import copy
import dataclasses
from collections.abc import Sequence

import numpy as np

from dgl_bench.rows import NO_CUDA, Reading
from dgl_bench.torch_timing import measure_median, torch_threads
from dgl_gam import GarmentAffordanceModel
from dgl_gam.checkpoint import Checkpoint
from dgl_gam.config import get_network_config
from dgl_gam.network import GarmentNetwork
from dgl_gam.samples import load_samples

__all__ = ["measure_speed"]

_POINTS = 2048
_BATCH = 32
_PAIR_BAR_MS = 40.0
_SAMPLE = "Tops_LongSleeve"
_CERTAIN = 1e4  # factor on the scores of the yaw that leaves one angle


def measure_speed(
    networks: Sequence[str], *, repeats: int, threads: int, seed: int
) -> list[Reading]:
    """Measure shipped and random weights on the CPU, and on CUDA where there is a device.

    Random weights leave the yaw in doubt, so that a second one is tried. It is made certain, as it
    nearly always is on garments; a row of its own measures it in doubt. The shipped weights, whose
    network of the yaw is larger than the presets', see shipped garments.

    Args:
        networks: Presets of the network; the shipped weights are always measured.
        repeats: Timed pairs; the median counts.
        threads: Threads of the CPU.
        seed: Of weights and clouds.

    Raises:
        ValueError: If `repeats` or `threads` is not positive, or there is no such network.
    """
    import torch

    rng = np.random.default_rng(seed)
    clouds = rng.uniform(-1, 1, (_BATCH, _POINTS, 3)) * [0.5, 0.4, 0.02]
    with torch_threads(threads, repeats):
        rows = _measure_shipped(repeats, f"{threads} thread(s)")
        for name in networks:
            config = get_network_config(name)
            with torch.random.fork_rng():
                torch.manual_seed(seed)
                network = GarmentNetwork(config)
            with torch.no_grad():
                network.yaw.last.weight *= _CERTAIN
            checkpoint = Checkpoint(network=network)
            rows += _measure_random(
                name, checkpoint, "cpu", clouds, repeats, f"{threads} thread(s)"
            )
            if torch.cuda.is_available():
                found = torch.cuda.get_device_name()
                rows += _measure_random(name, checkpoint, "cuda", clouds, repeats, found)
            else:
                rows.append(Reading.skip(f"{name}, pair, cuda", "ms", NO_CUDA))
    return rows


def _measure_shipped(repeats: int, note: str) -> list[Reading]:
    """Measure the shipped weights on shipped flat garments in random yaw."""
    import torch

    shown, seen = load_samples(_SAMPLE)
    clouds = np.stack([shown.view_points[0], *([seen.view_points[0]] * (_BATCH - 1))])
    angles = np.linspace(0, 2 * np.pi, _BATCH, endpoint=False)
    turns = np.zeros((_BATCH, 3, 3))
    turns[:, 0, 0] = turns[:, 1, 1] = np.cos(angles)
    turns[:, 1, 0] = np.sin(angles)
    turns[:, 0, 1] = -turns[:, 1, 0]
    turns[:, 2, 2] = 1
    clouds = clouds.astype(np.float64) @ turns.transpose(0, 2, 1)
    devices = {"cpu": note}
    if torch.cuda.is_available():
        devices["cuda"] = torch.cuda.get_device_name()
    rows: list[Reading] = []
    checkpoint = GarmentAffordanceModel.load(_SAMPLE).checkpoint
    for device, found in devices.items():
        rows += _measure(
            "shipped", _move(checkpoint, device), device, clouds, repeats, found, category=_SAMPLE
        )
    if "cuda" not in devices:
        rows.append(Reading.skip("shipped, pair, cuda", "ms", NO_CUDA))
    return rows


def _measure_random(
    name: str, checkpoint: Checkpoint, device: str, clouds: np.ndarray, repeats: int, note: str
) -> list[Reading]:
    """Measure a network of random weights, also where the yaw is in doubt."""
    checkpoint = _move(checkpoint, device)
    pair, *others = _measure(name, checkpoint, device, clouds, repeats, note)
    last = checkpoint.network.yaw.last.weight.data
    last /= _CERTAIN
    doubtful, _ = measure_median(lambda: _match_new(checkpoint, device, clouds, None), repeats)
    last *= _CERTAIN
    row = Reading(f"{name}, pair, yaw in doubt, {device}", doubtful * 1e3, "ms", note=note)
    return [pair, row, *others]


def _measure(
    name: str,
    checkpoint: Checkpoint,
    device: str,
    clouds: np.ndarray,
    repeats: int,
    note: str,
    *,
    category: str | None = None,
) -> list[Reading]:
    points = clouds[0][:2]
    held = GarmentAffordanceModel(checkpoint, category=category, device=device)
    new, _ = measure_median(lambda: _match_new(checkpoint, device, clouds, category), repeats)
    known, _ = measure_median(lambda: held.match(clouds[0], points, clouds[1]), repeats)
    batch, _ = measure_median(
        lambda: held.locate_batch(clouds[0], points, list(clouds)), max(1, repeats // 10)
    )
    bar = f"<= {_PAIR_BAR_MS:g}" if name in ("shipped", "small") and device == "cpu" else ""
    return [
        Reading(f"{name}, pair, {device}", new * 1e3, "ms", bar=bar, note=note),
        Reading(f"{name}, pair, source known, {device}", known * 1e3, "ms", note=note),
        Reading(f"{name}, batch of {_BATCH}, {device}", _BATCH / batch, "clouds/s", note=note),
    ]


def _move(checkpoint: Checkpoint, device: str) -> Checkpoint:
    """Copy the checkpoint to a device, so that the copy is not timed."""
    return dataclasses.replace(checkpoint, network=copy.deepcopy(checkpoint.network).to(device))


def _match_new(
    checkpoint: Checkpoint, device: str, clouds: np.ndarray, category: str | None
) -> None:
    """Match a pair, both clouds computed anew."""
    model = GarmentAffordanceModel(checkpoint, category=category, device=device)
    model.match(clouds[0], clouds[0][:2], clouds[1])
