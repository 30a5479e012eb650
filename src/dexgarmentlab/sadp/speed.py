"""How fast the policies are: the time of a chunk of joint targets, and training steps a second."""

import statistics
import time
from collections.abc import Callable, Sequence

import numpy as np

from dexgarmentlab.bench_physics.rows import Row
from dgl_sadp import DiffusionPolicy, PolicyRunner, get_policy_config, get_train_config
from dgl_sadp.optimizers import make_optimizers
from dgl_sadp.synthetic import SyntheticEnvironment

__all__ = ["measure_speed"]

_POINTS = 2048
_IMAGE = (480, 640)
_BATCH = 64
_CHUNK_BAR_MS = 150.0


def measure_speed(
    methods: Sequence[str], *, size: str, device: str, repeats: int, threads: int, seed: int
) -> list[Row]:
    """Measure policies with random weights on observations of the recorded sizes.

    Args:
        methods: Policies, by name.
        size: Their preset.
        device: "cpu" or "cuda".
        repeats: Timed chunks; the median counts. Of training steps it is a quarter.
        threads: Threads of the CPU.
        seed: Of weights and observations.

    Raises:
        ValueError: If `repeats` or `threads` is not positive, or there is no such policy or device.
    """
    import torch

    if repeats < 1 or threads < 1:
        raise ValueError(f"repeats and threads must be positive; got {repeats} and {threads}")
    if device == "cuda" and not torch.cuda.is_available():
        raise ValueError("--device cuda: torch finds no CUDA device here")
    note = torch.cuda.get_device_name() if device == "cuda" else f"{threads} thread(s)"
    before = torch.get_num_threads()
    torch.set_num_threads(threads)
    try:
        rows: list[Row] = []
        for method in methods:
            policy = DiffusionPolicy.make(get_policy_config(method, size), seed=seed).to(device)
            rows += _measure_chunk(policy, method, size, device, repeats, note, seed)
            rows.append(_measure_training(policy, method, size, max(2, repeats // 4), note, seed))
        return rows
    finally:
        torch.set_num_threads(before)


def _measure_chunk(
    policy: DiffusionPolicy,
    method: str,
    size: str,
    device: str,
    repeats: int,
    note: str,
    seed: int,
) -> list[Row]:
    environment = SyntheticEnvironment(points=_POINTS, image_size=_IMAGE)
    environment.reset(seed=seed)
    stage = environment.begin_stage(1)
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
    wall, processor = _time(run_chunk, repeats)
    name = f"{method}, {size}, chunk of {runner.action_steps} targets"
    rows = [
        Row(
            name=name,
            value=wall * 1e3,
            unit="ms",
            bar=f"<= {_CHUNK_BAR_MS:g}" if is_barred else "",
            note=f"{steps} denoising steps, {note}",
        )
    ]
    if device == "cpu":
        # What is left of the time above where other programs want the cores too.
        rows.append(
            Row(name=f"{name}, processor time", value=processor * 1e3, unit="ms", note=note)
        )
    if policy.config.stage_keys:
        rows.append(
            Row(
                name=f"{method}, {size}, once a stage",
                value=_time(lambda: runner.reset(stage), repeats)[0] * 1e3,
                unit="ms",
                note=note,
            )
        )
    return rows


def _measure_training(
    policy: DiffusionPolicy, method: str, size: str, repeats: int, note: str, seed: int
) -> Row:
    import torch

    config = policy.config
    rng = np.random.default_rng(seed)
    shapes = {
        "joint_state": (config.observation_steps, config.joints),
        "start_joint_state": (config.joints,),
        "env_point_cloud": (config.observation_steps, _POINTS, 6),
        "garment_point_cloud": (_POINTS, 3),
        "points_affordance_feature": (_POINTS, 2),
        "object_point_cloud": (_POINTS, 3),
        "action": (config.horizon, config.joints),
    }
    seen = {*config.frame_keys, *config.stage_keys, "start_joint_state", "action"}
    batch = {
        key: torch.from_numpy(rng.uniform(-1, 1, (_BATCH, *shape)).astype(np.float32))
        for key, shape in shapes.items()
        if key in seen
    }
    if "image" in seen:
        shape = (_BATCH, config.observation_steps, *_IMAGE, 3)
        batch["image"] = torch.from_numpy(rng.integers(0, 256, shape, dtype=np.uint8))
    batch = {key: values.to(policy.device) for key, values in batch.items()}
    training = get_train_config(method, size)
    optimizers = make_optimizers(policy, training)
    generator = torch.Generator(policy.device).manual_seed(seed)
    policy.train()

    def run_step() -> None:
        loss = policy(batch, generator, training.augmentation)
        policy.zero_grad(set_to_none=True)
        loss.backward()
        for optimizer in optimizers:
            optimizer.step()
        loss.item()  # On CUDA: waits for the result.

    seconds, _ = _time(run_step, repeats)
    return Row(
        name=f"{method}, {size}, training, batch of {_BATCH}",
        value=1.0 / seconds,
        unit="steps/s",
        note=note,
    )


def _time(work: Callable[[], object], repeats: int) -> tuple[float, float]:
    """Median duration and processor time [s], after one untimed call."""
    work()
    times, processor = [], []
    for _ in range(repeats):
        began, used = time.perf_counter(), time.process_time()
        work()
        times.append(time.perf_counter() - began)
        processor.append(time.process_time() - used)
    return statistics.median(times), statistics.median(processor)
