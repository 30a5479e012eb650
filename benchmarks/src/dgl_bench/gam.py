"""Speed of the affordance model: the time of a pair, and clouds a second in batches."""

import copy
import dataclasses
import statistics
import time
from collections.abc import Callable, Sequence

import numpy as np

from dgl_bench.rows import Row
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


def measure_speed(networks: Sequence[str], *, repeats: int, threads: int, seed: int) -> list[Row]:
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

    if repeats < 1 or threads < 1:
        raise ValueError(f"repeats and threads must be positive; got {repeats} and {threads}")
    rng = np.random.default_rng(seed)
    clouds = rng.uniform(-1, 1, (_BATCH, _POINTS, 3)) * [0.5, 0.4, 0.02]
    before = torch.get_num_threads()
    torch.set_num_threads(threads)
    try:
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
                rows.append(_skip_cuda(name))
    finally:
        torch.set_num_threads(before)
    return rows


def _measure_shipped(repeats: int, note: str) -> list[Row]:
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
    rows: list[Row] = []
    checkpoint = GarmentAffordanceModel.load(_SAMPLE).checkpoint
    for device, found in devices.items():
        rows += _measure(
            "shipped", _move(checkpoint, device), device, clouds, repeats, found, category=_SAMPLE
        )
    return rows if "cuda" in devices else [*rows, _skip_cuda("shipped")]


def _skip_cuda(name: str) -> Row:
    """Return the row of a missing device."""
    return Row(
        name=f"{name}, pair, cuda", value=None, unit="ms", note="no CUDA device", is_skipped=True
    )


def _measure_random(
    name: str, checkpoint: Checkpoint, device: str, clouds: np.ndarray, repeats: int, note: str
) -> list[Row]:
    """Measure a network of random weights, also where the yaw is in doubt."""
    checkpoint = _move(checkpoint, device)
    pair, *others = _measure(name, checkpoint, device, clouds, repeats, note)
    last = checkpoint.network.yaw.last.weight.data
    last /= _CERTAIN
    doubtful = _time(lambda: _match_new(checkpoint, device, clouds, None), repeats)
    last *= _CERTAIN
    row = Row(
        name=f"{name}, pair, yaw in doubt, {device}", value=doubtful * 1e3, unit="ms", note=note
    )
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
) -> list[Row]:
    points = clouds[0][:2]
    held = GarmentAffordanceModel(checkpoint, category=category, device=device)
    new = _time(lambda: _match_new(checkpoint, device, clouds, category), repeats)
    known = _time(lambda: held.match(clouds[0], points, clouds[1]), repeats)
    batch = _time(lambda: held.locate_batch(clouds[0], points, list(clouds)), max(1, repeats // 10))
    is_barred = name in ("shipped", "small") and device == "cpu"
    return [
        Row(
            name=f"{name}, pair, {device}",
            value=new * 1e3,
            unit="ms",
            bar=f"<= {_PAIR_BAR_MS:g}" if is_barred else "",
            note=note,
        ),
        Row(name=f"{name}, pair, source known, {device}", value=known * 1e3, unit="ms", note=note),
        Row(
            name=f"{name}, batch of {_BATCH}, {device}",
            value=_BATCH / batch,
            unit="clouds/s",
            note=note,
        ),
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


def _time(work: Callable[[], object], repeats: int) -> float:
    """Median duration [s] of results that have arrived on the CPU, after one untimed call."""
    work()
    times = []
    for _ in range(repeats):
        began = time.perf_counter()
        work()
        times.append(time.perf_counter() - began)
    return statistics.median(times)
