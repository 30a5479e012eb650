"""Sampling of clouds and their augmentation in training."""

from dataclasses import dataclass

import torch
from torch import Tensor

from dgl_sadp._random import Draws

__all__ = ["Augmentation", "thin_cloud"]


@dataclass(frozen=True, kw_only=True)
class Augmentation:
    """Changes of the clouds that leave the right action as it is.

    Clouds are not turned or moved: actions are joint targets, and would have to change with them.
    """

    jitter: float = 0.002
    """Standard deviation of noise on each coordinate [m]."""
    dropout: float = 0.3
    """Largest share of points left out; the others fill up."""

    def __post_init__(self) -> None:
        if not self.jitter >= 0.0:
            raise ValueError(f"jitter must be >= 0 m; got {self.jitter}")
        if not 0.0 <= self.dropout < 1.0:
            raise ValueError(f"dropout must lie in [0, 1); got {self.dropout}")


def thin_cloud(
    cloud: Tensor,
    count: int,
    draws: Draws,
    augmentation: Augmentation | None = None,
) -> Tensor:
    """Take points of clouds by chance, and vary them if asked to.

    Args:
        cloud: Position [m] and further channels, shape (B, N, C) or (B, To, N, C), with N >= 1.
        count: Points wanted. From fewer, points are repeated, each as often as the others or once
            more.
        draws: What draws.
        augmentation: How to vary; None leaves the points as they are.

    Returns:
        Shape (B, count, C) or (B, To, count, C).
    """
    size = cloud.shape[-2]
    rounds = -(-count // size)
    chosen = torch.cat([draws.permutation(size) for _ in range(rounds)])[:count]
    # The order of a cloud carries nothing, so one choice serves the whole batch.
    thinned = cloud.index_select(-2, chosen.to(cloud.device))
    if augmentation is None:
        return thinned
    if augmentation.dropout > 0.0:
        share = draws.uniform(thinned.shape[:-2]) * augmentation.dropout
        kept = ((1.0 - share) * count).ceil().clamp(1, count).to(torch.int64).to(cloud.device)
        index = torch.arange(count, device=cloud.device) % kept.unsqueeze(-1)  # (B, [To,] count)
        thinned = thinned.gather(-2, index.unsqueeze(-1).expand_as(thinned))
    if augmentation.jitter > 0.0:
        noise = draws.normal((*thinned.shape[:-1], 3)).to(cloud.device)
        positions = thinned[..., :3] + augmentation.jitter * noise
        thinned = torch.cat([positions, thinned[..., 3:]], dim=-1)
    return thinned
