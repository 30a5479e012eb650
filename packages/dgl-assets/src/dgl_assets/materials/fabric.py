"""Fabrics of a weave, a pattern and yarns, drawn from a seed and rendered to maps."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple, get_args

import numpy as np

from dgl_assets.garments.drawing import pick
from dgl_assets.materials.colours import (
    PALE,
    PARTNERS,
    TARTANS,
    YARNS,
    Rgb,
    check_colours,
    shift,
)
from dgl_assets.materials.fields import get_coordinates, make_noise, mix, step
from dgl_assets.materials.maps import DEFAULT_SIZE, MaterialMaps, get_fine_size, make_maps
from dgl_assets.materials.weaves import REPEATS, ClothRelief, Weave, count_courses, make_relief
from dgl_assets.ranges import Measures, check_choice, measure

Pattern = Literal["plain", "melange", "stripes", "gingham", "tartan", "dots", "chambray"]
"""Colouring of the yarns; dots are printed."""

TILE_SIZE = 0.24
"""Side of a fabric's tile [m]."""
THREADS = (20, 160)
"""Fewest and most threads along a tile: 12 and 1.5 mm each, coarse enough to be seen."""
COLOUR_COUNTS: dict[str, int] = {
    "plain": 1, "melange": 2, "stripes": 2, "gingham": 2, "tartan": 4, "dots": 2, "chambray": 2,
}  # fmt: skip
"""Number of yarns of each pattern; chambray has one for the warp and one for the weft."""
_KNITS = ("jersey", "rib")
_WOVEN_ONLY = ("gingham", "tartan", "chambray")


@dataclass(frozen=True, kw_only=True)
class FabricMaterial(Measures):
    """The look of a cloth."""

    weave: Weave
    pattern: Pattern
    colours: tuple[Rgb, ...]
    """Yarns, sRGB; as many as `COLOUR_COUNTS` says."""
    threads: int = measure(*THREADS)
    """Threads, or columns of stitches, along a tile; a multiple of the repeat."""
    scale: int = measure(1, 40, 6)
    """Repeats of the pattern along a tile; even for dots."""
    width: float = measure(0.05, 0.95, 0.5)
    """Share of the second colour in a repeat: of stripes, of a dot's diameter."""
    roughness: float = measure(0.2, 1.0, 0.85)
    """Mean roughness; 1 is chalk."""
    unevenness: float = measure(0.0, 1.0, 0.3)
    """Difference of yarns in thickness and shade."""
    seed: int = 0
    """Of the unevenness."""
    label: str = ""
    """Begin of the name, such as the yarn's colour."""

    def __post_init__(self) -> None:
        check_choice("weave", self.weave, tuple(REPEATS))
        check_choice("pattern", self.pattern, tuple(COLOUR_COUNTS))
        if self.weave in _KNITS and self.pattern in _WOVEN_ONLY:
            raise ValueError(f"pattern of a knit cannot be {self.pattern!r}, which is woven")
        check_colours("colours", self.colours, COLOUR_COUNTS[self.pattern])
        super().__post_init__()
        if self.threads % REPEATS[self.weave]:
            raise ValueError(
                f"threads of {self.weave} must be a multiple of {REPEATS[self.weave]}; "
                f"got {self.threads}"
            )
        if self.pattern == "dots" and self.scale % 2:
            raise ValueError(f"scale of dots must be even; got {self.scale}")

    @property
    def name(self) -> str:
        """Colour, pattern and weave, such as "navy stripes jersey"."""
        pattern = "" if self.pattern in ("plain", "chambray") else self.pattern
        return " ".join(part for part in (self.label, pattern, self.weave) if part)

    def render(self, size: int = DEFAULT_SIZE) -> MaterialMaps:
        """Compute the maps of one tile.

        Args:
            size: Pixels along a side, in [32, 2048].
        """
        fine = get_fine_size(size)
        rng = np.random.default_rng([self.seed, 11])
        relief = make_relief(self.weave, self.threads, fine)
        colour = self._colour(relief, fine, rng)
        light = 1.0 + 0.32 * (relief.height - relief.height.mean()) + self._shade(fine, rng)
        yarn = TILE_SIZE / self.threads
        return make_maps(
            name=self.name,
            size=size,
            tile_size=TILE_SIZE,
            colour=colour * light[..., None],
            height=0.25 * yarn * relief.height,  # cloth is pressed, not a basket
            roughness=np.clip(self.roughness + 0.12 * (0.5 - relief.height), 0.0, 1.0),
        )

    def _shade(self, size: int, rng: np.random.Generator) -> np.ndarray:
        """Relative brightness of uneven yarns: streaks along both, and a broad mottle."""
        threads = self.threads
        along_warp = make_noise(rng, size, (10, threads))
        along_weft = make_noise(rng, size, (threads, 10))
        mottle = make_noise(rng, size, (9, 9))
        share = 0.5 if self.weave not in _KNITS else 0.25
        streaks = share * along_warp + (1 - share) * along_weft
        return self.unevenness * (0.13 * streaks + 0.025 * mottle)

    def _colour(self, relief: ClothRelief, size: int, rng: np.random.Generator) -> np.ndarray:
        """Colour of the upper yarn, sRGB in [0, 255], shape (N, N, 3)."""
        yarns = np.array(self.colours, dtype=np.float64)
        plain = np.broadcast_to(yarns[0], (size, size, 3))
        if self.pattern == "plain":
            return plain
        if self.pattern == "melange":
            fibres = make_noise(rng, size, (210, 64)) + 0.5 * make_noise(rng, size, (160, 24))
            return mix(plain, yarns[1], np.clip(self.width * (0.5 + 0.3 * fibres), 0.0, 1.0))
        if self.pattern == "dots":
            return mix(plain, yarns[1], _print_dots(size, self.scale, self.width))
        along_v, along_u = self._dye(yarns, size)
        if relief.is_warp is None:
            return np.broadcast_to(along_v[:, None], (size, size, 3))
        return mix(along_v[:, None], along_u[None, :], relief.is_warp)

    def _dye(self, yarns: np.ndarray, size: int) -> tuple[np.ndarray, np.ndarray]:
        """Colours of wefts by v and of warps by u, each (N, 3)."""
        u, _ = get_coordinates(size)
        count = self.threads if self.weave not in _KNITS else count_courses(self.threads)
        thread = (np.floor(u.ravel() * count) + 0.5) / count
        place = thread * self.scale % 1.0
        if self.pattern == "chambray":
            return np.tile(yarns[1], (size, 1)), np.tile(yarns[0], (size, 1))
        if self.pattern == "tartan":
            dyed = yarns[_SETT[np.floor(place * len(_SETT)).astype(int)]]
            return dyed, dyed
        dyed = yarns[(place < self.width).astype(int)]
        if self.pattern == "gingham" or self.weave in _KNITS:
            return dyed, dyed
        return np.tile(yarns[0], (size, 1)), dyed  # stripes of the warp


def _make_sett() -> np.ndarray:
    """Colours of one repeat of a tartan: symmetric about both its pivots."""
    half = [0] * 12 + [3] * 1 + [0] * 3 + [2] * 2 + [1] * 4 + [2] * 2 + [1] * 6
    return np.array(half + half[::-1])


_SETT = _make_sett()


def _print_dots(size: int, count: int, diameter: float) -> np.ndarray:
    """Print of dots in staggered rows, 0 to 1, shape (N, N)."""
    u, v = get_coordinates(size)
    row = np.floor(v * count)
    x = (u * count + 0.5 * (row % 2)) % 1.0 - 0.5
    y = (v * count) % 1.0 - 0.5
    edge = 1.5 * count / size
    return 1.0 - step(np.hypot(x, y), diameter / 2 - edge, diameter / 2 + edge)


class _FabricKind(NamedTuple):
    """Ranges of the random fabrics of one weave."""

    share: float
    threads: tuple[int, ...]
    roughness: tuple[float, float]
    unevenness: tuple[float, float]
    patterns: Mapping[Pattern, float]


_KINDS: dict[Weave, _FabricKind] = {
    "plain": _FabricKind(
        0.14, (112, 120, 128), (0.75, 0.9), (0.15, 0.4),
        {"plain": 2, "stripes": 2, "gingham": 3, "tartan": 1, "dots": 2, "chambray": 2},
    ),
    "oxford": _FabricKind(
        0.08, (96, 104, 112), (0.75, 0.9), (0.2, 0.4),
        {"plain": 1, "stripes": 2, "chambray": 3},
    ),
    "twill": _FabricKind(
        0.14, (96, 104, 112), (0.75, 0.9), (0.2, 0.45),
        {"plain": 2, "tartan": 4, "gingham": 1},
    ),
    "denim": _FabricKind(
        0.1, (88, 96, 104), (0.85, 0.95), (0.6, 1.0),
        {"chambray": 1},
    ),
    "herringbone": _FabricKind(
        0.08, (80, 96), (0.85, 0.95), (0.3, 0.5),
        {"chambray": 3, "plain": 1},
    ),
    "satin": _FabricKind(
        0.08, (140, 150, 160), (0.35, 0.5), (0.0, 0.12),
        {"plain": 4, "stripes": 1, "dots": 1},
    ),
    "linen": _FabricKind(
        0.1, (88, 96, 104), (0.85, 0.95), (0.7, 1.0),
        {"plain": 4, "chambray": 2, "stripes": 2},
    ),
    "jersey": _FabricKind(
        0.2, (64, 72, 80), (0.8, 0.95), (0.15, 0.4),
        {"plain": 3, "melange": 4, "stripes": 4, "dots": 1},
    ),
    "rib": _FabricKind(
        0.08, (48, 56, 64), (0.85, 0.95), (0.2, 0.4),
        {"plain": 3, "melange": 3, "stripes": 1},
    ),
}  # fmt: skip
WEAVES: tuple[Weave, ...] = get_args(Weave)
"""All weaves."""


def sample_fabric_material(
    seed: int | Sequence[int] | np.random.Generator,
    *,
    weaves: Sequence[Weave] = WEAVES,
    avoid: Collection[str] = (),
) -> FabricMaterial:
    """Draw a fabric.

    Args:
        seed: Seed or generator; equal seeds give equal fabrics.
        weaves: Weaves to choose from.
        avoid: Names of `YARNS` that must not fill it, such as `PALE` on a light floor; second
            colours are exempt.

    Raises:
        ValueError: If a weave is unknown, or no yarn is left for the one that was drawn.
    """
    unknown = sorted(set(weaves) - set(WEAVES))
    if unknown or not weaves:
        raise ValueError(f"weaves must be some of {list(WEAVES)}; got {unknown or list(weaves)}")
    rng = np.random.default_rng(seed)
    weave: Weave = pick(rng, {w: _KINDS[w].share for w in weaves})  # pyright: ignore[reportAssignmentType]
    kind = _KINDS[weave]
    pattern: Pattern = pick(rng, {str(p): w for p, w in kind.patterns.items()})  # pyright: ignore[reportAssignmentType]
    names = _draw_yarns(rng, weave, pattern, avoid)
    scale, width = _SCALES[pattern](rng)
    label = "/".join(names[: 2 if pattern in ("chambray", "stripes", "gingham", "dots") else 1])
    return FabricMaterial(
        weave=weave,
        pattern=pattern,
        colours=tuple(shift(YARNS[name], rng, 4.0) for name in names),
        threads=int(rng.choice(kind.threads)),
        scale=scale,
        width=width,
        roughness=float(rng.uniform(*kind.roughness)),
        unevenness=float(rng.uniform(*kind.unevenness)),
        seed=int(rng.integers(2**31)),
        label=label,
    )


def _draw_yarns(
    rng: np.random.Generator, weave: Weave, pattern: Pattern, avoid: Collection[str]
) -> tuple[str, ...]:
    unknown = sorted(set(avoid) - set(YARNS))
    if unknown:
        raise ValueError(f"avoid must be some of {sorted(YARNS)}; got {unknown}")
    sets: list[tuple[str, ...]] = [(name,) for name in YARNS]
    if weave == "denim":
        sets = [("navy", "ecru"), ("denim", "ecru"), ("black", "ecru"), ("charcoal", "ecru")]
    elif pattern == "tartan":
        sets = list(TARTANS)
    sets = [names for names in sets if names[0] not in avoid]
    if not sets:
        raise ValueError(f"avoid must leave a yarn for {weave} {pattern}; got {sorted(avoid)}")
    names = sets[rng.integers(len(sets))]
    main, *others = names
    if others:
        return names
    if COLOUR_COUNTS[pattern] == 1:
        return (main,)
    if pattern == "melange":  # fibres of a quiet colour spun in
        return main, str(rng.choice(["charcoal", "camel"] if main in PALE else list(PALE)))
    return main, str(rng.choice(PARTNERS[main]))


_SCALES: dict[Pattern, Callable[[np.random.Generator], tuple[int, float]]] = {
    "plain": lambda rng: (1, 0.5),
    "chambray": lambda rng: (1, 0.5),
    "melange": lambda rng: (1, float(rng.uniform(0.3, 0.8))),
    "stripes": lambda rng: (int(rng.choice([3, 4, 6, 8, 10, 12])), float(rng.uniform(0.2, 0.6))),
    "gingham": lambda rng: (int(rng.choice([6, 8, 10, 16])), 0.5),
    "tartan": lambda rng: (int(rng.choice([1, 2, 2])), 0.5),
    "dots": lambda rng: (int(rng.choice([6, 8, 10, 14])), float(rng.uniform(0.3, 0.55))),
}
"""By pattern: draws repeats along a tile, and the second colour's share."""
