"""Farthest-point sampling on CUDA in one launch."""

# What Triton's functions take and give back is not in their types.
# pyright: reportArgumentType=false, reportIndexIssue=false, reportOperatorIssue=false
import torch
import triton
from torch import Tensor
from triton import language as tl

__all__ = ["choose_farthest"]


def choose_farthest(planes: Tensor, first: Tensor, count: int) -> Tensor:
    """Choose points, each the farthest from those before.

    Args:
        planes: Clouds, shape (3, B, N), float32, contiguous.
        first: The first choice in each, shape (B,), int64.
        count: How many, at most N.

    Returns:
        Indices, shape (B, count), int64.
    """
    _, batch, size = planes.shape
    chosen = torch.empty(batch, count, dtype=torch.int64, device=planes.device)
    block = triton.next_power_of_2(size)
    warps = 4 if block <= 2048 else 16  # An argument of the launch, which the types do not know.
    _choose[(batch,)](planes, first, chosen, batch, size, count, BLOCK=block, num_warps=warps)  # type: ignore[call-arg]
    return chosen


@triton.jit
def _choose(planes, first, chosen, batch, size, count, BLOCK: tl.constexpr):
    """One program a cloud, whose points stay in registers."""
    cloud = tl.program_id(0)
    points = tl.arange(0, BLOCK)
    is_point = points < size
    xs = planes + cloud * size
    ys, zs = xs + batch * size, xs + 2 * batch * size
    x = tl.load(xs + points, is_point, 0.0)
    y = tl.load(ys + points, is_point, 0.0)
    z = tl.load(zs + points, is_point, 0.0)
    nearest = tl.where(is_point, float("inf"), -2.0)
    index = tl.load(first + cloud)
    for step in range(count):
        tl.store(chosen + cloud * count + step, index)
        dx, dy, dz = x - tl.load(xs + index), y - tl.load(ys + index), z - tl.load(zs + index)
        nearest = tl.minimum(nearest, dx * dx + dy * dy + dz * dz)
        nearest = tl.where(points == index, -1.0, nearest)  # See `sample_farthest`.
        index = tl.argmax(nearest, axis=0).to(tl.int64)
