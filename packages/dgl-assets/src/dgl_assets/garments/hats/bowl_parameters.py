"""The measures of a bowl hat."""

from __future__ import annotations

from dataclasses import asdict, dataclass

from dgl_assets.ranges import check_ranges

BOWL_HAT_RANGES: dict[str, tuple[float, float]] = {
    "head_girth": (0.38, 0.62),
    "head_ratio": (1.02, 1.28),
    "crown_height": (0.06, 0.15),
    "crown_exponent": (1.8, 6.0),
    "crown_taper": (-0.08, 0.32),
    "top_dent": (0.0, 0.025),
    "brim_width": (0.02, 0.10),
    "brim_slope": (-0.5, 1.2),
    "brim_curve": (-0.6, 0.6),
    "side_curl": (-0.02, 0.05),
    "wave_height": (0.0, 0.012),
    "wave_phase": (-3.15, 3.15),
    "wall_thickness": (0.0015, 0.005),
}
"""Smallest and largest accepted value of each measure, in its own unit."""


@dataclass(frozen=True, kw_only=True)
class BowlHatParameters:
    """Measures of a hat with a bowl-shaped crown and a brim all around.

    Lengths are in metres at about 85 % of life size, angles in radians. Ranges are in `BOWL_HAT_RANGES`.

    Attributes:
        head_girth: Around the opening [m], 0.38 to 0.62.
        head_ratio: Length over width of the opening, 1.02 to 1.28.
        crown_height: Opening to the top of the crown [m], 0.06 to 0.15.
        crown_exponent: Roundness of the crown, 1.8 (pointed dome) through 2 (ellipsoid) to 6 (flat top, sharp edge).
        crown_taper: Share by which the wall narrows towards the top, -0.08 (widening) to 0.32 (bucket).
        top_dent: Depth of a lengthwise dent in the top [m], 0 to 0.025.
        brim_width: Crown to the edge of the brim, along the brim [m], 0.02 to 0.10.
        brim_slope: Fall of the brim below horizontal where it leaves the crown [rad], -0.5 (turned up) to 1.2.
        brim_curve: How much more it falls at the edge [rad], -0.6 (edge turned up) to 0.6.
        side_curl: Rise of the brim's edge at both sides over that at front and back [m], -0.02 to 0.05.
        wave_height: Of three waves around the brim's edge [m], 0 to 0.012: no soft brim is even.
        wave_phase: Angle of the first wave [rad], -3.15 to 3.15.
        wall_thickness: Of the felt or cloth [m], 0.0015 to 0.005.

    Source:
        Girths are hat sizes, which are head girths in centimetres: 48 to 54 for children, 55 (S) to 64 (XXL) for adults
        (trade convention, from memory), times 0.85 as in the paper. Crowns and brims are from memory of hats for sale.
    """

    head_girth: float = 0.49
    head_ratio: float = 1.19
    crown_height: float = 0.092
    crown_exponent: float = 2.4
    crown_taper: float = 0.08
    top_dent: float = 0.0
    brim_width: float = 0.05
    brim_slope: float = 0.35
    brim_curve: float = 0.0
    side_curl: float = 0.0
    wave_height: float = 0.0
    wave_phase: float = 0.0
    wall_thickness: float = 0.0035

    def __post_init__(self) -> None:
        check_ranges(asdict(self), BOWL_HAT_RANGES)
        steepest = max(self.brim_slope, self.brim_slope + self.brim_curve)
        if steepest > 1.3:
            raise ValueError(
                f"brim_slope + brim_curve, the fall of the brim's edge, must be at most 1.3 rad; "
                f"got {steepest:.2f}"
            )
        flattest = min(self.brim_slope, self.brim_slope + self.brim_curve)
        if flattest < -0.7:
            raise ValueError(
                f"brim_slope + brim_curve, the fall of the brim's edge, must be at least -0.7 rad; "
                f"got {flattest:.2f}"
            )
        bend = max(abs(self.side_curl), 4 * self.wave_height)
        if bend > 0.7 * self.brim_width:
            raise ValueError(
                f"side_curl and 4 * wave_height must be at most 0.7 * brim_width "
                f"({0.7 * self.brim_width:.4f} m); got {self.side_curl} and {4 * self.wave_height}"
            )
        if self.top_dent > 0.25 * self.crown_height:
            raise ValueError(
                f"top_dent must be at most 0.25 * crown_height ({0.25 * self.crown_height:.4f} m); "
                f"got {self.top_dent}"
            )
