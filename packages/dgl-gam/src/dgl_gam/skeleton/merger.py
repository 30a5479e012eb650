"""Skeleton Merger: key points whose active connecting lines look like the cloud.

Source: Shi, Xue, You and Lu 2021, Skeleton Merger: an Unsupervised Aligned Keypoint Detector, CVPR.
"""

import dataclasses

import torch
from torch import Tensor, nn

from dgl_gam.config import NetworkConfig
from dgl_gam.network import GarmentNetwork

__all__ = ["SkeletonMerger", "compute_composite_chamfer"]

_SHARPNESS = 20.0  # of the key points' distributions over the cloud: features are unit vectors
_MAX_OFFSET = 0.1  # of a skeleton's points from its line, in normalised units


class SkeletonMerger(nn.Module):
    """Finds key points in a cloud, and how strongly each two of them are connected."""

    def __init__(self, config: NetworkConfig, *, key_points: int, samples: int) -> None:
        """Set up the layers.

        Args:
            config: Network that gives points their features.
            key_points: How many.
            samples: Points on each line between two of them.
        """
        super().__init__()
        if key_points < 2 or samples < 2:
            raise ValueError(
                f"key_points and samples must be at least 2; got {key_points} and {samples}"
            )
        self.features = GarmentNetwork(dataclasses.replace(config, categories=()))
        self.score = nn.Linear(config.features, key_points)
        first, second = torch.triu_indices(key_points, key_points, offset=1)
        self.first: Tensor
        self.second: Tensor
        self.register_buffer("first", first)
        self.register_buffer("second", second)
        lines = len(first)
        self.whole = nn.Sequential(
            nn.Linear(config.features, 128), nn.LayerNorm(128), nn.ReLU(),
        )  # fmt: skip
        self.strength = nn.Linear(128, lines)
        self.offset = nn.Linear(128, lines * samples * 3)
        nn.init.zeros_(self.offset.weight)
        nn.init.zeros_(self.offset.bias)
        self.samples = samples

    def find(self, points: Tensor) -> tuple[Tensor, Tensor]:
        """Find the key points of clouds, shape (B, N, 3), in the normalised frame.

        Returns:
            Key points, shape (B, K, 3): each a mean of the cloud's points, and the features, shape
            (B, N, D).
        """
        features = self.features(points)
        share = (self.score(features) * _SHARPNESS).softmax(dim=1)  # (B, N, K)
        return share.mT @ points, features

    def forward(self, points: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Find key points and draw the lines between them.

        Args:
            points: Clouds in the normalised frame, shape (B, N, 3).

        Returns:
            Key points, shape (B, K, 3); points on the L = K (K - 1) / 2 lines, shape (B, L,
            samples, 3); and how strongly each line is switched on, shape (B, L), in (0, 1).
        """
        keys, features = self.find(points)
        start, end = keys[:, self.first], keys[:, self.second]  # (B, L, 3)
        along = torch.linspace(0, 1, self.samples, device=points.device)[:, None]
        lines = start.unsqueeze(2) * (1 - along) + end.unsqueeze(2) * along
        whole = self.whole(features.mean(dim=1))
        offset = self.offset(whole).reshape(lines.shape).tanh() * _MAX_OFFSET
        return keys, lines + offset, self.strength(whole).sigmoid()


def compute_composite_chamfer(points: Tensor, lines: Tensor, strength: Tensor) -> Tensor:
    """Compute the composite Chamfer distance between clouds and skeletons.

    Fidelity: lines that are switched on must lie in the cloud. Coverage: each point of the cloud
    must be near lines whose strengths add up to one, the nearest first; what is missing to one
    counts as the farthest line.

    Args:
        points: Clouds, shape (B, N, 3).
        lines: Points on the lines, shape (B, L, S, 3).
        strength: Shape (B, L), in [0, 1].

    Returns:
        Mean over the clouds.

    Source:
        Shi et al. 2021, section on the composite Chamfer distance. A line's fidelity is weighted by
        its length here, since lines have equally many points.
    """
    batch, count, samples, _ = lines.shape
    table = torch.cdist(lines.flatten(1, 2), points)  # (B, L * S, N)
    to_cloud = table.amin(dim=2).reshape(batch, count, samples).mean(dim=2)  # (B, L)
    length = (lines[:, :, -1] - lines[:, :, 0]).norm(dim=2).detach()
    weight = strength * length
    fidelity = (weight * to_cloud).sum(dim=1) / length.sum(dim=1).clamp(min=1e-6)
    to_line = table.reshape(batch, count, samples, -1).amin(dim=2)  # (B, L, N)
    distance, order = to_line.sort(dim=1)
    shares = strength.unsqueeze(2).expand_as(to_line).gather(1, order)
    before = shares.cumsum(dim=1) - shares
    used = torch.minimum(shares, (1 - before).clamp(min=0))
    missing = (1 - used.sum(dim=1)).clamp(min=0)
    coverage = (used * distance).sum(dim=1) + missing * distance[:, -1]
    return (fidelity + coverage.mean(dim=1)).mean()
