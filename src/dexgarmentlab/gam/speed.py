"""How fast the affordance model is: the time of a pair, and how many clouds a second."""

import statistics
import time
from collections.abc import Callable, Sequence

import numpy as np

from dexgarmentlab.bench_physics.rows import Row
from dgl_gam import GarmentAffordanceModel
from dgl_gam.checkpoint import Checkpoint
from dgl_gam.config import get_network_config
from dgl_gam.network import GarmentNetwork

__all__ = ["measure_speed"]

_POINTS = 2048
_BATCH = 32
_PAIR_BAR_MS = 40.0
_CERTAIN = 1e4  # factor on the scores of the yaw that leaves one angle


def measure_speed(networks: Sequence[str], *, repeats: int, threads: int, seed: int) -> list[Row]:
    """Measure networks on the CPU, and on CUDA where there is a device.

    Weights are random. They change one thing only: whether the yaw is in doubt, so that a second one is tried. It is
    made certain, as it nearly always is on garments, and measured in doubt as a row of its own.

    Args:
        networks: Presets of the network.
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
    rows: list[Row] = []
    before = torch.get_num_threads()
    torch.set_num_threads(threads)
    try:
        for name in networks:
            config = get_network_config(name)
            with torch.random.fork_rng():
                torch.manual_seed(seed)
                network = GarmentNetwork(config)
            with torch.no_grad():
                network.yaw.last.weight *= _CERTAIN
            checkpoint = Checkpoint(network=network)
            rows += _measure(name, checkpoint, "cpu", clouds, repeats, f"{threads} thread(s)")
            if torch.cuda.is_available():
                found = torch.cuda.get_device_name()
                rows += _measure(name, checkpoint, "cuda", clouds, repeats, found)
            else:
                note = "no CUDA device"
                rows += [
                    Row(
                        name=f"{name}, pair, cuda",
                        value=None,
                        unit="ms",
                        note=note,
                        is_skipped=True,
                    )
                ]
    finally:
        torch.set_num_threads(before)
    return rows


def _measure(
    name: str, checkpoint: Checkpoint, device: str, clouds: np.ndarray, repeats: int, note: str
) -> list[Row]:
    points = clouds[0][:2]

    def match_new() -> None:
        GarmentAffordanceModel(checkpoint, device=device).match(clouds[0], points, clouds[1])

    held = GarmentAffordanceModel(checkpoint, device=device)
    is_barred = name == "small" and device == "cpu"
    new = _time(match_new, repeats)
    last = checkpoint.network.yaw.last.weight.data
    last /= _CERTAIN
    doubtful = _time(match_new, repeats)
    last *= _CERTAIN
    known = _time(lambda: held.match(clouds[0], points, clouds[1]), repeats)
    batch = _time(lambda: held.locate_batch(clouds[0], points, list(clouds)), max(1, repeats // 10))
    return [
        Row(
            name=f"{name}, pair, {device}",
            value=new * 1e3,
            unit="ms",
            bar=f"<= {_PAIR_BAR_MS:g}" if is_barred else "",
            note=note,
        ),
        Row(
            name=f"{name}, pair, yaw in doubt, {device}", value=doubtful * 1e3, unit="ms", note=note
        ),
        Row(name=f"{name}, pair, source known, {device}", value=known * 1e3, unit="ms", note=note),
        Row(
            name=f"{name}, batch of {_BATCH}, {device}",
            value=_BATCH / batch,
            unit="clouds/s",
            note=note,
        ),
    ]


def _time(work: Callable[[], object], repeats: int) -> float:
    """Median duration [s] of results that have arrived on the CPU, after one untimed call."""
    work()
    times = []
    for _ in range(repeats):
        began = time.perf_counter()
        work()
        times.append(time.perf_counter() - began)
    return statistics.median(times)
