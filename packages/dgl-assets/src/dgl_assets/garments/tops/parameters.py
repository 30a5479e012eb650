"""The measures of a long-sleeved top."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass

PARAMETER_RANGES: dict[str, tuple[float, float]] = {
    "chest_half_width": (0.18, 0.31),
    "body_length": (0.46, 0.70),
    "shoulder_half_width": (0.14, 0.30),
    "shoulder_slope": (0.12, 0.50),
    "armhole_depth": (0.15, 0.30),
    "neck_half_width": (0.055, 0.14),
    "neck_front_depth": (0.03, 0.18),
    "neck_back_depth": (0.005, 0.05),
    "neck_roundness": (1.0, 3.5),
    "collar_height": (0.0, 0.08),
    "sleeve_length": (0.34, 0.60),
    "sleeve_angle": (0.40, 1.00),
    "sleeve_angle_difference": (-0.08, 0.08),
    "sleeve_bend": (-0.015, 0.025),
    "upper_sleeve_width": (0.06, 0.20),
    "lower_sleeve_width": (0.05, 0.20),
    "cuff_width": (0.05, 0.17),
    "hem_flare": (-0.05, 0.09),
    "waist_taper": (-0.035, 0.05),
    "hem_curve": (-0.03, 0.07),
}
"""Smallest and largest accepted value of each measure, in its own unit."""


@dataclass(frozen=True, kw_only=True)
class TopParameters:
    """Measures of a long-sleeved top that lies flat, arms down and out.

    Lengths are in metres at about 85 % of life size, angles in radians. Ranges are in `PARAMETER_RANGES`; measures that
    contradict each other are refused when the top is made.

    Attributes:
        chest_half_width: Centre to armpit [m], 0.18 to 0.31. A quarter of the girth of the garment.
        body_length: Highest point of the shoulder to the hem at the centre [m], 0.46 to 0.70.
        shoulder_half_width: Centre to where the shoulder line meets the upper edge of the sleeve [m], 0.14 to 0.30.
            Near `chest_half_width` the shoulder is dropped.
        shoulder_slope: Fall of the shoulder line below horizontal [rad], 0.12 to 0.50.
        armhole_depth: Highest point of the shoulder down to the armpit [m], 0.15 to 0.30.
        neck_half_width: Centre to the highest point of the shoulder [m], 0.055 to 0.14.
        neck_front_depth: Fall of the front neckline at the centre [m], 0.03 to 0.18.
        neck_back_depth: Fall of the back neckline at the centre [m], 0.005 to 0.05.
        neck_roundness: Exponent of the front neckline, 1.0 (V neck) through 2.0 (crew) to 3.5 (square).
        collar_height: Height of a standing collar [m], 0 (none) to 0.08 (turtleneck). It covers the neckline, so the
            opening falls less by as much.
        sleeve_length: Shoulder to cuff along the upper edge [m], 0.34 to 0.60.
        sleeve_angle: Fall of the sleeves below horizontal [rad], 0.40 to 1.00.
        sleeve_angle_difference: Left angle minus right angle [rad], -0.08 to 0.08: no top lies perfectly.
        sleeve_bend: Sideways bow of the sleeve at its middle [m], -0.015 to 0.025, positive upward.
        upper_sleeve_width: Width of the sleeve at a quarter of its underarm seam [m], 0.06 to 0.20.
        lower_sleeve_width: Width at four fifths of its underarm seam [m], 0.05 to 0.20.
        cuff_width: Width at the cuff [m], 0.05 to 0.17.
        hem_flare: Half width at the hem minus `chest_half_width` [m], -0.05 to 0.09.
        waist_taper: How far the side seam runs inside the straight line from armpit to hem [m], -0.035 (cocoon) to
            0.05 (shaped).
        hem_curve: Rise of the hem from the centre to the side seams [m], -0.03 to 0.07 (shirt tail).

    Source:
        Defaults are a women's M / men's S regular cut, from memory of the size charts of ASTM D5585 and EN 13402 plus
        usual ease, times 0.85 as in the paper; they are not copied from either standard.
    """

    chest_half_width: float = 0.228
    body_length: float = 0.56
    shoulder_half_width: float = 0.188
    shoulder_slope: float = 0.32
    armhole_depth: float = 0.215
    neck_half_width: float = 0.082
    neck_front_depth: float = 0.085
    neck_back_depth: float = 0.018
    neck_roundness: float = 2.2
    collar_height: float = 0.0
    sleeve_length: float = 0.50
    sleeve_angle: float = 0.76
    sleeve_angle_difference: float = 0.0
    sleeve_bend: float = 0.0
    upper_sleeve_width: float = 0.122
    lower_sleeve_width: float = 0.088
    cuff_width: float = 0.078
    hem_flare: float = 0.0
    waist_taper: float = 0.008
    hem_curve: float = 0.0

    def __post_init__(self) -> None:
        for name, value in asdict(self).items():
            low, high = PARAMETER_RANGES[name]
            if not (isinstance(value, int | float) and math.isfinite(value)):
                raise ValueError(f"{name} must be a finite number; got {value!r}")
            if not low <= value <= high:
                raise ValueError(f"{name} must be in [{low}, {high}]; got {value}")
        if self.neck_half_width > self.shoulder_half_width - 0.035:
            raise ValueError(
                f"neck_half_width must be at least 0.035 m below shoulder_half_width "
                f"({self.shoulder_half_width}); got {self.neck_half_width}"
            )
        if self.shoulder_half_width > self.chest_half_width + 0.01:
            raise ValueError(
                f"shoulder_half_width must be at most chest_half_width + 0.01 m "
                f"({self.chest_half_width + 0.01:.3f}); got {self.shoulder_half_width}"
            )
        if self.neck_back_depth > self.neck_front_depth - 0.01:
            raise ValueError(
                f"neck_back_depth must be at least 0.01 m below neck_front_depth "
                f"({self.neck_front_depth}); got {self.neck_back_depth}"
            )
        if self.neck_front_depth > self.armhole_depth - 0.03:
            raise ValueError(
                f"neck_front_depth must be at least 0.03 m below armhole_depth "
                f"({self.armhole_depth}); got {self.neck_front_depth}"
            )
        steepness = self.neck_roundness * self.neck_front_depth / self.neck_half_width
        if steepness > 3.5:
            raise ValueError(
                f"neck_roundness * neck_front_depth / neck_half_width, the slope of the neckline at "
                f"the shoulder, must be at most 3.5; got {steepness:.2f}"
            )
        if 0.0 < self.collar_height < 0.015:
            raise ValueError(
                f"collar_height must be 0 or at least 0.015 m; got {self.collar_height}"
            )
        if self.sleeve_angle - abs(self.sleeve_angle_difference) / 2 < self.shoulder_slope:
            raise ValueError(
                f"both sleeves must fall at least as steeply as the shoulder "
                f"(shoulder_slope {self.shoulder_slope}); got sleeve_angle {self.sleeve_angle} with "
                f"sleeve_angle_difference {self.sleeve_angle_difference}"
            )

    @property
    def span(self) -> float:
        """Upper corner of one cuff to that of the other, sleeves at the mean angle [m]."""
        return 2 * (self.shoulder_half_width + self.sleeve_length * math.cos(self.sleeve_angle))


def compute_armhole_width(parameters: TopParameters, *, sleeve_angle: float) -> float:
    """Compute the width of the sleeve where it leaves the armpit [m].

    It follows from shoulder, chest, armhole and the angle of the sleeve, and bounds `upper_sleeve_width`.
    """
    p = parameters
    x = p.chest_half_width - p.shoulder_half_width
    shoulder_drop = (p.shoulder_half_width - p.neck_half_width) * math.tan(p.shoulder_slope)
    y = shoulder_drop - p.armhole_depth
    return -y * math.cos(sleeve_angle) - x * math.sin(sleeve_angle)
