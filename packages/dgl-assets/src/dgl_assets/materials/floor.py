"""Floors, drawn from a seed and rendered to maps."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple, get_args

import numpy as np

from dgl_assets.garments.drawing import pick
from dgl_assets.materials.colours import Rgb, check_colours, shift
from dgl_assets.materials.maps import DEFAULT_SIZE, MaterialMaps, get_fine_size, make_maps
from dgl_assets.materials.stone import (
    paint_carpet,
    paint_concrete,
    paint_marble,
    paint_terrazzo,
)
from dgl_assets.materials.tiling import FloorSurface, paint_parquet, paint_planks, paint_tiles
from dgl_assets.materials.wood import SPECIES
from dgl_assets.ranges import Measures, check_choice, measure

FloorKind = Literal["planks", "parquet", "tiles", "terrazzo", "concrete", "marble", "carpet"]


@dataclass(frozen=True, kw_only=True)
class FloorMaterial(Measures):
    """The look of a floor."""

    kind: FloorKind
    colours: tuple[Rgb, Rgb, Rgb]
    """sRGB. Wood: early, late, joints. Tiles: first, second, grout. Terrazzo: ground and two kinds
    of chips. Concrete: light, dark, pores. Marble: ground, clouds, veins. Carpet: two yarns and the
    ground between the loops."""
    tile_size: float = measure(0.4, 6.0)
    """Side of a tile [m]."""
    divisions: int = measure(1, 24, 4)
    """Rows of planks, or pieces along a side of the tile; even for parquet and for
    tiles of two colours. Concrete, terrazzo and carpet have none."""
    gloss: float = measure(0.0, 1.0, 0.3)
    """0 is matt, 1 polished."""
    variation: float = measure(0.0, 1.0, 0.5)
    """Difference of pieces."""
    is_chequered: bool = False
    """Tiles alternate between the first and the second colour; else all have the first."""
    seed: int = 0
    label: str = ""
    """Begin of the name, such as the species of wood."""

    def __post_init__(self) -> None:
        check_choice("kind", self.kind, FLOOR_KINDS)
        check_colours("colours", self.colours, 3)
        super().__post_init__()
        needs_even = self.kind == "parquet" or (self.kind == "tiles" and self.is_chequered)
        if needs_even and self.divisions % 2:
            raise ValueError(f"divisions must be even for this floor; got {self.divisions}")

    @property
    def name(self) -> str:
        """Colour and kind, such as "walnut planks"."""
        return f"{self.label} {self.kind}".strip()

    def render(self, size: int = DEFAULT_SIZE) -> MaterialMaps:
        """Compute the maps of one tile.

        Args:
            size: Pixels along a side, in [32, 2048].
        """
        fine = get_fine_size(size)
        surface = _PAINTERS[self.kind](self, fine, np.random.default_rng([self.seed, 17]))
        return make_maps(
            name=self.name,
            size=size,
            tile_size=self.tile_size,
            colour=surface.colour,
            height=surface.height,
            roughness=np.clip(surface.roughness, 0.05, 1.0),
        )


_PAINTERS: dict[str, Callable[[FloorMaterial, int, np.random.Generator], FloorSurface]] = {
    "planks": lambda f, n, rng: paint_planks(
        f.colours, n, rng, rows=f.divisions, tile_size=f.tile_size, gloss=f.gloss,
        variation=f.variation,
    ),
    "parquet": lambda f, n, rng: paint_parquet(
        f.colours, n, rng, blocks=f.divisions, tile_size=f.tile_size, gloss=f.gloss,
        variation=f.variation,
    ),
    "tiles": lambda f, n, rng: paint_tiles(
        f.colours, n, rng, count=f.divisions, tile_size=f.tile_size, gloss=f.gloss,
        variation=f.variation, is_chequered=f.is_chequered,
    ),
    "terrazzo": lambda f, n, rng: paint_terrazzo(
        f.colours, n, rng, tile_size=f.tile_size, gloss=f.gloss
    ),
    "concrete": lambda f, n, rng: paint_concrete(f.colours, n, rng, gloss=f.gloss),
    "marble": lambda f, n, rng: paint_marble(
        f.colours, n, rng, count=f.divisions, tile_size=f.tile_size, gloss=f.gloss
    ),
    "carpet": lambda f, n, rng: paint_carpet(
        f.colours, n, rng, tile_size=f.tile_size, variation=f.variation
    ),
}  # fmt: skip
FLOOR_KINDS: tuple[FloorKind, ...] = get_args(FloorKind)
"""All kinds of floors."""
_TILES: dict[str, tuple[Rgb, Rgb, Rgb]] = {
    "white": ((226, 224, 218), (72, 74, 78), (176, 172, 164)),
    "sand": ((206, 190, 164), (150, 126, 98), (168, 156, 138)),
    "terracotta": ((186, 108, 76), (150, 82, 58), (190, 172, 150)),
    "slate": ((98, 104, 110), (72, 78, 84), (130, 130, 128)),
    "sea": ((142, 172, 172), (228, 226, 218), (198, 198, 192)),
    "blue": ((78, 104, 138), (226, 222, 212), (190, 188, 182)),
}
_TERRAZZO: dict[str, tuple[Rgb, Rgb, Rgb]] = {
    "ivory": ((224, 218, 206), (150, 116, 92), (96, 100, 104)),
    "grey": ((178, 178, 174), (228, 226, 220), (84, 86, 90)),
    "green": ((150, 168, 154), (226, 222, 208), (70, 92, 82)),
    "rose": ((214, 186, 174), (160, 88, 78), (240, 232, 222)),
    "night": ((70, 74, 82), (200, 190, 174), (126, 118, 110)),
}
_CONCRETE: dict[str, tuple[Rgb, Rgb, Rgb]] = {
    "light": ((190, 188, 182), (156, 154, 150), (112, 110, 106)),
    "grey": ((154, 154, 152), (120, 120, 120), (84, 84, 84)),
    "warm": ((182, 172, 156), (146, 136, 122), (104, 96, 86)),
}
_MARBLE: dict[str, tuple[Rgb, Rgb, Rgb]] = {
    "white": ((234, 232, 228), (208, 208, 208), (128, 130, 136)),
    "black": ((46, 46, 50), (66, 66, 72), (206, 200, 190)),
    "green": ((66, 88, 78), (50, 68, 62), (190, 204, 192)),
    "cream": ((228, 214, 190), (212, 192, 162), (164, 128, 92)),
}
_CARPET: dict[str, tuple[Rgb, Rgb, Rgb]] = {
    "grey": ((136, 136, 140), (108, 108, 114), (62, 62, 66)),
    "beige": ((196, 180, 156), (170, 152, 128), (106, 94, 78)),
    "blue": ((76, 96, 128), (58, 74, 104), (34, 42, 60)),
    "green": ((104, 120, 98), (82, 98, 80), (48, 58, 46)),
    "wine": ((124, 64, 70), (98, 48, 56), (58, 28, 34)),
}
_WOOD: dict[str, tuple[Rgb, Rgb, Rgb]] = {
    name: (early, late, (late[0] // 3, late[1] // 3, late[2] // 3))
    for name, (early, late) in SPECIES.items()
}


class _FloorKind(NamedTuple):
    """Random floors of one kind: share, palette, (side [m], divisions) of tiles, range of gloss."""

    share: float
    palette: dict[str, tuple[Rgb, Rgb, Rgb]]
    sizes: tuple[tuple[float, int], ...]
    gloss: tuple[float, float]


_KINDS: dict[str, _FloorKind] = {
    "planks": _FloorKind(0.26, _WOOD, ((1.8, 12), (1.8, 10), (2.0, 16)), (0.2, 0.7)),
    "parquet": _FloorKind(0.1, _WOOD, ((1.6, 4), (1.8, 4), (1.8, 6)), (0.4, 0.8)),
    "tiles": _FloorKind(0.2, _TILES, ((1.2, 4), (1.2, 6), (1.8, 4), (1.0, 8)), (0.3, 0.9)),
    "terrazzo": _FloorKind(0.1, _TERRAZZO, ((1.0, 1),), (0.6, 0.9)),
    "concrete": _FloorKind(0.14, _CONCRETE, ((3.0, 1),), (0.0, 0.4)),
    "marble": _FloorKind(0.08, _MARBLE, ((2.4, 4), (2.4, 2)), (0.7, 0.95)),
    "carpet": _FloorKind(0.12, _CARPET, ((0.8, 1),), (0.0, 0.0)),
}


def _shift_together(colours: tuple[Rgb, Rgb, Rgb], rng: np.random.Generator) -> tuple[Rgb, ...]:
    """Vary colours alike, so that greys stay of one hue."""
    first = shift(colours[0], rng, 3.0)
    change = np.array(first) - np.array(colours[0])
    rest = np.clip(np.array(colours[1:]) + change, 0, 255)
    return first, *((int(r), int(g), int(b)) for r, g, b in rest)


def sample_floor_material(
    seed: int | Sequence[int] | np.random.Generator,
    *,
    kinds: Sequence[FloorKind] = FLOOR_KINDS,
) -> FloorMaterial:
    """Draw a floor.

    Args:
        seed: Seed or generator; equal seeds give equal floors.
        kinds: Kinds to choose from.
    """
    unknown = sorted(set(kinds) - set(FLOOR_KINDS))
    if unknown or not kinds:
        raise ValueError(f"kinds must be some of {list(FLOOR_KINDS)}; got {unknown or list(kinds)}")
    rng = np.random.default_rng(seed)
    kind: FloorKind = pick(rng, {k: _KINDS[k].share for k in kinds})  # pyright: ignore[reportAssignmentType]
    _, palette, sizes, gloss = _KINDS[kind]
    label = list(palette)[rng.integers(len(palette))]
    tile_size, divisions = sizes[rng.integers(len(sizes))]
    first, second, third = _shift_together(palette[label], rng)
    return FloorMaterial(
        kind=kind,
        colours=(first, second, third),
        tile_size=tile_size,
        divisions=divisions,
        gloss=float(rng.uniform(*gloss)),
        variation=float(rng.uniform(0.2, 0.8)),
        is_chequered=bool(rng.random() < 0.4) and kind == "tiles",
        seed=int(rng.integers(2**31)),
        label=label,
    )
