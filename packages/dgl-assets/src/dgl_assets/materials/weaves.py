"""Relief of woven and knitted cloth: the upper yarn, and its height.

Woven cloth is a table of crossings: +1 where the warp (along v) is on top, -1 where the weft
(along u) is. Knitted cloth is columns of V-shaped stitches.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from dgl_assets.materials.fields import get_coordinates, step

Weave = Literal[
    "plain", "oxford", "twill", "denim", "herringbone", "satin", "linen", "jersey", "rib"
]
"""Weaves; the last two are knitted."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ClothRelief:
    """The surface of a cloth, without colour."""

    height: np.ndarray
    """In yarn diameters, about 0 to 1, shape (N, N)."""
    is_warp: np.ndarray | None
    """Visible share of the warp, 0 to 1, shape (N, N); None for knits."""


def _twill(over: int, under: int) -> np.ndarray:
    n = over + under
    i, j = np.indices((n, n))
    return np.where((i + j) % n < over, 1.0, -1.0)


def _herringbone() -> np.ndarray:
    one = np.tile(_twill(2, 2), (2, 2))  # eight threads up, then eight down
    return np.concatenate([one, one[::-1]], axis=0)


def _satin() -> np.ndarray:
    i, j = np.indices((5, 5))
    return np.where((2 * i + j) % 5 == 0, -1.0, 1.0)


CROSSINGS: dict[str, np.ndarray] = {
    "plain": _twill(1, 1),
    "oxford": np.kron(_twill(1, 1), np.ones((2, 2))),
    "twill": _twill(2, 2),
    "denim": _twill(3, 1),
    "herringbone": _herringbone(),
    "satin": _satin(),
    "linen": _twill(1, 1),
}
"""One repeat of each woven cloth, shape (warps, wefts): +1 where the warp is on top."""
REPEATS: dict[str, int] = {name: max(table.shape) for name, table in CROSSINGS.items()} | {
    "jersey": 1,
    "rib": 4,
}
"""Numbers of threads or stitches that a tile must be divisible by."""


def make_relief(weave: Weave, threads: int, size: int) -> ClothRelief:
    """Compute the relief of a cloth.

    Args:
        weave: Its weave.
        threads: Threads along a side of the tile; for knits, columns of stitches.
        size: Pixels along a side.
    """
    if weave == "jersey":
        return ClothRelief(height=_make_stitches(threads, size), is_warp=None)
    if weave == "rib":
        u, _ = get_coordinates(size)
        wave = np.cos(2 * np.pi * u * threads / 4)  # two columns out, two in
        out = step(wave, -0.6, 0.6)
        height = 0.55 * out + (0.2 + 0.25 * out) * _make_stitches(threads, size)
        return ClothRelief(height=height, is_warp=None)
    return _interlace(CROSSINGS[weave], threads, size)


def _interlace(crossings: np.ndarray, threads: int, size: int) -> ClothRelief:
    u, v = get_coordinates(size)
    x, y = u * threads, v * threads
    across, down = np.floor(x).astype(int), np.floor(y).astype(int)  # nearest warp and weft
    warp = _profile(x) + 0.6 * _rise(crossings, across.ravel(), y.ravel()).T
    weft = _profile(y) - 0.6 * _rise(crossings.T, down.ravel(), x.ravel())
    is_warp = step(warp - weft, -0.25, 0.25)
    height = np.maximum(warp, weft)
    return ClothRelief(height=np.clip(0.1 + 0.56 * height, 0.0, 1.0), is_warp=is_warp)


def _profile(place: np.ndarray) -> np.ndarray:
    """Compute the roundness of threads: 1 along their middles, 0 at their edges."""
    return np.sin(np.pi * (place % 1.0)) ** 0.7


def _rise(crossings: np.ndarray, threads: np.ndarray, place: np.ndarray) -> np.ndarray:
    """Height of threads, smooth from crossing to crossing, shape (T, P)."""
    own, others = crossings.shape
    before = np.floor(place - 0.5).astype(int)
    t = step(place - 0.5 - before, 0.0, 1.0)
    rows = crossings[threads % own]
    return rows[:, before % others] * (1 - t) + rows[:, (before + 1) % others] * t


def _make_stitches(wales: int, size: int) -> np.ndarray:
    """Height of stockinette: columns of V, a quarter more rows than columns."""
    u, v = get_coordinates(size)
    courses = count_courses(wales)
    x, y = (u * wales) % 1.0, v * courses
    legs = np.abs(np.sin(2 * np.pi * x)) ** 0.6
    along = y + 0.9 * np.abs(x - 0.5)
    return legs * (0.62 + 0.38 * np.cos(2 * np.pi * along))


def count_courses(wales: int) -> int:
    """Rows of stitches on a tile of so many columns."""
    return round(1.25 * wales)
