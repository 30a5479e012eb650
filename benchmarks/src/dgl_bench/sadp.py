"""Speed of the policies: the time of a chunk of joint targets, and training steps a second."""

import dataclasses
import statistics
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Literal

import numpy as np

from dgl_bench.rows import Reading
from dgl_bench.torch_timing import measure_median, torch_threads
from dgl_sadp import (
    DiffusionPolicy,
    PolicyRunner,
    TrainProgress,
    get_policy_config,
    get_train_config,
    train_policy,
)
from dgl_sadp.synthetic import SyntheticEnvironment, write_synthetic_episodes

__all__ = ["measure_speed"]

Precision = Literal["no", "bf16"]

_POINTS = 2048
_IMAGE = (480, 640)
_EPISODES = 4
_WINDOWS = 3_300  # The first stage of Fold Tops, 98 demonstrations: 3,273.
_WARM_UP = 3
_CHUNK_BAR_MS = 150.0


def measure_speed(
    methods: Sequence[str],
    *,
    size: str,
    device: str,
    precision: Precision,
    repeats: int,
    threads: int,
    seed: int,
) -> list[Reading]:
    """Measure policies with random weights on observations of the recorded sizes.

    Args:
        methods: Policies, by name.
        size: Their preset.
        device: "cpu" or "cuda".
        precision: Of training: "no" is float32, "bf16" mixes bfloat16 in.
        repeats: Timed chunks; the median counts. Of training steps it is a quarter.
        threads: Threads of the CPU.
        seed: Of weights and observations.

    Raises:
        ValueError: If `repeats` or `threads` is not positive, or there is no such policy or device.
    """
    import torch

    if device == "cuda" and not torch.cuda.is_available():
        raise ValueError("--device cuda: torch finds no CUDA device here")
    note = torch.cuda.get_device_name() if device == "cuda" else f"{threads} thread(s)"
    with torch_threads(threads, repeats):
        rows: list[Reading] = []
        for method in methods:
            policy = DiffusionPolicy.make(get_policy_config(method, size), seed=seed).to(device)
            rows += _measure_chunk(policy, method, size, device, repeats, note, seed)
            del policy
            steps = max(2, repeats // 4)
            rows += _measure_training(method, size, device, precision, steps, note, seed)
        return rows


def _measure_chunk(
    policy: DiffusionPolicy,
    method: str,
    size: str,
    device: str,
    repeats: int,
    note: str,
    seed: int,
) -> list[Reading]:
    environment = SyntheticEnvironment(points=_POINTS, image_size=_IMAGE)
    environment.reset(seed=seed)
    stage = environment.see_stage()
    stage["points_affordance_feature"] = environment.get_affordance()
    frames = [environment.execute(target) for target in environment.make_expert()[:5]]
    runner = PolicyRunner(policy, seed=seed)
    runner.reset(stage)
    runner.act(frames[0])

    def run_chunk() -> None:
        for frame in frames[1:4]:
            runner.observe(frame)
        runner.act(frames[4])

    steps = policy.config.diffusion.inference_steps
    # The bar is for ten denoising steps on one core; DP has a hundred, as published.
    is_barred = size == "small" and device == "cpu" and steps <= 10
    bar = f"<= {_CHUNK_BAR_MS:g}" if is_barred else ""
    wall, processor = measure_median(run_chunk, repeats)
    name = f"{method}, {size}, chunk of {runner.action_steps} targets"
    told = f"{steps} denoising steps, {note}"
    rows = [Reading(name, wall * 1e3, "ms", bar=bar, note=told)]
    if device == "cpu":
        # What is left of the time above where other programs want the cores too.
        rows.append(Reading(f"{name}, processor time", processor * 1e3, "ms", note=note))
    if policy.config.stage_keys:
        once, _ = measure_median(lambda: runner.reset(stage), repeats)
        rows.append(Reading(f"{method}, {size}, once a stage", once * 1e3, "ms", note=note))
    return rows


class _EnoughError(Exception):
    """Ends a training whose steps have been timed, without saving anything."""


def _measure_training(
    method: str, size: str, device: str, precision: Precision, repeats: int, note: str, seed: int
) -> list[Reading]:
    """Time training steps of the preset, reading included, on synthetic episodes in memory."""
    config = dataclasses.replace(
        get_train_config(method, size),
        precision=precision,
        validation_share=0.0,
        save_every=10**9,
        seed=seed,
    )
    times: list[float] = []

    def note_time(_: TrainProgress) -> None:
        times.append(time.perf_counter())
        if len(times) == _WARM_UP + repeats + 1:
            raise _EnoughError

    with TemporaryDirectory(prefix="dgl_bench_") as folder:
        episodes = Path(folder) / "episodes"
        policy = get_policy_config(method, size)
        # So many windows that an epoch is one batch.
        frames = config.batch // _EPISODES - (policy.observation_steps - 1)
        image_size = (48, 64) if policy.image is None else _IMAGE
        write_synthetic_episodes(
            episodes, _EPISODES, seed=seed, points=_POINTS, frames=frames, image_size=image_size
        )
        with suppress(_EnoughError):
            train_policy(
                episodes,
                Path(folder) / "run",
                policy,
                dataclasses.replace(config, epochs=_WARM_UP + repeats + 1),
                device=device,
                keep_bytes=2**40,
                on_progress=note_time,
            )
    seconds = statistics.median(np.diff(times[_WARM_UP:]).tolist())
    kind = "float32" if precision == "no" else "bfloat16"
    steps = config.epochs * -(-_WINDOWS // config.batch)
    name = f"{method}, {size}, {kind}"
    return [
        Reading(f"{name}, training, batch of {config.batch}", 1.0 / seconds, "steps/s", note=note),
        Reading(
            f"{name}, training of {config.epochs:,} epochs",
            steps * seconds / 3600.0,
            "h",
            note=f"{_WINDOWS:,} windows: a stage of 100 demonstrations; from the steps a second",
        ),
    ]
