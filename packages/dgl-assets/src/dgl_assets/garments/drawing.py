"""Draw measures at random until they fit together."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TypeVar

import numpy as np

_ATTEMPTS = 2000

T = TypeVar("T")


def draw_until_valid(
    rng: np.random.Generator | int,
    draw: Callable[[np.random.Generator], T],
) -> T:
    """Draw measures until they are valid.

    Args:
        rng: Generator, advanced by this call, or a seed.
        draw: Draws measures; those that cannot be cut are a `ValueError`.

    Returns:
        The first measures that pass.

    Raises:
        RuntimeError: If 2,000 draws fail, which means that the ranges of the sampler are broken.
    """
    generator = np.random.default_rng(rng) if isinstance(rng, int | np.integer) else rng
    for _ in range(_ATTEMPTS):
        try:
            return draw(generator)
        except ValueError:
            continue  # the next draw is independent
    raise RuntimeError(
        f"no valid garment in {_ATTEMPTS} draws; the ranges of the sampler are broken"
    )


def pick(rng: np.random.Generator, shares: Mapping[str, float]) -> str:
    """Draw one of some names, each with its share."""
    weights = np.array(list(shares.values()))
    return list(shares)[int(rng.choice(len(weights), p=weights / weights.sum()))]


def span(rng: np.random.Generator, low: float, high: float) -> float:
    """Draw a number between two."""
    return float(rng.uniform(low, high))


Style = Mapping[str, tuple[float, float]]
"""Ranges of measures."""


def draw_style(
    rng: np.random.Generator, styles: Mapping[str, tuple[float, Style]]
) -> tuple[str, Style]:
    """Draw one of some named styles, each with its share."""
    name = pick(rng, {name: share for name, (share, _) in styles.items()})
    return name, styles[name][1]


def draw_ranges(rng: np.random.Generator, style: Style) -> dict[str, float]:
    """Draw each measure of a style uniformly from its range."""
    return {name: float(rng.uniform(*bounds)) for name, bounds in style.items()}
