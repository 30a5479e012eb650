"""Networks over point clouds: PointNet and PointNet++.

All norms are over the channels of one point: the same in training and evaluation.

Source: Qi et al., "PointNet" and "PointNet++", 2017; sizes in the configuration.
"""

from importlib.util import find_spec

import torch
from torch import Tensor, nn

from dgl_sadp.config import EncoderLevelConfig, GarmentConfig, PointsConfig

__all__ = ["GarmentNet", "PointsNet", "find_neighbours", "gather_points", "sample_farthest"]


def make_point_layers(width: int, widths: tuple[int, ...]) -> nn.Sequential:
    """Linear layers, each with layer norm and ReLU, on the last dimension."""
    layers: list[nn.Module] = []
    for following in widths:
        layers += [nn.Linear(width, following), nn.LayerNorm(following), nn.ReLU()]
        width = following
    return nn.Sequential(*layers)


class PointsNet(nn.Module):
    """One feature of a cloud, whatever the order of its points."""

    def __init__(self, config: PointsConfig) -> None:
        super().__init__()
        self.layers = make_point_layers(6 if config.use_color else 3, config.widths)
        self.out = nn.Sequential(
            nn.Linear(config.widths[-1], config.features), nn.LayerNorm(config.features)
        )

    def forward(self, points: Tensor) -> Tensor:
        """Map points, shape (B, N, C), to features, shape (B, features)."""
        return self.out(self.layers(points).amax(dim=1))


class GarmentNet(nn.Module):
    """One feature of a garment with its affordance: PointNet++ with single-scale grouping."""

    def __init__(self, config: GarmentConfig) -> None:
        super().__init__()
        width = 5 if config.use_affordance else 3
        levels: list[nn.Module] = []
        for level in config.levels:
            levels.append(_SetAbstraction(width, level))
            width = level.widths[-1]
            if level.centres:
                width += 3  # Position goes along as an input of the following level.
        self.levels = nn.ModuleList(levels)
        self.out = nn.Sequential(
            nn.Linear(width, config.features), nn.ReLU(), nn.LayerNorm(config.features)
        )

    def forward(self, points: Tensor) -> Tensor:
        """Map points, shape (B, N, 3 or 5), position first, to features, shape (B, features)."""
        positions, features = points[..., :3].contiguous(), points
        for level in self.levels:
            positions, features = level(positions, features)
        return self.out(features.squeeze(1))


class _SetAbstraction(nn.Module):
    """Groups points around centres; a centre's feature is the maximum over its group."""

    def __init__(self, width: int, config: EncoderLevelConfig) -> None:
        super().__init__()
        self.config = config
        # Relative positions are scaled to about [-1, 1]: they would be lost beside the features
        # else.
        self.scale = 1.0 / config.radius if config.centres else 1.0
        self.layers = make_point_layers(width + 3 if config.centres else width, config.widths)

    def forward(self, positions: Tensor, features: Tensor) -> tuple[Tensor, Tensor]:
        """Group.

        Args:
            positions: Shape (B, N, 3), normalised frame.
            features: Shape (B, N, C).

        Returns:
            Positions of the centres, shape (B, S, 3), and their features with their positions in
            front, shape (B, S, 3 + widths[-1]). Without centres the feature of the whole, shape (B,
            1, widths[-1]).
        """
        level = self.config
        if not level.centres:
            return positions, self.layers(features).amax(dim=1, keepdim=True)
        chosen = sample_farthest(positions, level.centres)
        centres = gather_points(positions, chosen)  # (B, S, 3)
        neighbours = find_neighbours(centres, positions, level.neighbours, level.radius)
        grouped = gather_points(torch.cat([positions, features], dim=2), neighbours)  # (B, S, K, .)
        relative = (grouped[..., :3] - centres.unsqueeze(2)) * self.scale
        found = self.layers(torch.cat([relative, grouped[..., 3:]], dim=3)).amax(dim=2)
        return centres, torch.cat([centres, found], dim=2)


@torch.no_grad()
def sample_farthest(points: Tensor, count: int) -> Tensor:
    """Choose points far from each other: each next one is the farthest from those before.

    The first is the farthest from the mean, so that neither the order of the cloud nor chance
    matters.

    Args:
        points: Clouds, shape (B, N, 3).
        count: How many, at most N.

    Returns:
        Indices, shape (B, count), int64.
    """
    batch, size, _ = points.shape
    if not 1 <= count <= size:
        raise ValueError(f"count must lie in 1 ... {size}; got {count}")
    planes = points.permute(2, 0, 1).contiguous()  # (3, B, N): sums over the first are fast
    centre = planes.mean(dim=2, keepdim=True)
    index = (planes - centre).square().sum(dim=0).argmax(dim=1)  # (B,)
    if points.is_cuda and find_spec("triton") is not None:  # It comes with torch on Linux.
        from dgl_sadp._farthest_triton import choose_farthest

        return choose_farthest(planes, index, count)
    chosen = torch.empty(count, batch, dtype=torch.int64, device=points.device)
    nearest = points.new_full((batch, size), torch.inf)
    squared = torch.empty_like(nearest)
    offsets = torch.empty_like(planes)
    rows = torch.arange(batch, device=points.device)
    for step in range(count):
        chosen[step] = index
        torch.sub(planes, planes[:, rows, index].unsqueeze(2), out=offsets)
        torch.sum(offsets.square_(), dim=0, out=squared)
        torch.minimum(nearest, squared, out=nearest)
        nearest[rows, index] = -1.0  # Rounding must not let a chosen point be chosen again.
        index = nearest.argmax(dim=1)
    return chosen.T.contiguous()


@torch.no_grad()
def find_neighbours(centres: Tensor, points: Tensor, count: int, radius: float) -> Tensor:
    """Find the nearest points of each centre within a radius.

    Args:
        centres: Shape (B, S, 3).
        points: Shape (B, N, 3).
        count: Neighbours wanted.
        radius: Largest distance.

    Returns:
        Indices, shape (B, S, min(count, N)), int64, nearest first. Where fewer points are within
        the radius, the nearest one fills up.
    """
    squared = torch.baddbmm(points.square().sum(dim=2).unsqueeze(1), centres, points.mT, alpha=-2)
    squared += centres.square().sum(dim=2, keepdim=True)
    distances, indices = squared.topk(min(count, points.shape[1]), dim=2, largest=False)
    return torch.where(distances <= radius * radius, indices, indices[:, :, :1])


def gather_points(values: Tensor, indices: Tensor) -> Tensor:
    """Take rows of `values`, shape (B, N, C), by `indices`, shape (B, ...): shape (B, ..., C)."""
    batch, size, channels = values.shape
    start = torch.arange(batch, device=values.device).mul_(size)
    rows = indices + start.reshape(batch, *[1] * (indices.ndim - 1))
    # Selecting rows copies each at once; `gather` would go by single values.
    taken = values.reshape(batch * size, channels).index_select(0, rows.reshape(-1))
    return taken.reshape(*indices.shape, channels)
