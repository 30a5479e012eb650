"""How a garment's cloth looks: colours, stripes and knits in code, drawn from a seed."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy import ndimage

Rgb = tuple[int, int, int]
Pattern = Literal["plain", "heather", "breton", "stripes", "check"]

TILE_SIZE = 0.32
"""Side of a texture in the flat panel [m]; it repeats beyond."""
RESOLUTION = 512
"""Pixels along a side of a texture, 0.6 mm each."""
_STITCH = 8  # pixels of a stitch both ways; divides the resolution, so that tiles join

COLOURS: dict[str, Rgb] = {
    "mustard": (208, 150, 44),
    "terracotta": (190, 92, 62),
    "burgundy": (122, 38, 52),
    "rose": (198, 120, 124),
    "coral": (222, 112, 92),
    "teal": (38, 124, 126),
    "forest": (50, 96, 70),
    "sage": (124, 150, 112),
    "navy": (44, 62, 106),
    "denim": (82, 118, 162),
    "sky": (122, 168, 204),
    "plum": (104, 66, 110),
    "charcoal": (88, 90, 98),
    "ecru": (238, 229, 210),
}
"""Yarn colours, sRGB."""

_PALE: tuple[str, ...] = ("ecru",)  # too near a light floor to fill a garment alone
_WEIGHTS: dict[Pattern, float] = {
    "plain": 0.25,
    "heather": 0.3,
    "breton": 0.2,
    "stripes": 0.15,
    "check": 0.1,
}


@dataclass(frozen=True, kw_only=True, eq=False)
class Fabric:
    """The look of a cloth."""

    name: str
    """Colours and pattern, such as "navy heather"."""
    colour: tuple[float, float, float]
    """Mean colour of the texture, linear, each in [0, 1]."""
    roughness: float
    """0 for a mirror, 1 for chalk."""
    texture: np.ndarray
    """One tile, shape (H, W, 3), uint8, sRGB. It repeats without a seam in both directions."""
    tile_size: float = TILE_SIZE
    """Side of the tile in the flat panel [m]."""

    def compute_uvs(self, rest_vertices: np.ndarray) -> np.ndarray:
        """Place the texture on flat panels at its real scale.

        Args:
            rest_vertices: Positions in the flat panels [m], shape (V, 2).

        Returns:
            Texture coordinates in tiles, shape (V, 2), float32; the first row of the texture is at
            v = 0 and rows follow the panel's y.
        """
        rest_vertices = np.asarray(rest_vertices)
        if rest_vertices.ndim != 2 or rest_vertices.shape[1] != 2:
            raise ValueError(f"rest_vertices must have shape (V, 2); got {rest_vertices.shape}")
        return (rest_vertices / self.tile_size).astype(np.float32)


def make_fabric(seed: int | Sequence[int] | np.random.Generator) -> Fabric:
    """Draw a fabric: one of the yarn colours, a pattern, and the unevenness of a knit.

    Args:
        seed: Seed or generator; equal seeds give equal fabrics.
    """
    rng = np.random.default_rng(seed)
    patterns = list(_WEIGHTS)
    pattern = patterns[rng.choice(len(patterns), p=list(_WEIGHTS.values()))]
    filling = [name for name in COLOURS if name not in _PALE]
    main = filling[rng.integers(len(filling))]
    shift = rng.normal(0.0, 4.0, 3)  # no two dye lots are alike
    first = np.clip(np.array(COLOURS[main], dtype=np.float64) + shift, 0, 255)
    second = np.array(COLOURS["ecru"], dtype=np.float64)
    share = _PATTERNS[pattern](rng)[..., None]  # of the second yarn
    image = first * (1.0 - share) + second * share
    image *= 1.0 + _knit(rng, mottle=0.06 if pattern == "heather" else 0.03)[..., None]
    texture = np.clip(image + 0.5, 0, 255).astype(np.uint8)
    linear = (texture.reshape(-1, 3) / 255.0) ** 2.2
    return Fabric(
        name=f"{main} {pattern}",
        colour=tuple(float(c) for c in linear.mean(axis=0)),
        roughness=float(rng.uniform(0.8, 0.95)),
        texture=texture,
    )


def _plain(rng: np.random.Generator) -> np.ndarray:
    return np.zeros((RESOLUTION, RESOLUTION))


def _heather(rng: np.random.Generator) -> np.ndarray:
    """Pale fibres spun into the yarn: short streaks along the rows."""
    streaks = _smooth_noise(rng, (1.0, 7.0))
    return np.clip(0.09 + 0.08 * streaks, 0.0, 0.4)


def _breton(rng: np.random.Generator) -> np.ndarray:
    """Narrow stripes of the first yarn on the second."""
    count = int(rng.choice([8, 10, 13]))
    is_stripe = np.arange(RESOLUTION) * count % RESOLUTION < 0.42 * RESOLUTION
    return np.repeat(np.where(is_stripe, 0.0, 0.97)[:, None], RESOLUTION, axis=1)


def _stripes(rng: np.random.Generator) -> np.ndarray:
    """Thin pale stripes on the first yarn."""
    count, width = int(rng.choice([4, 5, 6])), float(rng.uniform(0.14, 0.26))
    is_stripe = np.arange(RESOLUTION) * count % RESOLUTION < width * RESOLUTION
    return np.repeat(np.where(is_stripe, 0.85, 0.0)[:, None], RESOLUTION, axis=1)


def _check(rng: np.random.Generator) -> np.ndarray:
    """Gingham: the second yarn in half of the warp and half of the weft."""
    count = int(rng.choice([6, 8]))
    band = np.where(np.arange(RESOLUTION) * count % RESOLUTION < RESOLUTION / 2, 0.5, 0.0)
    return 0.9 * (band[:, None] + band[None, :])


_PATTERNS: dict[Pattern, Callable[[np.random.Generator], np.ndarray]] = {
    "plain": _plain,
    "heather": _heather,
    "breton": _breton,
    "stripes": _stripes,
    "check": _check,
}


def _knit(rng: np.random.Generator, *, mottle: float) -> np.ndarray:
    """Relative brightness of stockinette: columns of V-shaped stitches, and uneven yarn."""
    row, column = np.indices((RESOLUTION, RESOLUTION))
    across = np.abs((column % _STITCH + 0.5) / _STITCH - 0.5) * 2  # 0 mid-stitch, 1 between columns
    along = (row + across * _STITCH / 2) % _STITCH / _STITCH
    stitch = 0.5 * np.cos(2 * np.pi * along) - across**4
    uneven = 0.9 * _smooth_noise(rng, (1.5, 4.0)) + 0.15 * _smooth_noise(rng, (14.0, 14.0))
    return 0.05 * (stitch - stitch.mean()) + mottle * uneven


def _smooth_noise(rng: np.random.Generator, sigma: tuple[float, float]) -> np.ndarray:
    """Seamless noise of unit variance, smoothed over `sigma` pixels (rows, columns)."""
    noise = rng.standard_normal((RESOLUTION, RESOLUTION))
    noise = ndimage.gaussian_filter(noise, sigma, mode="wrap")
    return noise / noise.std()
