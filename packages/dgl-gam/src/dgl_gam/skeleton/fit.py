"""Training of the Skeleton Merger on garments that lie flat; nothing is told but the clouds."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import torch

from dgl_gam.augment import warp_clouds
from dgl_gam.config import get_network_config
from dgl_gam.network import center_clouds
from dgl_gam.skeleton.merger import SkeletonMerger, compute_composite_chamfer

__all__ = ["SkeletonConfig", "find_key_points", "fit_skeleton"]


@dataclass(frozen=True, kw_only=True)
class SkeletonConfig:
    """Settings of the learning of key points."""

    network: str = "small"
    """Preset of the network that gives points their features."""
    key_points: int = 12
    """Number of key points."""
    samples: int = 10
    """Points on each line between two of them."""
    steps: int = 300
    """Batches."""
    clouds: int = 8
    """Clouds in a batch."""
    points: int = 512
    """Points of a cloud that are used."""
    lr: float = 1e-3
    """Learning rate of Adam; falls to zero as a cosine."""
    yaw: float = math.radians(10.0)
    """Largest turn of a cloud, either way [rad]."""
    seed: int = 0
    """Seed of weights and of all random draws."""

    def __post_init__(self) -> None:
        for name in ("steps", "clouds", "points"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name} must be at least 1; got {getattr(self, name)}")
        if not self.lr > 0:
            raise ValueError(f"lr must be positive; got {self.lr}")


def fit_skeleton(
    clouds: Sequence[np.ndarray],
    config: SkeletonConfig,
    *,
    on_progress: Callable[[int, float], None] | None = None,
) -> SkeletonMerger:
    """Learn key points from clouds of one category.

    Args:
        clouds: Clouds of garments that lie flat, roughly turned alike, each of shape (N, 3) [m].
        config: How.
        on_progress: Called after each step with its number and loss.

    Returns:
        The network, in evaluation mode.

    Raises:
        ValueError: If there is no cloud.
    """
    if not clouds:
        raise ValueError("clouds must not be empty")
    rng = np.random.default_rng(config.seed)
    generator = torch.Generator().manual_seed(config.seed)
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(config.seed)
        network = SkeletonMerger(
            get_network_config(config.network),
            key_points=config.key_points,
            samples=config.samples,
        )
    optimizer = torch.optim.Adam(network.parameters(), lr=config.lr, foreach=False)
    for step in range(config.steps):
        for group in optimizer.param_groups:
            group["lr"] = config.lr * 0.5 * (1 + math.cos(math.pi * step / config.steps))
        batch = np.stack(
            [
                _draw(clouds[int(rng.integers(len(clouds)))], config.points, rng)
                for _ in range(config.clouds)
            ]
        )
        points = center_clouds(torch.from_numpy(batch))[0]
        points = center_clouds(warp_clouds(points, generator, yaw=config.yaw))[0]
        _, lines, strength = network(points)
        loss = compute_composite_chamfer(points, lines, strength)
        optimizer.zero_grad(set_to_none=True)
        loss.backward()
        torch.nn.utils.clip_grad_norm_(network.parameters(), 1.0)
        optimizer.step()
        if on_progress is not None:
            on_progress(step + 1, loss.item())
    return network.eval()


def find_key_points(network: SkeletonMerger, cloud: np.ndarray, *, points: int = 512) -> np.ndarray:
    """Find the key points of a cloud [m], shape (K, 3): the mean over four samplings."""
    rng = np.random.default_rng(0)
    drawn = torch.from_numpy(np.stack([_draw(cloud, points, rng) for _ in range(4)]))
    normal, mean, scale = center_clouds(drawn)
    with torch.inference_mode():
        keys = network.find(normal)[0] / scale + mean
    return keys.mean(dim=0).numpy().astype(np.float64)


def _draw(cloud: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
    chosen = rng.choice(len(cloud), count, replace=len(cloud) < count)
    return cloud[chosen].astype(np.float32)
