"""Colours of yarns and dyes, and sets that go together."""

from __future__ import annotations

import numpy as np

Rgb = tuple[int, int, int]

YARNS: dict[str, Rgb] = {
    "mustard": (208, 150, 44),
    "terracotta": (190, 92, 62),
    "rust": (158, 74, 40),
    "burgundy": (122, 38, 52),
    "rose": (198, 120, 124),
    "coral": (222, 112, 92),
    "lilac": (164, 142, 186),
    "plum": (104, 66, 110),
    "teal": (38, 124, 126),
    "forest": (50, 96, 70),
    "olive": (112, 112, 66),
    "sage": (124, 150, 112),
    "navy": (44, 62, 106),
    "denim": (82, 118, 162),
    "sky": (122, 168, 204),
    "camel": (182, 144, 100),
    "chocolate": (96, 66, 50),
    "charcoal": (88, 90, 98),
    "black": (44, 44, 48),
    "stone": (188, 180, 166),
    "ecru": (232, 222, 202),
    "white": (232, 231, 227),
}
"""Colours by name, sRGB."""

PALE: tuple[str, ...] = ("ecru", "white", "stone")
"""Colours that are hard to tell from a light floor."""

PARTNERS: dict[str, tuple[str, ...]] = {
    "mustard": ("ecru", "charcoal", "navy"),
    "terracotta": ("ecru", "stone", "navy"),
    "rust": ("ecru", "camel", "forest"),
    "burgundy": ("ecru", "rose", "navy"),
    "rose": ("white", "burgundy", "charcoal"),
    "coral": ("white", "navy", "ecru"),
    "lilac": ("white", "plum", "charcoal"),
    "plum": ("ecru", "lilac", "stone"),
    "teal": ("ecru", "mustard", "white"),
    "forest": ("ecru", "camel", "sage"),
    "olive": ("ecru", "black", "camel"),
    "sage": ("white", "forest", "ecru"),
    "navy": ("white", "ecru", "sky"),
    "denim": ("ecru", "white", "navy"),
    "sky": ("white", "navy", "ecru"),
    "camel": ("ecru", "chocolate", "black"),
    "chocolate": ("ecru", "camel", "sky"),
    "charcoal": ("white", "stone", "mustard"),
    "black": ("ecru", "stone", "white"),
    "stone": ("charcoal", "chocolate", "navy"),
    "ecru": ("navy", "rust", "forest"),
    "white": ("navy", "black", "burgundy"),
}
"""Second yarns for each first one."""

TARTANS: tuple[tuple[str, str, str, str], ...] = (
    ("burgundy", "navy", "forest", "mustard"),
    ("navy", "forest", "black", "ecru"),
    ("forest", "navy", "burgundy", "ecru"),
    ("camel", "black", "white", "burgundy"),
    ("charcoal", "stone", "black", "coral"),
    ("sky", "navy", "white", "coral"),
    ("terracotta", "chocolate", "ecru", "teal"),
)
"""Ground, second ground, lines and overcheck of tartans."""


def shift(colour: Rgb, rng: np.random.Generator, spread: float) -> Rgb:
    """Vary a colour as dye lots do, by a normal draw of `spread` in each channel."""
    r, g, b = np.clip(np.array(colour) + rng.normal(0.0, spread, 3), 0, 255).round().astype(int)
    return int(r), int(g), int(b)


def check_colours(name: str, colours: tuple[Rgb, ...], count: int) -> None:
    """Refuse anything but `count` colours of three whole numbers in [0, 255]."""
    is_good = len(colours) == count and all(
        len(c) == 3 and all(isinstance(p, int) and 0 <= p <= 255 for p in c) for c in colours
    )
    if not is_good:
        raise ValueError(f"{name} must be {count} sRGB colours in [0, 255]; got {colours}")
