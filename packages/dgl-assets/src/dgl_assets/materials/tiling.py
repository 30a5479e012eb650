"""Floors of pieces: planks, parquet and tiles, with joints between them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dgl_assets.materials.colours import Rgb
from dgl_assets.materials.fields import (
    get_coordinates,
    make_fractal,
    make_noise,
    mix,
    step,
)
from dgl_assets.materials.wood import get_wood_roughness, make_grain

Colours = tuple[Rgb, Rgb, Rgb]
_JOINT = 0.0016  # half width of a joint between boards [m]
_GROUT = 0.0035  # half width of a joint between tiles [m]
_STRIPS = 5  # of a block of parquet


@dataclass(frozen=True, kw_only=True, eq=False)
class FloorSurface:
    """A floor's fields, each of shape (N, N) or (N, N, 3)."""

    colour: np.ndarray
    """sRGB in [0, 255]."""
    height: np.ndarray
    """Relief [m]."""
    roughness: np.ndarray


def paint_planks(
    colours: Colours,
    size: int,
    rng: np.random.Generator,
    *,
    rows: int,
    tile_size: float,
    gloss: float,
    variation: float,
) -> FloorSurface:
    """Lay planks along u, each row of one or two a tile, butt joints at random."""
    u, v = get_coordinates(size)
    row = np.floor(v * rows).astype(int).ravel()
    ends = rng.random(rows)
    gap = rng.uniform(0.35, 0.65, rows)  # to the row's other butt joint
    along = (u - ends[row, None]) % 1.0
    is_second = along >= gap[row, None]
    plank = 2 * row[:, None] + is_second
    start, length = np.where(is_second, gap[row, None], 0.0), gap[row, None]
    length = np.where(is_second, 1.0 - length, length)
    from_end = along - start
    distance = np.minimum(
        np.minimum(from_end, length - from_end), _from_edges(v * rows) / rows
    )  # to the nearest joint, in tiles
    grain = _cut_from_boards(rng, size, plank, rings=2.0 * rows)
    return _finish_wood(colours, grain, plank, distance * tile_size, rng, size, gloss, variation)


def paint_parquet(
    colours: Colours,
    size: int,
    rng: np.random.Generator,
    *,
    blocks: int,
    tile_size: float,
    gloss: float,
    variation: float,
) -> FloorSurface:
    """Lay square blocks of five strips, turned by turns."""
    u, v = get_coordinates(size)
    x, y = np.broadcast_to(u * blocks, (size, size)), np.broadcast_to(v * blocks, (size, size))
    column, row = np.floor(x).astype(int), np.floor(y).astype(int)
    is_turned = (column + row) % 2 == 1
    across = np.where(is_turned, x, y) % 1.0 * _STRIPS
    piece = (row * blocks + column) * _STRIPS + np.floor(across).astype(int)
    along = np.where(is_turned, y, x)
    distance = np.minimum(_from_edges(across) / _STRIPS, _from_edges(along)) / blocks
    boards = _cut_from_boards(rng, size, piece, rings=3.0 * _STRIPS)
    turned = _cut_from_boards(rng, size, piece.T, rings=3.0 * _STRIPS).T
    grain = np.where(is_turned, turned, boards)
    return _finish_wood(colours, grain, piece, distance * tile_size, rng, size, gloss, variation)


def paint_tiles(
    colours: Colours,
    size: int,
    rng: np.random.Generator,
    *,
    count: int,
    tile_size: float,
    gloss: float,
    variation: float,
    is_chequered: bool,
) -> FloorSurface:
    """Lay square tiles with grout between them."""
    u, v = get_coordinates(size)
    column, row = np.floor(u * count).astype(int), np.floor(v * count).astype(int)
    distance = np.minimum(_from_edges(u * count), _from_edges(v * count)) / count * tile_size
    first, second, grout = np.array(colours, dtype=np.float64)
    is_second = ((column + row) % 2)[..., None] if is_chequered else np.zeros((size, size, 1))
    tone = 1.0 + 0.07 * variation * rng.standard_normal((count, count))[row, column]
    cloud = make_fractal(rng, size, (2 * count, 2 * count), octaves=4, gain=0.6)
    fired = tone + 0.04 * (0.3 + variation) * cloud
    colour = (first + (second - first) * is_second) * fired[..., None]
    pixel = tile_size / size
    is_tile = step(distance, _GROUT - pixel, _GROUT + pixel)
    sand = 1.0 + 0.02 * make_noise(rng, size, (256, 256))
    bevel = step(distance, _GROUT, _GROUT + 0.004)
    return FloorSurface(
        colour=mix(grout * sand[..., None], colour, is_tile),
        height=0.0015 * bevel + 1.2e-4 * cloud * is_tile,
        roughness=0.9 + is_tile * (-0.05 - 0.7 * gloss + 0.03 * cloud),
    )


def _from_edges(place: np.ndarray) -> np.ndarray:
    """Distance to the nearest whole number."""
    return np.abs(place - np.round(place))


def _cut_from_boards(
    rng: np.random.Generator, size: int, piece: np.ndarray, *, rings: float
) -> np.ndarray:
    """Cut each piece from its own part of a board with grain along u, shape (N, N)."""
    board = make_grain(rng, size, rings=rings)
    count = int(piece.max()) + 1
    du, dv = rng.integers(size, size=(2, count))
    row, column = np.indices((size, size))
    return board[(row + dv[piece]) % size, (column + du[piece]) % size]


def _finish_wood(
    colours: Colours,
    grain: np.ndarray,
    piece: np.ndarray,
    distance: np.ndarray,
    rng: np.random.Generator,
    size: int,
    gloss: float,
    variation: float,
) -> FloorSurface:
    early, late, joint = np.array(colours, dtype=np.float64)
    tone = rng.standard_normal(int(piece.max()) + 1)[piece]
    share = np.clip(grain + 0.16 * variation * tone, 0.0, 1.0)
    worn = 1.0 + 0.05 * variation * tone + 0.02 * make_noise(rng, size, (4, 4))
    colour = mix(np.broadcast_to(early, (size, size, 3)), late, share) * worn[..., None]
    # A joint narrower than a pixel darkens it in part.
    pixel = max(float(np.diff(np.unique(distance[:1])).min(initial=_JOINT)), 1e-9)
    is_joint = 1.0 - step(distance, 0.0, 2 * _JOINT + pixel)
    return FloorSurface(
        colour=mix(colour, joint, 0.85 * is_joint),
        height=0.001 * step(distance, 0.0, 0.004) - 1e-4 * grain,
        roughness=get_wood_roughness(grain, gloss) + 0.2 * is_joint,
    )
