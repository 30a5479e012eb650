"""The measures of trousers."""

from __future__ import annotations

from dataclasses import dataclass

from dgl_assets.garments.measures import check_ranges

TROUSERS_RANGES: dict[str, tuple[float, float]] = {
    "waist_half_width": (0.08, 0.30),
    "hip_half_width": (0.11, 0.34),
    "rise": (0.12, 0.36),
    "waist_front_drop": (0.0, 0.05),
    "waist_back_rise": (0.0, 0.03),
    "inseam_length": (0.03, 0.80),
    "thigh_width": (0.10, 0.34),
    "knee_width": (0.06, 0.32),
    "ankle_width": (0.05, 0.36),
    "hem_width": (0.045, 0.38),
    "leg_angle": (0.0, 0.30),
    "leg_angle_difference": (-0.06, 0.06),
    "pocket_bulge": (0.0, 0.035),
    "hem_slant": (-0.03, 0.03),
}
"""Smallest and largest accepted value of each measure, in its own unit."""


@dataclass(frozen=True, kw_only=True)
class TrousersParameters:
    """Measures of trousers that lie flat, legs a little apart.

    Lengths are in metres at about 85 % of life size, angles in radians; ranges are in `TROUSERS_RANGES`.

    Attributes:
        waist_half_width: Centre to the side at the waistband [m]. A quarter of its girth.
        hip_half_width: Centre to the side at the hip, 0.6 of the rise below the waist [m].
        rise: Side of the waistband down to the crotch [m].
        waist_front_drop: Fall of the front waistband at the centre [m].
        waist_back_rise: Rise of the back waistband at the centre [m].
        inseam_length: Crotch to hem [m]; short below about a third of a metre.
        thigh_width: Width of a leg at the crotch [m].
        knee_width: Width halfway down the inseam [m].
        ankle_width: Width at nine tenths of the inseam [m]; above `hem_width` the hem is gathered in a cuff.
        hem_width: Width at the hem [m].
        leg_angle: How far each leg points outward [rad].
        leg_angle_difference: Left angle minus right angle [rad].
        pocket_bulge: How far a cargo pocket stands out of the side of the thigh [m], 0 for none.
        hem_slant: How much lower the hem is outside than inside, beyond the slant that the leg gives [m].
    """

    waist_half_width: float = 0.165
    hip_half_width: float = 0.215
    rise: float = 0.23
    waist_front_drop: float = 0.015
    waist_back_rise: float = 0.008
    inseam_length: float = 0.66
    thigh_width: float = 0.225
    knee_width: float = 0.165
    ankle_width: float = 0.145
    hem_width: float = 0.14
    leg_angle: float = 0.09
    leg_angle_difference: float = 0.0
    pocket_bulge: float = 0.0
    hem_slant: float = 0.0

    def __post_init__(self) -> None:
        check_ranges(self, TROUSERS_RANGES)
        if self.waist_half_width > self.hip_half_width + 0.02:
            raise ValueError(
                f"waist_half_width must be at most hip_half_width + 0.02 m "
                f"({self.hip_half_width + 0.02:.3f}); got {self.waist_half_width}"
            )
        if not 0.85 <= self.thigh_width / self.hip_half_width <= 1.25:
            raise ValueError(
                f"thigh_width must be 0.85 to 1.25 times hip_half_width ({self.hip_half_width}); "
                f"got {self.thigh_width}"
            )
        if self.waist_front_drop > 0.3 * self.rise:
            raise ValueError(
                f"waist_front_drop must be at most 0.3 of the rise ({self.rise}); got "
                f"{self.waist_front_drop}"
            )
        if self.pocket_bulge > 0 and self.inseam_length < 0.15:
            raise ValueError(
                f"a pocket_bulge needs an inseam_length of at least 0.15 m; got {self.inseam_length}"
            )
