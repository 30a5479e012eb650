"""Grain of sawn wood, for floors and for furniture."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dgl_assets.materials.colours import Rgb, check_colours
from dgl_assets.materials.fields import get_coordinates, make_fractal, make_noise, mix
from dgl_assets.materials.maps import DEFAULT_SIZE, MaterialMaps, get_fine_size, make_maps
from dgl_assets.ranges import Measures, measure

SPECIES: dict[str, tuple[Rgb, Rgb]] = {
    "oak": ((206, 172, 128), (156, 116, 76)),
    "beech": ((222, 184, 146), (186, 140, 102)),
    "ash": ((218, 200, 170), (178, 152, 118)),
    "maple": ((228, 204, 166), (198, 166, 124)),
    "walnut": ((138, 100, 72), (84, 56, 40)),
    "smoked oak": ((128, 106, 86), (84, 66, 52)),
    "grey oak": ((176, 164, 148), (132, 120, 106)),
    "cherry": ((186, 122, 84), (142, 82, 54)),
    "pine": ((226, 190, 136), (190, 136, 82)),
}
"""Early and late wood, sRGB."""


@dataclass(frozen=True, kw_only=True)
class WoodMaterial(Measures):
    """A board without joints; its grain runs along u."""

    colours: tuple[Rgb, Rgb]
    """Early and late wood, sRGB, such as `SPECIES["oak"]`."""
    tile_size: float = measure(0.1, 4.0, 0.6)
    """Side of a tile [m]."""
    rings: float = measure(2.0, 60.0, 14.0)
    """Approximate number of year rings across a tile."""
    gloss: float = measure(0.0, 1.0, 0.45)
    """0 for raw, 1 for polished wood."""
    seed: int = 0
    name: str = "wood"

    def __post_init__(self) -> None:
        check_colours("colours", self.colours, 2)
        super().__post_init__()

    def render(self, size: int = DEFAULT_SIZE) -> MaterialMaps:
        """Compute the maps of one tile.

        Args:
            size: Pixels along a side, in [32, 2048].
        """
        fine = get_fine_size(size)
        grain = make_grain(np.random.default_rng([self.seed, 13]), fine, rings=self.rings)
        light, dark = np.array(self.colours, dtype=np.float64)
        return make_maps(
            name=self.name,
            size=size,
            tile_size=self.tile_size,
            colour=mix(np.broadcast_to(light, (fine, fine, 3)), dark, grain),
            height=-2e-4 * grain,
            roughness=get_wood_roughness(grain, self.gloss),
        )


def make_grain(rng: np.random.Generator, size: int, *, rings: float) -> np.ndarray:
    """Draw grain along u: 0 early wood, 1 late wood, shape (size, size).

    Rings are cut lengthwise by the board: lines along it that wander, and cathedrals where the
    board's surface touches a ring.
    """
    _, v = get_coordinates(size)
    wander = make_noise(rng, size, (5, 2)) + 0.35 * make_noise(rng, size, (12, 5))
    depth = rings * v + 0.13 * rings * wander  # in rings; whole over the tile, to join
    depth += (round(rings) - rings) * v
    ring = depth % 1.0
    late = ring**2.2 * (1 - ring**14)  # slowly denser, then suddenly early again
    fibres = make_fractal(rng, size, (96, 4), octaves=2)
    pores = np.clip(make_noise(rng, size, (256, 12)) - 1.1, 0.0, 1.0)
    tone = make_noise(rng, size, (3, 1))
    return np.clip(0.22 + 0.5 * late + 0.09 * fibres + 0.3 * pores + 0.05 * tone, 0.0, 1.0)


def get_wood_roughness(grain: np.ndarray, gloss: float) -> np.ndarray:
    """Roughness of wood: late wood and pores take less polish."""
    return np.clip(0.85 - 0.5 * gloss + 0.15 * grain, 0.0, 1.0)
