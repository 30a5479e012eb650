"""Sampling and neighbours of points; permuting a cloud permutes the answers."""

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

__all__ = [
    "find_ball",
    "find_three_nearest",
    "gather_points",
    "interpolate",
    "sample_farthest",
]

_COMB = 8  # teeth of the comb in which the smallest of many values are sought


@torch.no_grad()
def sample_farthest(points: Tensor, count: int) -> tuple[Tensor, Tensor]:
    """Choose points far from each other: each next one is the farthest from those before.

    The first is the farthest from the mean, so that the order of the cloud does not matter. The
    first points of a choice are themselves such a choice, of fewer.

    Args:
        points: Clouds, shape (B, N, 3).
        count: How many, at most N.

    Returns:
        Indices, shape (B, count), int64, and the squared distance of each chosen point to every
        point, shape (B, count, N).
    """
    size = points.shape[1]
    if not 1 <= count <= size:
        raise ValueError(f"count must be in [1, {size}]; got {count}")
    if points.device.type == "cpu":
        # Each step is a handful of tiny operations: NumPy starts one in a third of torch's time.
        clouds = points.numpy()
        indices = np.empty((len(clouds), count), np.int64)
        squared = np.empty((len(clouds), count, size), clouds.dtype)
        for number, cloud in enumerate(clouds):
            _sample_farthest_one(cloud, indices[number], squared[number])
        return torch.from_numpy(indices), torch.from_numpy(squared)
    return _sample_farthest_batch(points, count)


def _sample_farthest_one(cloud: np.ndarray, chosen: np.ndarray, squared: np.ndarray) -> None:
    """Fill indices, shape (count,), and squared distances, shape (count, N), of one cloud."""
    centred = cloud - cloud.mean(axis=0)
    size = (centred * centred).sum(axis=1)
    one = np.ones_like(size)
    # |p - q|^2 = (-2 p, |p|^2, 1) . (q, 1, |q|^2): one product of a row and a table.
    table = np.ascontiguousarray(np.column_stack([-2.0 * centred, size, one]).T)
    rows = np.column_stack([centred, one, size])
    index = int(size.argmax())
    nearest = np.full(len(cloud), np.inf, cloud.dtype)
    for step, row in enumerate(squared):
        chosen[step] = index
        np.dot(rows[index], table, out=row)
        np.minimum(nearest, row, out=nearest)
        nearest[index] = -1.0  # rounding must not let a chosen point be chosen again
        index = int(nearest.argmax())
    np.maximum(squared, 0.0, out=squared)


def _sample_farthest_batch(points: Tensor, count: int) -> tuple[Tensor, Tensor]:
    """All clouds at once, for accelerators."""
    batch, size, _ = points.shape
    planes = points.permute(2, 0, 1).contiguous()  # (3, B, N)
    offsets = torch.empty_like(planes)
    nearest = points.new_full((batch, size), torch.inf)
    chosen = torch.empty(count, batch, 1, dtype=torch.int64, device=points.device)
    squared = points.new_empty(count, batch, size)
    centre = planes.mean(dim=2, keepdim=True)
    index = (planes - centre).square().sum(dim=0).argmax(dim=1, keepdim=True)  # (B, 1)
    for step in range(count):
        chosen[step] = index
        torch.sub(planes, planes.gather(2, index.expand(3, batch, 1)), out=offsets)
        torch.sum(offsets.mul_(offsets), dim=0, out=squared[step])
        torch.minimum(nearest, squared[step], out=nearest)
        index = nearest.argmax(dim=1, keepdim=True)
    return chosen.squeeze(2).T.contiguous(), squared.transpose(0, 1)


@torch.no_grad()
def find_ball(squared: Tensor, count: int, radius: float) -> Tensor:
    """Find the nearest points of each centre within a radius.

    Args:
        squared: Squared distances of the centres to the points, shape (B, S, N).
        count: Neighbours wanted.
        radius: Largest distance.

    Returns:
        Indices, shape (B, S, min(count, N)), int64, nearest first. Where fewer points are within
        the radius, the nearest one fills up.
    """
    distances, indices = _find_smallest(squared, min(count, squared.shape[2]))
    return torch.where(distances <= radius * radius, indices, indices[:, :, :1])


def _find_smallest(values: Tensor, count: int) -> tuple[Tensor, Tensor]:
    """Find the smallest values of each row, shape (B, S, count), and their indices."""
    batch, size, width = values.shape
    stride = width // _COMB
    if width % _COMB or stride < 8 * count:
        return values.topk(count, dim=2, largest=False)
    # The smallest are in the columns of a comb that have the smallest minima: fewer values have to
    # be sorted.
    comb = values.reshape(batch, size, _COMB, stride)
    columns = comb.amin(dim=2).topk(count, dim=2, largest=False).indices
    left = comb.gather(3, columns.unsqueeze(2).expand(-1, -1, _COMB, -1)).flatten(2)
    smallest, places = left.topk(count, dim=2, largest=False)
    rows = torch.div(places, count, rounding_mode="floor")
    return smallest, rows * stride + columns.gather(2, places % count)


@torch.no_grad()
def find_three_nearest(points: Tensor, centres: Tensor) -> tuple[Tensor, Tensor]:
    """Find the three nearest centres of each point, and weights by inverse distance.

    Args:
        points: Shape (B, N, 3).
        centres: Shape (B, S, 3).

    Returns:
        Indices, shape (B, N, min(3, S)), int64, and weights of the same shape that add up to 1.
    """
    # |p - q|^2 = |p|^2 + (p, 1) . (-2 q, |q|^2): one product, and |p|^2 is needed for the chosen
    # ones alone.
    rows = torch.cat([points, torch.ones_like(points[..., :1])], dim=2)
    table = torch.cat([-2.0 * centres, centres.square().sum(dim=2, keepdim=True)], dim=2).mT
    values = rows @ table
    count = min(3, centres.shape[1])
    if points.device.type == "cpu":
        # Three passes of NumPy's vectorised argmin take a quarter of the time of one `topk`.
        left, found, nearest = values.numpy(), [], []
        for _ in range(count):
            index = left.argmin(axis=2)[..., None]
            found.append(index)
            nearest.append(np.take_along_axis(left, index, axis=2))
            np.put_along_axis(left, index, np.inf, axis=2)
        indices = torch.from_numpy(np.concatenate(found, axis=2))
        distances = torch.from_numpy(np.concatenate(nearest, axis=2))
    else:
        distances, indices = values.topk(count, dim=2, largest=False)
    distances = distances + points.square().sum(dim=2, keepdim=True)
    weights = 1.0 / (distances.clamp(min=0) + 1e-8)
    return indices, weights / weights.sum(dim=2, keepdim=True)


def interpolate(values: Tensor, indices: Tensor, weights: Tensor) -> Tensor:
    """Add up rows of `values`, shape (B, S, C), by weights.

    Args:
        values: Shape (B, S, C).
        indices: Of the rows, shape (B, N, k), int64.
        weights: Of the rows, shape (B, N, k).

    Returns:
        Shape (B, N, C).
    """
    batch, size, channels = values.shape
    start = torch.arange(batch, device=values.device).mul_(size)[:, None, None]
    # One pass that writes the sums only, where gathering, multiplying and adding would write k
    # times as much.
    summed = functional.embedding_bag(
        (indices + start).flatten(0, 1),
        values.reshape(batch * size, channels),
        per_sample_weights=weights.flatten(0, 1),
        mode="sum",
    )
    return summed.reshape(batch, -1, channels)


def gather_points(values: Tensor, indices: Tensor) -> Tensor:
    """Take rows of `values`, shape (B, N, C), by `indices`, shape (B, ...): shape (B, ..., C)."""
    batch, size, channels = values.shape
    start = torch.arange(batch, device=values.device).mul_(size)
    rows = indices + start.reshape(batch, *[1] * (indices.ndim - 1))
    # Selecting rows copies each at once, and adds each at once on the way back; `gather` goes by
    # single values.
    taken = values.reshape(batch * size, channels).index_select(0, rows.reshape(-1))
    return taken.reshape(*indices.shape, channels)
