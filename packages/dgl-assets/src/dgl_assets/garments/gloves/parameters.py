"""The measures of a glove."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from dgl_assets.ranges import Measures, check_limit, measure


@dataclass(frozen=True, kw_only=True)
class GloveParameters(Measures):
    """Measures of a five-fingered glove, back and palm sewn together, at about 85 % of life size.

    Widths are those of the flat pattern, half of the girth.

    Source:
        Proportions of the default are from memory of ANSUR II (NATICK/TR-15/007; hand breadth 0.088
        m and length 0.193 m of men, 0.079 m and 0.181 m of women) plus usual ease, times 0.85.
    """

    hand: Literal["left", "right"] = "right"
    """Hand that it fits."""
    hand_width: float = measure(0.10, 0.165, 0.124)
    """Across the knuckles [m], shared by four fingers and three webs."""
    palm_length: float = measure(0.065, 0.115, 0.086)
    """Knuckles to wrist at the middle finger [m]."""
    middle_length: float = measure(0.05, 0.105, 0.08)
    """Knuckles to the tip of the middle finger [m]."""
    index_ratio: float = measure(0.82, 1.0, 0.91)
    """Length of the index finger over that of the middle finger."""
    ring_ratio: float = measure(0.84, 1.02, 0.94)
    """Length of the ring finger over that of the middle finger."""
    little_ratio: float = measure(0.62, 0.88, 0.76)
    """Length of the little finger over that of the middle finger."""
    little_width_ratio: float = measure(0.80, 1.0, 0.90)
    """Width of the little finger over that of the others."""
    finger_taper: float = measure(0.72, 0.95, 0.90)
    """Width of a finger over that of its base at the hand."""
    finger_spread: float = measure(0.04, 0.20, 0.10)
    """Angle between neighbouring fingers [rad]."""
    web_width: float = measure(0.003, 0.009, 0.005)
    """Between the bases of neighbouring fingers [m]."""
    knuckle_slant: float = measure(0.0, 0.25, 0.10)
    """Angle by which the knuckles recede towards the little finger [rad]."""
    thumb_length: float = measure(0.045, 0.10, 0.074)
    """Palm to the tip of the thumb [m]."""
    thumb_width: float = measure(0.024, 0.042, 0.030)
    """[m]."""
    thumb_angle: float = measure(0.45, 1.15, 0.75)
    """Between thumb and fingers [rad]."""
    wrist_ratio: float = measure(0.58, 1.0, 0.74)
    """Width at the wrist over `hand_width`."""
    cuff_length: float = measure(0.018, 0.16, 0.045)
    """Wrist to the opening [m]; long for a gauntlet."""
    cuff_ratio: float = measure(0.72, 1.35, 1.05)
    """Width at the opening over that at the wrist."""
    finger_puff: float = measure(0.45, 1.0, 0.7)
    """Thickness of a finger over its width; 1 is round."""
    palm_puff: float = measure(0.0, 0.012, 0.004)
    """Rise of the middle of hand and cuff above the fingers, on either side [m]."""
    wall_thickness: float = measure(0.0012, 0.003, 0.0018)
    """Thickness of the material [m]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.hand not in ("left", "right"):
            raise ValueError(f"hand must be 'left' or 'right'; got {self.hand!r}")
        finger = (self.hand_width - 3 * self.web_width) / (3 + self.little_width_ratio)
        check_limit(
            "middle_length * little_ratio, the little finger,",
            self.middle_length * self.little_ratio,
            "1.5 times the width of a finger",
            least=1.5 * finger,
        )
        least = 1.2 * self.thumb_width
        check_limit("thumb_length", self.thumb_length, "1.2 * thumb_width", least=least)
        most = 0.44 * self.palm_length
        check_limit("thumb_width", self.thumb_width, "0.44 * palm_length", most=most)
        least = 1.5 * self.finger_spread + 0.25
        formula = "1.5 * finger_spread + 0.25, clear of the index finger"
        check_limit("thumb_angle", self.thumb_angle, formula, least=least)
