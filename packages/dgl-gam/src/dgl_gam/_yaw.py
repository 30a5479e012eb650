"""Yaw of a garment from its cloud: a circular network on a polar map."""

import math

import torch
from torch import Tensor, nn
from torch.nn import functional

from dgl_gam.config import YawConfig

__all__ = ["YawNetwork", "make_polar_map", "rotate_yaw"]

_CHANNELS = 3  # density, mean height, mean squared height
_WINDOW = 2  # bins on either side of the best that refine it


def rotate_yaw(points: Tensor, yaw: Tensor) -> Tensor:
    """Turn clouds, shape (B, N, 3), counter-clockwise about z by `yaw` [rad], shape (B,)."""
    cos, sin = yaw.cos()[:, None], yaw.sin()[:, None]
    x, y, z = points.unbind(dim=2)
    return torch.stack([cos * x - sin * y, sin * x + cos * y, z], dim=2)


def make_polar_map(points: Tensor, config: YawConfig) -> Tensor:
    """Count points in bins of angle and distance, and average their heights.

    Each point is shared between the two nearest angles and rings. Turning the cloud by one bin
    shifts the map by one.

    Args:
        points: Centred clouds in the normalised frame, shape (B, N, 3).
        config: Sizes.

    Returns:
        Shape (B, rings * 3, bins).
    """
    batch, size, _ = points.shape
    x, y, z = points.unbind(dim=2)
    angle = torch.atan2(y, x) * (config.bins / (2 * math.pi))
    ring = torch.hypot(x, y) * ((config.rings - 1) / config.radius)
    ring = ring.clamp(max=config.rings - 1 - 1e-4)
    low_angle, low_ring = angle.floor(), ring.floor()
    share_angle, share_ring = angle - low_angle, ring - low_ring
    cells = points.new_zeros(batch, _CHANNELS, config.rings * config.bins)
    values = torch.stack([torch.ones_like(z), z, z * z], dim=1)  # (B, 3, N)
    for up_angle in (0, 1):
        for up_ring in (0, 1):
            weight = (share_angle if up_angle else 1 - share_angle) * (
                share_ring if up_ring else 1 - share_ring
            )
            bins = (low_angle.long() + up_angle) % config.bins
            cell = (low_ring.long() + up_ring) * config.bins + bins  # (B, N)
            cells.scatter_add_(
                2, cell.unsqueeze(1).expand(-1, _CHANNELS, -1), values * weight.unsqueeze(1)
            )
    count = cells[:, :1]
    heights = cells[:, 1:] / (count + 1e-3 * size / cells.shape[2])
    density = (count * (cells.shape[2] / size)).sqrt()
    return torch.cat([density, heights], dim=1).reshape(batch, -1, config.bins)


class YawNetwork(nn.Module):
    """Scores of every yaw; circular convolutions shift them as the cloud turns."""

    def __init__(self, config: YawConfig) -> None:
        """Set up the layers."""
        super().__init__()
        self.config = config
        width = config.width
        self.first = nn.Conv1d(
            _CHANNELS * config.rings, width, 5, padding=2, padding_mode="circular"
        )
        self.blocks = nn.ModuleList(
            nn.Conv1d(width, width, 5, padding=2 * d, dilation=d, padding_mode="circular")
            for d in (1, 2, 4, 6)
        )
        self.norms = nn.ModuleList(nn.GroupNorm(4, width) for _ in self.blocks)
        self.whole = nn.Linear(width, width)
        self.last = nn.Conv1d(width, 1, 1)

    def forward(self, points: Tensor) -> Tensor:
        """Score the yaws of normalised clouds, shape (B, N, 3): logits, shape (B, bins)."""
        hidden = self.first(make_polar_map(points, self.config))
        for norm, block in zip(self.norms, self.blocks, strict=True):
            hidden = hidden + block(torch.relu(norm(hidden)))
        hidden = torch.relu(hidden + self.whole(hidden.mean(dim=2)).unsqueeze(2))
        return self.last(hidden).squeeze(1)

    def compute_loss(self, logits: Tensor, yaw: Tensor, weight: Tensor) -> Tensor:
        """Cross entropy with a narrow distribution around the true angles.

        Args:
            logits: Shape (B, bins).
            yaw: True angles [rad], shape (B,).
            weight: How much each counts, shape (B,).
        """
        step = 2 * math.pi / self.config.bins
        centres = torch.arange(self.config.bins, device=yaw.device) * step
        target = ((centres - yaw[:, None]).cos() / step**2).softmax(dim=1)  # about one bin wide
        entropy = -(target * functional.log_softmax(logits, dim=1)).sum(dim=1)
        return (entropy * weight).sum() / weight.sum().clamp(min=1e-6)

    @torch.no_grad()
    def find_peaks(self, logits: Tensor, count: int) -> tuple[Tensor, Tensor]:
        """Find the most likely angles.

        Args:
            logits: Shape (B, bins).
            count: How many; each next one is at least a sixth of a turn from those before.

        Returns:
            Angles [rad], shape (B, count), and the probability around each, shape (B, count).
        """
        bins = self.config.bins
        share = logits.softmax(dim=1)
        left = share.clone()
        around = torch.arange(-_WINDOW, _WINDOW + 1, device=logits.device)
        wide = torch.arange(-(bins // 6), bins // 6 + 1, device=logits.device)
        angles, masses = [], []
        for _ in range(count):
            best = left.argmax(dim=1, keepdim=True)
            window = share.gather(1, (best + around) % bins)
            mass = window.sum(dim=1)
            angles.append(best.squeeze(1) + (window * around).sum(dim=1) / mass.clamp(min=1e-9))
            masses.append(mass)
            left.scatter_(1, (best + wide) % bins, -1.0)
        return torch.stack(angles, 1) * (2 * math.pi / bins), torch.stack(masses, 1)
