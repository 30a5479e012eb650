"""Layers of the network; all norms are over the channels of one point."""

import torch
from torch import Tensor, nn
from torch.nn import functional

from dgl_gam._sampling import find_ball, find_three_nearest, gather_points, interpolate

__all__ = ["AttentionBlock", "FeaturePropagation", "SetAbstraction", "make_mlp"]


def make_mlp(width: int, widths: tuple[int, ...]) -> nn.Sequential:
    """Linear layers, each with layer norm and ReLU, on the last dimension."""
    layers: list[nn.Module] = []
    for following in widths:
        layers += [nn.Linear(width, following), nn.LayerNorm(following), nn.ReLU()]
        width = following
    return nn.Sequential(*layers)


class SetAbstraction(nn.Module):
    """Groups points around centres; the feature of a group is the maximum over its points.

    The first layer is linear in (position relative to the centre, feature), so each part of it is
    applied to a point once and not once in each group. Relative positions are scaled to about [-1,
    1]: they would be lost beside features else.
    """

    def __init__(
        self, width: int, widths: tuple[int, ...], *, neighbours: int, radius: float
    ) -> None:
        """Set up for features of length `width`; no neighbours mean one group of all points."""
        super().__init__()
        self.neighbours = neighbours
        self.radius = radius
        # The nearest neighbours reach about half of the radius.
        self.scale = 2.0 / radius if neighbours else 1.0
        self.point = nn.Linear(width, widths[0])
        self.relative = nn.Linear(3, widths[0], bias=False)
        self.norm = nn.LayerNorm(widths[0])
        self.rest = make_mlp(widths[0], widths[1:])

    def forward(self, points: Tensor, features: Tensor, centres: Tensor, squared: Tensor) -> Tensor:
        """Compute features of the centres.

        Args:
            points: Shape (B, N, 3).
            features: Shape (B, N, C).
            centres: Shape (B, S, 3).
            squared: Squared distances of centres to points, shape (B, S, N).

        Returns:
            Shape (B, S, widths[-1]).
        """
        each = self.point(features) + self.relative(points * self.scale)
        if self.neighbours:
            each = gather_points(each, find_ball(squared, self.neighbours, self.radius))
        else:
            each = each.unsqueeze(1)  # (B, 1, N, C): one group of all
        origin = self.relative(centres * self.scale).unsqueeze(2)
        grouped = torch.relu(self.norm(each - origin))
        return self.rest(grouped).amax(dim=2)


class FeaturePropagation(nn.Module):
    """Carries features of the centres back to the points, interpolated between the three nearest.

    The first layer is linear in (carried features, the points' own), and interpolation is linear
    too: so its first part is applied to the few centres, and not to the many points.
    """

    def __init__(self, width: int, skip_width: int, widths: tuple[int, ...]) -> None:
        """Set up for features of length `width` at the centres and `skip_width` at the points."""
        super().__init__()
        self.coarse = nn.Linear(width, widths[0])
        self.fine = nn.Linear(skip_width, widths[0], bias=False)
        self.norm = nn.LayerNorm(widths[0])
        self.rest = make_mlp(widths[0], widths[1:])

    def forward(self, centres: Tensor, coarse: Tensor, points: Tensor, fine: Tensor) -> Tensor:
        """Compute features of the points.

        Args:
            centres: Shape (B, S, 3).
            coarse: Features of the centres, shape (B, S, C).
            points: Shape (B, N, 3).
            fine: What the points have already, shape (B, N, D).

        Returns:
            Shape (B, N, widths[-1]).
        """
        indices, weights = find_three_nearest(points, centres)
        carried = interpolate(self.coarse(coarse), indices, weights)
        return self.rest(torch.relu(self.norm(carried + self.fine(fine))))


class AttentionBlock(nn.Module):
    """Self-attention and a two-layer network, each after a norm and added to its input."""

    def __init__(self, width: int, heads: int) -> None:
        """Set up for features of length `width`."""
        super().__init__()
        self.heads = heads
        self.norm = nn.LayerNorm(width)
        self.mix = nn.Linear(width, 3 * width)
        self.out = nn.Linear(width, width)
        self.mlp = nn.Sequential(
            nn.LayerNorm(width), nn.Linear(width, 4 * width), nn.GELU(), nn.Linear(4 * width, width)
        )

    def forward(self, tokens: Tensor) -> Tensor:
        """Map features, shape (B, S, C), to the same shape."""
        batch, size, width = tokens.shape
        mixed = self.mix(self.norm(tokens)).reshape(batch, size, 3, self.heads, -1)
        query, key, value = mixed.permute(2, 0, 3, 1, 4)  # each (B, heads, S, C / heads)
        attended = functional.scaled_dot_product_attention(query, key, value)
        tokens = tokens + self.out(attended.transpose(1, 2).reshape(batch, size, width))
        return tokens + self.mlp(tokens)
