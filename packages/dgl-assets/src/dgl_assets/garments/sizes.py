"""Bodies that garments are cut for, from children to XXL.

Source:
    From memory. Chest, waist and hip girths follow the size codes of EN 13402-3 (women and men by
    chest, children by height) in the steps of its tables, rounded to whole centimetres. Statures
    and shoulders are near ASTM D5585 (women) and common men's and children's charts. Lengths of
    arm, back and leg are nominal shares of the stature.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

SCALE = 0.85
"""Size of garments relative to life, as in the paper."""

Population = Literal["children", "women", "men"]
Sizes = Literal["reach", "all"]
"""Garments that both robots reach, or all sizes from children to XXL."""
ADULTS: tuple[Population, ...] = ("women", "men")
EVERYBODY: tuple[Population, ...] = ("children", *ADULTS)

_ARM, _BACK, _INSIDE_LEG, _RISE = 0.335, 0.245, 0.445, 0.155  # shares of the stature


@dataclass(frozen=True)
class BodySize:
    """A body in one size, in life size [m]."""

    label: str
    """Such as "M", or the height in centimetres for children."""
    population: Population
    """Chart that it is from."""
    stature: float
    chest: float
    """Girth of chest or bust."""
    waist: float
    hip: float
    shoulder_width: float
    """From one shoulder point to the other."""

    @property
    def arm_length(self) -> float:
        """Shoulder point to wrist [m], nominal."""
        return _ARM * self.stature

    @property
    def back_length(self) -> float:
        """Highest point of the shoulder to the waist [m], nominal."""
        return _BACK * self.stature

    @property
    def inside_leg(self) -> float:
        """Crotch to ankle [m], nominal."""
        return _INSIDE_LEG * self.stature

    @property
    def rise(self) -> float:
        """Waist to crotch [m], nominal."""
        return _RISE * self.stature

    @property
    def size_factor(self) -> float:
        """Size of details such as necklines relative to a women's M: the root of the girth."""
        return float(np.sqrt(self.chest / 0.92))


_CHARTS: dict[Population, tuple[tuple[str, int, int, int, int, float], ...]] = {
    "children": (
        ("104", 104, 57, 54, 60, 26.5),
        ("116", 116, 60, 55, 64, 28.5),
        ("128", 128, 64, 58, 69, 31.0),
        ("140", 140, 70, 62, 76, 33.5),
        ("152", 152, 77, 66, 83, 36.5),
        ("164", 164, 84, 70, 90, 38.0),
    ),
    "women": (
        ("XS", 164, 80, 64, 88, 36.5),
        ("S", 166, 86, 70, 94, 37.8),
        ("M", 168, 92, 76, 100, 39.0),
        ("L", 168, 100, 84, 108, 40.5),
        ("XL", 168, 110, 94, 117, 42.0),
        ("XXL", 168, 122, 106, 127, 43.5),
    ),
    "men": (
        ("XS", 170, 84, 72, 88, 41.0),
        ("S", 174, 90, 78, 92, 42.5),
        ("M", 178, 98, 86, 98, 44.5),
        ("L", 182, 106, 94, 105, 46.5),
        ("XL", 185, 114, 103, 112, 48.5),
        ("XXL", 188, 124, 114, 120, 50.5),
    ),
}
BODY_SIZES: tuple[BodySize, ...] = tuple(
    BodySize(label, population, *(length / 100 for length in lengths))
    for population, rows in _CHARTS.items()
    for label, *lengths in rows
)
"""The chart: children by height, women and men from XS to XXL."""


def draw_body(
    rng: np.random.Generator, *, populations: tuple[Population, ...] = EVERYBODY
) -> BodySize:
    """Draw a body of the chart and vary its measures by about 2 %."""
    rows = [row for row in BODY_SIZES if row.population in populations]
    row = rows[rng.integers(len(rows))]
    factors = 1 + np.clip(rng.normal(0.0, 0.02, 5), -0.05, 0.05)
    lengths = (row.stature, row.chest, row.waist, row.hip, row.shoulder_width)
    varied = (float(length * factor) for length, factor in zip(lengths, factors, strict=True))
    return BodySize(row.label, row.population, *varied)
