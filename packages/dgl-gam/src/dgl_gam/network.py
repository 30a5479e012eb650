"""The network: every point of a garment's cloud gets a feature; equal places get similar ones."""

import torch
from torch import Tensor, nn
from torch.nn import functional

from dgl_gam._layers import AttentionBlock, FeaturePropagation, SetAbstraction, make_mlp
from dgl_gam._sampling import gather_points, sample_farthest
from dgl_gam._yaw import YawNetwork
from dgl_gam.config import NetworkConfig

__all__ = ["GarmentNetwork", "center_clouds"]

RMS_RADIUS = 0.5
"""Root mean square distance of a normalised cloud to its mean: a garment then about fills [-1,
1]."""


def center_clouds(points: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Bring clouds into the normalised frame: mean 0, root mean square radius 0.5; not turned.

    Unlike extents along the axes, this does not change when a garment is turned.

    Args:
        points: Shape (B, N, 3) [m].

    Returns:
        Clouds, shape (B, N, 3); means [m], shape (B, 1, 3); scales [1/m], shape (B, 1, 1).
    """
    mean = points.mean(dim=1, keepdim=True)
    centred = points - mean
    rms = centred.square().sum(dim=2, keepdim=True).mean(dim=1, keepdim=True).sqrt()
    scale = RMS_RADIUS / rms.clamp(min=1e-12)
    return centred * scale, mean, scale


class GarmentNetwork(nn.Module):
    """PointNet++ with attention among the coarsest centres, and a network for the yaw."""

    def __init__(self, config: NetworkConfig) -> None:
        """Set up the layers of a configuration."""
        super().__init__()
        self.config = config
        self.yaw = YawNetwork(config.yaw)
        self.down = nn.ModuleList()
        widths = [3]  # the first level's features are positions
        for level in config.levels:
            self.down.append(
                SetAbstraction(
                    widths[-1],
                    level.widths,
                    neighbours=level.neighbours if level.centres else 0,
                    radius=level.radius,
                )
            )
            widths.append(level.widths[-1])
        coarsest = widths[-1]
        self.position = nn.Linear(3, coarsest)
        self.blocks = nn.ModuleList(
            AttentionBlock(coarsest, config.attention_heads) for _ in range(config.attention_blocks)
        )
        many = len(config.categories) > 1
        self.category = nn.Embedding(len(config.categories), coarsest) if many else None
        self.up = nn.ModuleList()
        width = coarsest
        for level, up in zip(reversed(range(len(config.levels))), config.up, strict=True):
            # As the original: the finest level sees positions twice, as coordinates and as
            # features.
            skip = widths[level] if level else 6
            self.up.append(FeaturePropagation(width, skip, up))
            width = up[-1]
        self.head = nn.Sequential(
            make_mlp(width, (config.head_width,)), nn.Linear(config.head_width, config.features)
        )

    def forward(
        self, points: Tensor, category: Tensor | None = None, queries: Tensor | None = None
    ) -> Tensor:
        """Compute the features.

        Args:
            points: Clouds in the normalised frame, turned into the garment's own, shape (B, N, 3).
            category: Index into the configuration's categories, shape (B,), int64; needed where
                there are several.
            queries: Indices of the points that features are wanted of, shape (B, Q), int64; all
                when None.

        Returns:
            Unit vectors, shape (B, Q, features); Q is N without `queries`.
        """
        levels = self.config.levels
        counts = [min(level.centres, points.shape[1]) for level in levels if level.centres]
        order, squared = sample_farthest(points, counts[0])
        places, features = [points], [points]
        for number, (level, layer) in enumerate(zip(levels, self.down, strict=True)):
            if level.centres:
                # The first centres of a choice are a choice of fewer, so one search serves all
                # levels.
                size = counts[number]
                centres = gather_points(points, order[:, :size])
                table = squared[:, :size]
                if number:
                    chosen = order[:, : counts[number - 1]]
                    table = table.gather(2, chosen.unsqueeze(1).expand(-1, size, -1))
            else:
                centres = torch.zeros_like(points[:, :1])
                table = points.new_zeros(len(points), 1, places[-1].shape[1])
            features.append(layer(places[-1], features[-1], centres, table))
            places.append(centres)
        tokens = features[-1]
        if self.blocks:
            tokens = tokens + self.position(places[-1])
        if self.category is not None:
            if category is None:
                raise ValueError(
                    f"category must be given: the network is for {self.config.categories}"
                )
            tokens = tokens + self.category(category).unsqueeze(1)
        for block in self.blocks:
            tokens = block(tokens)
        for level, layer in zip(reversed(range(len(levels))), self.up, strict=True):
            wanted, fine = places[level], features[level]
            if level == 0:
                wanted = points if queries is None else gather_points(points, queries)
                fine = torch.cat([wanted, wanted], dim=2)
            tokens = layer(places[level + 1], tokens, wanted, fine)
        return functional.normalize(self.head(tokens), dim=2)
