"""Fields on a tile that repeat without a seam: coordinates, smooth noise, soft steps.

Noise is drawn on a lattice and interpolated, so that a material looks the same at any resolution.
"""

from __future__ import annotations

import numpy as np

_VARIANCE = 0.479365  # of a cubic B-spline through unit noise, along one axis


def get_coordinates(size: int) -> tuple[np.ndarray, np.ndarray]:
    """Centres of a square tile's pixels in [0, 1).

    Returns:
        u along columns, shape (1, size), and v along rows, shape (size, 1).
    """
    centres = (np.arange(size) + 0.5) / size
    return centres[None, :], centres[:, None]


def make_noise(rng: np.random.Generator, size: int, cells: tuple[int, int]) -> np.ndarray:
    """Draw smooth noise of zero mean and unit variance.

    Args:
        rng: Advanced by the same amount whatever the size.
        size: Pixels along a side of the tile.
        cells: Bumps along rows' direction v and columns' direction u, (n_v, n_u).

    Returns:
        Shape (size, size), float64.
    """
    lattice = rng.standard_normal(cells)
    down, across = (_interpolate(size, count) for count in cells)
    return down @ lattice @ across.T / _VARIANCE


def make_fractal(
    rng: np.random.Generator,
    size: int,
    cells: tuple[int, int],
    *,
    octaves: int,
    gain: float = 0.5,
) -> np.ndarray:
    """Add noise of doubling frequency and amplitudes that fall by `gain`; unit variance."""
    total = np.zeros((size, size))
    for k in range(octaves):
        total += gain**k * make_noise(rng, size, (cells[0] << k, cells[1] << k))
    return total / np.sqrt(sum(gain ** (2 * k) for k in range(octaves)))


def step(value: np.ndarray, low: float, high: float) -> np.ndarray:
    """Rise smoothly from 0 at `low` to 1 at `high`."""
    t = np.clip((value - low) / (high - low), 0.0, 1.0)
    return t * t * (3.0 - 2.0 * t)


def mix(first: np.ndarray, second: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Blend colours, shape (..., 3), by the second's share, shape (...)."""
    return first + (second - first) * share[..., None]


def _interpolate(size: int, count: int) -> np.ndarray:
    """Weights of a periodic cubic B-spline, shape (size, count)."""
    place = (np.arange(size) + 0.5) / size * count
    first = np.floor(place).astype(int)
    t = place - first
    weights = np.zeros((size, count))
    basis = (
        (1 - t) ** 3 / 6,
        (3 * t**3 - 6 * t**2 + 4) / 6,
        (-3 * t**3 + 3 * t**2 + 3 * t + 1) / 6,
        t**3 / 6,
    )
    for offset, weight in zip((-1, 0, 1, 2), basis, strict=True):
        np.add.at(weights, (np.arange(size), (first + offset) % count), weight)
    return weights
