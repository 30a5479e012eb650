"""The measures of trousers."""

from __future__ import annotations

from dataclasses import dataclass

from dgl_assets.ranges import Measures, check_limit, measure


@dataclass(frozen=True, kw_only=True)
class TrousersParameters(Measures):
    """Measures of trousers that lie flat, legs a little apart, at about 85 % of life size."""

    waist_half_width: float = measure(0.08, 0.30, 0.165)
    """Centre to the side at the waistband [m]: a quarter of its girth."""
    hip_half_width: float = measure(0.11, 0.34, 0.215)
    """Centre to the side at the hip, 0.6 of the rise below the waist [m]."""
    rise: float = measure(0.12, 0.36, 0.23)
    """Side of the waistband down to the crotch [m]."""
    waist_front_drop: float = measure(0.0, 0.05, 0.015)
    """Fall of the front waistband at the centre [m]."""
    waist_back_rise: float = measure(0.0, 0.03, 0.008)
    """Rise of the back waistband at the centre [m]."""
    inseam_length: float = measure(0.03, 0.80, 0.66)
    """Crotch to hem [m]; shorts have less than about a third of a metre."""
    thigh_width: float = measure(0.10, 0.34, 0.225)
    """Width of a leg at the crotch [m]."""
    knee_width: float = measure(0.06, 0.32, 0.165)
    """Width halfway down the inseam [m]."""
    ankle_width: float = measure(0.05, 0.36, 0.145)
    """Width at nine tenths of the inseam [m]; above `hem_width` the hem is gathered in a cuff."""
    hem_width: float = measure(0.045, 0.38, 0.14)
    """Width at the hem [m]."""
    leg_angle: float = measure(0.0, 0.30, 0.09)
    """Outward direction of each leg [rad]."""
    leg_angle_difference: float = measure(-0.06, 0.06, 0.0)
    """Left angle minus right angle [rad]."""
    pocket_bulge: float = measure(0.0, 0.035, 0.0)
    """Bulge of a cargo pocket at the side of the thigh [m]; 0 for none."""
    hem_slant: float = measure(-0.03, 0.03, 0.0)
    """Fall of the hem from inside to outside, beyond the slant that the leg gives [m]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        most = self.hip_half_width + 0.02
        check_limit("waist_half_width", self.waist_half_width, "hip_half_width + 0.02 m", most=most)
        if not 0.85 <= self.thigh_width / self.hip_half_width <= 1.25:
            raise ValueError(
                f"thigh_width must be 0.85 to 1.25 times hip_half_width ({self.hip_half_width}); "
                f"got {self.thigh_width}"
            )
        most = 0.3 * self.rise
        check_limit("waist_front_drop", self.waist_front_drop, "0.3 of the rise", most=most)
        if self.pocket_bulge > 0 and self.inseam_length < 0.15:
            raise ValueError(
                f"pocket_bulge needs an inseam_length of at least 0.15 m; got {self.inseam_length}"
            )
