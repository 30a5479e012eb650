"""The measures of a bowl hat."""

from __future__ import annotations

from dataclasses import dataclass

from dgl_assets.ranges import Measures, check_limit, measure


@dataclass(frozen=True, kw_only=True)
class BowlHatParameters(Measures):
    """Measures of a hat with a brim all around, at about 85 % of life size.

    Source:
        Girths as of `CapParameters`; crowns and brims are from memory of hats for sale.
    """

    head_girth: float = measure(0.38, 0.62, 0.49)
    """Around the opening [m]."""
    head_ratio: float = measure(1.02, 1.28, 1.19)
    """Length over width of the opening."""
    crown_height: float = measure(0.06, 0.15, 0.092)
    """Opening to the top of the crown [m]."""
    crown_exponent: float = measure(1.8, 6.0, 2.4)
    """Shape of the crown: 1.8 is a pointed dome, 2 an ellipsoid, 6 a flat top with a sharp edge."""
    crown_taper: float = measure(-0.08, 0.32, 0.08)
    """Share by which the wall narrows towards the top, as of a bucket; negative if it widens."""
    top_dent: float = measure(0.0, 0.025, 0.0)
    """Depth of a lengthwise dent in the top [m]."""
    brim_width: float = measure(0.02, 0.10, 0.05)
    """Crown to the edge of the brim, along the brim [m]."""
    brim_slope: float = measure(-0.5, 1.2, 0.35)
    """Fall of the brim below horizontal at the crown [rad]; negative if it is turned up."""
    brim_curve: float = measure(-0.6, 0.6, 0.0)
    """Further fall of the brim from the crown to its edge [rad]."""
    side_curl: float = measure(-0.02, 0.05, 0.0)
    """Rise of the brim's edge at both sides over that at front and back [m]."""
    wave_height: float = measure(0.0, 0.012, 0.0)
    """Height of three waves around the brim's edge [m]: no soft brim is even."""
    wave_phase: float = measure(-3.15, 3.15, 0.0)
    """Angle of the first wave [rad]."""
    wall_thickness: float = measure(0.0015, 0.005, 0.0035)
    """Thickness of the felt or cloth [m]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        for slope in (self.brim_slope, self.brim_slope + self.brim_curve):
            name = "brim_slope + brim_curve, the fall of the brim's edge,"
            check_limit(name, slope, "the limit [rad]", least=-0.7, most=1.3)
        most = 0.7 * self.brim_width
        for name, bend in (
            ("side_curl", self.side_curl),
            ("4 * wave_height", 4 * self.wave_height),
        ):
            check_limit(f"size of {name}", abs(bend), "0.7 * brim_width", most=most)
        most = 0.25 * self.crown_height
        check_limit("top_dent", self.top_dent, "0.25 * crown_height", most=most)
