"""Episode files made by hand, as small as the format allows."""

from collections.abc import Callable, Iterator
from pathlib import Path

import h5py
import numpy as np
import pytest
import torch

from dgl_sadp.config import (
    ARM_JOINTS,
    DiffusionConfig,
    EncoderLevelConfig,
    GarmentConfig,
    ImageConfig,
    PointsConfig,
    PolicyConfig,
    UNetConfig,
)

POINTS = 5
METHODS = ("sadp", "sadp-g", "dp3", "dp")


@pytest.fixture(scope="module")
def one_thread() -> Iterator[None]:
    """Sums come out equal, bit for bit, on one number of threads alone."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


def write_episode(
    path: Path,
    *,
    frames: int = 12,
    success: bool = True,
    stages: int = 1,
    has_object: bool = False,
    approach_frames: int = 0,
    offset: float = 0.0,
    cloud: str | None = None,
) -> Path:
    """Write an episode whose arrays hold `offset` plus the frame's number."""
    with h5py.File(path, "w") as file:
        file.attrs.update({"format_version": 1, "task": "FoldTops-v1", "success": success})
        if cloud is not None:
            file.attrs["cloud"] = cloud
        for stage in range(1, stages + 1):
            count = (offset + 100 * (stage - 1) + np.arange(frames)).astype(np.float32)
            group = file.create_group(f"stage_{stage}")
            if approach_frames:
                group.attrs["approach_frames"] = approach_frames
            for key, shape in {
                "joint_state": (60,),
                "action": (60,),
                "ee_pose": (2, 7),
                "env_point_cloud": (POINTS, 6),
            }.items():
                values = np.broadcast_to(count.reshape(-1, *[1] * len(shape)), (frames, *shape)) + (
                    0.5 if key == "action" else 0.0
                )
                group.create_dataset(key, data=values.astype(np.float32))
            group.create_dataset("image", data=np.zeros((frames, 4, 6, 3), dtype=np.uint8))
            cloud = np.full((POINTS, 3), offset + stage, dtype=np.float32)
            group.create_dataset("garment_point_cloud", data=cloud)
            group.create_dataset("points_affordance_feature", data=cloud[:, :2] * 0)
            if has_object:
                group.create_dataset("object_point_cloud", data=cloud + 1)
    return path


@pytest.fixture
def make_episode() -> Callable[..., Path]:
    return write_episode


@pytest.fixture(params=METHODS)
def method(request) -> str:
    """Each policy."""
    return request.param


def make_tiny_config(method: str, **changes) -> PolicyConfig:
    """A policy that takes milliseconds: every part is there, as small as it may be."""
    points = PointsConfig(points=16, widths=(8, 16), features=8)
    garment = GarmentConfig(
        points=32,
        levels=(
            EncoderLevelConfig(centres=8, radius=0.4, neighbours=6, widths=(16,)),
            EncoderLevelConfig(centres=0, radius=0.0, neighbours=0, widths=(16,)),
        ),
        features=8,
    )
    parts = {
        "sadp": {"environment": points, "garment": garment, "object": points},
        "sadp-g": {"environment": points, "garment": garment},
        "dp3": {"environment": points},
        "dp": {"image": ImageConfig(height=32, width=32, widths=(16, 16, 16, 16))},
    }
    is_dp = method == "dp"
    values = {
        "method": method,
        "unet": UNetConfig(widths=(16, 32), step_embedding=8),
        "diffusion": DiffusionConfig(
            scheduler="ddpm" if is_dp else "ddim",
            prediction="epsilon" if is_dp else "sample",
            inference_steps=4,
        ),
        "state": () if is_dp else (16, 8),
        "relative_joints": ARM_JOINTS,
        **parts[method],
    }
    return PolicyConfig(**{**values, **changes})


@pytest.fixture(scope="session")
def tiny_config() -> Callable[..., PolicyConfig]:
    return make_tiny_config


def make_random_batch(config: PolicyConfig, count: int = 2, seed: int = 0) -> dict:
    """Windows of random content, with everything that any policy observes."""
    rng = np.random.default_rng(seed)
    steps = config.observation_steps

    def draw(*shape: int) -> torch.Tensor:
        return torch.from_numpy(rng.uniform(-1, 1, (count, *shape)).astype(np.float32))

    image = rng.integers(0, 256, (count, steps, 40, 48, 3), dtype=np.uint8)
    return {
        "stage": torch.from_numpy(rng.integers(0, config.stages, count)),
        "joint_state": draw(steps, config.joints),
        "start_joint_state": draw(config.joints),
        "env_point_cloud": draw(steps, 50, 6),
        "image": torch.from_numpy(image),
        "garment_point_cloud": draw(64, 3),
        "points_affordance_feature": draw(64, 2).abs(),
        "object_point_cloud": draw(40, 3),
        "action": draw(config.horizon, config.joints),
    }


@pytest.fixture
def random_batch() -> Callable[..., dict]:
    return make_random_batch


@pytest.fixture
def seeded() -> Callable[[int], torch.Generator]:
    return lambda seed=0: torch.Generator().manual_seed(seed)
