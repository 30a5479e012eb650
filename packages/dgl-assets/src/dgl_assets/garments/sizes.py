"""Bodies that garments are cut for, from children to XXL.

Source:
    Chest, waist and hip girths follow the size codes of EN 13402-3 (women and men by chest, children by height) in the
    steps of its tables, as remembered and rounded to whole centimetres; they are nominal and not copied from the
    standard. Statures of adults and widths of shoulders are of the size of those of ASTM D5585 (women) and of common
    men's and children's charts, likewise from memory. Lengths of arm, back and leg are fixed shares of the stature
    (below), which are nominal as well.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

SCALE = 0.85
"""Size of garments relative to life, as those of the paper (its assets of about a centimetre per unit times 0.0085)."""

Population = Literal["children", "women", "men"]
Sizes = Literal["reach", "all"]
"""Which garments are drawn: those that both robots reach, or all sizes from children to XXL."""

_ARM, _BACK, _INSIDE_LEG, _RISE = 0.335, 0.245, 0.445, 0.155  # shares of the stature


@dataclass(frozen=True, kw_only=True)
class BodySize:
    """A body in one size, in life size [m].

    Attributes:
        label: Such as "M", or the height in centimetres for children.
        population: Whose chart.
        stature: Height of the body.
        chest: Girth of the chest or bust.
        waist: Girth of the waist.
        hip: Girth of the hip.
        shoulder_width: From one shoulder point to the other.
    """

    label: str
    population: Population
    stature: float
    chest: float
    waist: float
    hip: float
    shoulder_width: float

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
        """Size of details such as necklines, relative to a women's M; grows with the root of the girth."""
        return float(np.sqrt(self.chest / 0.92))


def _tabulate(
    population: Population, rows: tuple[tuple[str, int, int, int, int, float], ...]
) -> tuple[BodySize, ...]:
    return tuple(
        BodySize(
            label=label,
            population=population,
            stature=stature / 100,
            chest=chest / 100,
            waist=waist / 100,
            hip=hip / 100,
            shoulder_width=shoulder / 100,
        )
        for label, stature, chest, waist, hip, shoulder in rows
    )


BODY_SIZES: tuple[BodySize, ...] = (
    *_tabulate(
        "children",
        (
            ("104", 104, 57, 54, 60, 26.5),
            ("116", 116, 60, 55, 64, 28.5),
            ("128", 128, 64, 58, 69, 31.0),
            ("140", 140, 70, 62, 76, 33.5),
            ("152", 152, 77, 66, 83, 36.5),
            ("164", 164, 84, 70, 90, 38.0),
        ),
    ),
    *_tabulate(
        "women",
        (
            ("XS", 164, 80, 64, 88, 36.5),
            ("S", 166, 86, 70, 94, 37.8),
            ("M", 168, 92, 76, 100, 39.0),
            ("L", 168, 100, 84, 108, 40.5),
            ("XL", 168, 110, 94, 117, 42.0),
            ("XXL", 168, 122, 106, 127, 43.5),
        ),
    ),
    *_tabulate(
        "men",
        (
            ("XS", 170, 84, 72, 88, 41.0),
            ("S", 174, 90, 78, 92, 42.5),
            ("M", 178, 98, 86, 98, 44.5),
            ("L", 182, 106, 94, 105, 46.5),
            ("XL", 185, 114, 103, 112, 48.5),
            ("XXL", 188, 124, 114, 120, 50.5),
        ),
    ),
)
"""The chart: children by height, women and men from XS to XXL."""


def draw_body(
    rng: np.random.Generator, *, populations: tuple[Population, ...] = ("children", "women", "men")
) -> BodySize:
    """Draw a body of the chart and vary its measures by about 2 %, for no two bodies of a size are alike."""
    rows = [row for row in BODY_SIZES if row.population in populations]
    row = rows[rng.integers(len(rows))]
    factors = 1 + np.clip(rng.normal(0.0, 0.02, 5), -0.05, 0.05)
    return BodySize(
        label=row.label,
        population=row.population,
        stature=float(row.stature * factors[0]),
        chest=float(row.chest * factors[1]),
        waist=float(row.waist * factors[2]),
        hip=float(row.hip * factors[3]),
        shoulder_width=float(row.shoulder_width * factors[4]),
    )
