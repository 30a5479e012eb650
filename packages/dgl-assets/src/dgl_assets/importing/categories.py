"""Sizes and openings of imported garments by category."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class CategoryFacts:
    """Facts that tell one category, its unit and its orientation."""

    openings: tuple[str, ...]
    """Openings that every garment of the category has."""
    size: tuple[float, float]
    """Plausible longest extent of the bounding box, from a child's to XXL, life size or 85 % [m].

    Where sleeves may be short or long, several units may be plausible. Elsewhere the ends differ by
    less than a factor of 2.54, so that inches and centimetres exclude each other.
    """
    trunk: float | None = None
    """Usual size without sleeves, the geometric mean of length and width [m], where it matters."""
    wall_thickness: float | None = None
    """None for a sheet of cloth; thickness of the wall that an elastic shell gets [m]."""


CATEGORIES: dict[str, CategoryFacts] = {
    "Tops_LongSleeve": CategoryFacts(
        openings=("neck", "hem", "left cuff", "right cuff"), size=(0.45, 1.88), trunk=0.55
    ),
    "Tops_NoSleeve": CategoryFacts(
        openings=("neck", "hem", "left armhole", "right armhole"), size=(0.36, 0.90)
    ),
    "Tops_FrontOpen": CategoryFacts(
        openings=("front from hem to neck", "left cuff", "right cuff"), size=(0.75, 1.88)
    ),
    "Dress_LongSleeve": CategoryFacts(
        openings=("neck", "hem", "left cuff", "right cuff"), size=(0.55, 1.80), trunk=0.55
    ),
    "Trousers": CategoryFacts(openings=("waist", "left leg", "right leg"), size=(0.48, 1.20)),
    "Scarf": CategoryFacts(openings=("edge",), size=(0.90, 2.25)),
    "Baseball_Cap": CategoryFacts(openings=("head",), size=(0.15, 0.37), wall_thickness=0.003),
    "Bowl_Hat": CategoryFacts(openings=("head",), size=(0.15, 0.37), wall_thickness=0.003),
    "Glove": CategoryFacts(openings=("wrist",), size=(0.13, 0.32), wall_thickness=0.002),
}
"""Facts of each category."""
