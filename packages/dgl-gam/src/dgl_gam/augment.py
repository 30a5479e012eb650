"""Changes that keep a garment's places: bent, turned, scaled, noisy and incomplete clouds."""

import math
from collections.abc import Sequence
from typing import Literal

import torch
from torch import Tensor

from dgl_gam._yaw import rotate_yaw

__all__ = ["drop_points", "warp_clouds"]


def _draw(generator: torch.Generator, *shape: int, low: float = -1.0, high: float = 1.0) -> Tensor:
    return torch.rand(*shape, generator=generator) * (high - low) + low


def warp_clouds(
    points: Tensor,
    generator: torch.Generator,
    *,
    yaw: float,
    bend: float = 0.05,
    stretch: float = 0.15,
    noise: float = 0.0,
) -> Tensor:
    """Turn, stretch and bend clouds smoothly, each in a way of its own.

    Args:
        points: Clouds in the normalised frame, shape (B, N, 3), on the CPU.
        generator: Source of randomness.
        yaw: Largest turn about the vertical [rad].
        bend: Largest displacement by each of the waves, in normalised units.
        stretch: Largest relative change of size along a horizontal direction.
        noise: Standard deviation of a displacement of each point, in normalised units.

    Returns:
        Shape (B, N, 3).
    """
    batch = len(points)
    out = points
    for cycles in (1.0, 2.5):
        direction = _draw(generator, batch, 2, high=math.pi, low=-math.pi)
        wave = torch.stack([direction.cos(), direction.sin(), 0 * direction], dim=1)  # (B, 3, 2)
        phase = _draw(generator, batch, 1, 2, high=math.pi, low=-math.pi)
        height = _draw(generator, batch, 1, 2) * (bend / cycles)
        moved = (out @ (wave * (math.pi * cycles / 2)) + phase).sin() * height  # (B, N, 2)
        out = torch.cat([out[..., :2] + moved, out[..., 2:]], dim=2)
    axis = _draw(generator, batch, high=math.pi, low=-math.pi)
    factor = 1 + _draw(generator, batch, 1, 2) * stretch
    out = rotate_yaw(out, axis)
    out = torch.cat([out[..., :2] * factor, out[..., 2:]], dim=2)
    out = rotate_yaw(out, -axis)
    out = rotate_yaw(out, _draw(generator, batch) * yaw)
    if noise:
        out = out + torch.randn(out.shape, generator=generator) * noise
    return out


def drop_points(
    points: Tensor,
    generator: torch.Generator,
    *,
    share: float,
    kinds: Sequence[Literal["hole", "line", "thin"]] = ("hole", "line", "thin"),
) -> Tensor:
    """Choose the points that stay when others are missing.

    Args:
        points: Clouds, shape (B, N, 3), on the CPU.
        generator: Source of randomness.
        share: Share of the points that is missing, in [0, 1).
        kinds: What is drawn from for each cloud: a round "hole", everything beyond a "line", or
            points here and there, "thin".

    Returns:
        Indices of those that stay, shape (B, N - round(share * N)), int64.
    """
    if not 0 <= share < 1:
        raise ValueError(f"share must be in [0, 1); got {share}")
    batch, size, _ = points.shape
    count = size - round(share * size)
    centre = points[
        torch.arange(batch), torch.randint(size, (batch,), generator=generator)
    ].unsqueeze(1)
    hole = (points - centre).norm(dim=2)
    direction = _draw(generator, batch, 1, high=math.pi, low=-math.pi)
    line = points[..., 0] * direction.cos() + points[..., 1] * direction.sin()
    thin = torch.rand(batch, size, generator=generator)
    orders = torch.stack([{"hole": hole, "line": line, "thin": thin}[kind] for kind in kinds])
    order = orders[torch.randint(len(kinds), (batch,), generator=generator), torch.arange(batch)]
    order = order.argsort(dim=1, descending=True)
    return order[:, :count].sort(dim=1).values
