"""Floors without a grid of boards: terrazzo, concrete, marble and carpet."""

from __future__ import annotations

import numpy as np
from scipy.spatial import KDTree

from dgl_assets.materials.colours import Rgb
from dgl_assets.materials.fields import get_coordinates, make_fractal, make_noise, mix, step
from dgl_assets.materials.tiling import FloorSurface

Colours = tuple[Rgb, Rgb, Rgb]
_CHIPS = 900.0  # a square metre of terrazzo
_LOOP = 0.0064  # distance of a carpet's loops [m]


def paint_terrazzo(
    colours: Colours, size: int, rng: np.random.Generator, *, tile_size: float, gloss: float
) -> FloorSurface:
    """Strew chips of two kinds and many sizes into a polished ground."""
    ground, *kinds = np.array(colours, dtype=np.float64)
    count = max(8, round(_CHIPS * tile_size**2))
    centres = rng.random((count, 2))
    reach = 0.02 * rng.beta(1.6, 3.0, count) / tile_size
    u, v = get_coordinates(size)
    warp = 0.0022 / tile_size
    x = (u + warp * make_noise(rng, size, (90, 90))) % 1.0  # chips are no discs
    y = (v + warp * make_noise(rng, size, (90, 90))) % 1.0
    places = np.stack([x.ravel(), y.ravel()], axis=1)
    found = KDTree(centres, boxsize=1.0).query(places, k=2)
    distance, nearest = (np.asarray(part) for part in found)
    # Cells of the second nearest chip bound the first: straight, broken edges.
    to_border = 0.35 * (distance[:, 1] - distance[:, 0]) - 0.0006 / tile_size
    inside = np.minimum(reach[nearest[:, 0]] - distance[:, 0], to_border)
    is_chip = step(inside, -0.5 / size, 0.5 / size).reshape(size, size)
    shade = 1.0 + 0.1 * rng.standard_normal((count, 1))
    tint = np.array(kinds)[rng.integers(len(kinds), size=count)] * shade
    speckle = 1.0 + 0.02 * make_fractal(rng, size, (64, 64), octaves=2)
    chips = tint[nearest[:, 0]].reshape(size, size, 3)
    return FloorSurface(
        colour=mix(ground * speckle[..., None], chips, is_chip),
        height=np.zeros((size, size)),
        roughness=0.9 - 0.7 * gloss - 0.06 * is_chip,
    )


def paint_concrete(
    colours: Colours, size: int, rng: np.random.Generator, *, gloss: float
) -> FloorSurface:
    """Trowel a slab: clouds of many sizes, fine sand and a few pores."""
    light, dark, pore = np.array(colours, dtype=np.float64)
    clouds = make_fractal(rng, size, (3, 3), octaves=6, gain=0.62)
    trowel = make_noise(rng, size, (40, 6)) * step(make_noise(rng, size, (4, 4)), 0.2, 1.4)
    share = np.clip(0.45 + 0.24 * clouds + 0.07 * trowel, 0.0, 1.0)
    sand = make_noise(rng, size, (256, 256))
    colour = mix(np.broadcast_to(light, (size, size, 3)), dark, share)
    is_pore = step(make_noise(rng, size, (170, 170)), 2.5, 3.0)
    return FloorSurface(
        colour=mix(colour * (1.0 + 0.022 * sand)[..., None], pore, 0.8 * is_pore),
        height=3e-4 * clouds + 1.5e-4 * sand - 8e-4 * is_pore,
        roughness=0.92 - 0.5 * gloss + 0.05 * clouds,
    )


def paint_marble(
    colours: Colours,
    size: int,
    rng: np.random.Generator,
    *,
    count: int,
    tile_size: float,
    gloss: float,
) -> FloorSurface:
    """Lay polished slabs, each cut from another part of a veined block."""
    ground, cloud, vein = np.array(colours, dtype=np.float64)
    soft = make_fractal(rng, size, (3, 3), octaves=4)
    veins = np.zeros((size, size))
    for cells, strength, width in ((2, 1.0, 0.035), (4, 0.6, 0.05), (7, 0.3, 0.07)):
        ridge = np.abs(make_fractal(rng, size, (cells, cells), octaves=5, gain=0.55))
        fade = step(make_noise(rng, size, (cells + 1, cells + 1)), -0.6, 1.0)
        veins = np.maximum(veins, strength * fade * np.exp(-ridge / width))
    colour = mix(np.broadcast_to(ground, (size, size, 3)), cloud, step(soft, -0.6, 1.8))
    colour = mix(colour, vein, 0.85 * veins)
    row, column = np.indices((size, size))
    slab = (row * count // size) * count + column * count // size
    du, dv = rng.integers(size, size=(2, count * count))
    colour = colour[(row + dv[slab]) % size, (column + du[slab]) % size]
    u, v = get_coordinates(size)
    edges = (np.abs(p * count - np.round(p * count)) for p in (u, v))
    distance = np.minimum(*edges) / count * tile_size
    is_joint = 1.0 - step(distance, 0.0, 0.002 + tile_size / size)
    return FloorSurface(
        colour=mix(colour, cloud * 0.62, 0.7 * is_joint),
        height=-5e-4 * is_joint,
        roughness=0.8 - 0.7 * gloss + 0.3 * is_joint,
    )


def paint_carpet(
    colours: Colours,
    size: int,
    rng: np.random.Generator,
    *,
    tile_size: float,
    variation: float,
) -> FloorSurface:
    """Tuft loops in rows, of two yarns twisted together."""
    first, second, below = np.array(colours, dtype=np.float64)
    u, v = get_coordinates(size)
    rows = 2 * round(tile_size / _LOOP / 2)
    row = np.floor(v * rows)
    x = (u * rows + 0.5 * (row % 2)) % 1.0 - 0.5
    y = (v * rows) % 1.0 - 0.5
    loop = np.clip(1.0 - 1.9 * np.hypot(0.85 * x, y), 0.0, 1.0) ** 0.6
    twist = make_noise(rng, size, (rows, rows)) + 0.5 * make_noise(rng, size, (24, 24))
    share = np.clip(0.5 + (0.2 + 0.3 * variation) * twist, 0.0, 1.0)
    pile = mix(np.broadcast_to(first, (size, size, 3)), second, share)
    trodden = 1.0 + 0.03 * make_noise(rng, size, (5, 5))
    return FloorSurface(
        colour=mix(np.broadcast_to(below, pile.shape), pile, loop) * trodden[..., None],
        height=0.003 * loop + 4e-4 * twist,
        roughness=np.full((size, size), 0.97),
    )
