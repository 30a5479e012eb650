"""The measures of a glove."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Literal

from dgl_assets.ranges import check_ranges

GLOVE_RANGES: dict[str, tuple[float, float]] = {
    "hand_width": (0.10, 0.165),
    "palm_length": (0.065, 0.115),
    "middle_length": (0.05, 0.105),
    "index_ratio": (0.82, 1.0),
    "ring_ratio": (0.84, 1.02),
    "little_ratio": (0.62, 0.88),
    "little_width_ratio": (0.80, 1.0),
    "finger_taper": (0.72, 0.95),
    "finger_spread": (0.04, 0.20),
    "web_width": (0.003, 0.009),
    "knuckle_slant": (0.0, 0.25),
    "thumb_length": (0.045, 0.10),
    "thumb_width": (0.024, 0.042),
    "thumb_angle": (0.45, 1.15),
    "wrist_ratio": (0.58, 1.0),
    "cuff_length": (0.018, 0.16),
    "cuff_ratio": (0.72, 1.35),
    "finger_puff": (0.45, 1.0),
    "palm_puff": (0.0, 0.012),
    "wall_thickness": (0.0012, 0.003),
}
"""Smallest and largest accepted value of each measure, in its own unit."""


@dataclass(frozen=True, kw_only=True)
class GloveParameters:
    """Measures of a five-fingered glove whose back and palm are sewn together along the outline.

    Widths are those of the flat pattern, half of the girth. Lengths are in metres at about 85 % of life size, angles in
    radians. Ranges are in `GLOVE_RANGES`.

    Attributes:
        hand: Hand that it fits, "left" or "right".
        hand_width: Across the knuckles [m], 0.10 to 0.165; the four fingers and three webs share it.
        palm_length: Knuckles to wrist at the middle finger [m], 0.065 to 0.115.
        middle_length: Knuckles to the tip of the middle finger [m], 0.05 to 0.105.
        index_ratio: Length of the index over that of the middle finger, 0.82 to 1.
        ring_ratio: The same of the ring finger, 0.84 to 1.02.
        little_ratio: The same of the little finger, 0.62 to 0.88.
        little_width_ratio: Width of the little finger over that of the others, 0.80 to 1.
        finger_taper: Width of fingers over that of their base, with which they leave the hand, 0.72 to 0.95.
        finger_spread: Angle between neighbouring fingers [rad], 0.04 to 0.20.
        web_width: Between the bases of neighbouring fingers [m], 0.003 to 0.009.
        knuckle_slant: Angle by which the knuckles recede towards the little finger [rad], 0 to 0.25.
        thumb_length: Palm to the tip of the thumb [m], 0.045 to 0.10.
        thumb_width: Of the thumb [m], 0.024 to 0.042.
        thumb_angle: Between thumb and fingers [rad], 0.45 to 1.15.
        wrist_ratio: Width at the wrist over `hand_width`, 0.58 to 1.
        cuff_length: Wrist to the opening [m], 0.018 to 0.16 (gauntlet).
        cuff_ratio: Width at the opening over that at the wrist, 0.72 to 1.35.
        finger_puff: Thickness of a finger over its width, 0.45 (flat) to 1 (round).
        palm_puff: How much higher the middle of hand and cuff rise than the fingers, on either side [m], 0 to 0.012.
        wall_thickness: Of the material [m], 0.0012 to 0.003.

    Source:
        Proportions of the default are from memory of ANSUR II (NATICK/TR-15/007; hand breadth 0.088 m and length 0.193 m
        of men, 0.079 m and 0.181 m of women) plus usual ease, times 0.85 as in the paper.
    """

    hand: Literal["left", "right"] = "right"
    hand_width: float = 0.124
    palm_length: float = 0.086
    middle_length: float = 0.08
    index_ratio: float = 0.91
    ring_ratio: float = 0.94
    little_ratio: float = 0.76
    little_width_ratio: float = 0.90
    finger_taper: float = 0.90
    finger_spread: float = 0.10
    web_width: float = 0.005
    knuckle_slant: float = 0.10
    thumb_length: float = 0.074
    thumb_width: float = 0.030
    thumb_angle: float = 0.75
    wrist_ratio: float = 0.74
    cuff_length: float = 0.045
    cuff_ratio: float = 1.05
    finger_puff: float = 0.7
    palm_puff: float = 0.004
    wall_thickness: float = 0.0018

    def __post_init__(self) -> None:
        check_ranges(asdict(self), GLOVE_RANGES)
        if self.hand not in ("left", "right"):
            raise ValueError(f"hand must be 'left' or 'right'; got {self.hand!r}")
        finger = (self.hand_width - 3 * self.web_width) / (3 + self.little_width_ratio)
        if self.middle_length * self.little_ratio < 1.5 * finger:
            raise ValueError(
                f"middle_length * little_ratio, the little finger, must be at least 1.5 times as long "
                f"as a finger is wide ({1.5 * finger:.4f} m); got "
                f"{self.middle_length * self.little_ratio:.4f}"
            )
        if self.thumb_length < 1.2 * self.thumb_width:
            raise ValueError(
                f"thumb_length must be at least 1.2 * thumb_width ({1.2 * self.thumb_width:.4f} m); "
                f"got {self.thumb_length}"
            )
        if self.thumb_width > 0.44 * self.palm_length:
            raise ValueError(
                f"thumb_width must be at most 0.44 * palm_length ({0.44 * self.palm_length:.4f} m); "
                f"got {self.thumb_width}"
            )
        if self.thumb_angle < 1.5 * self.finger_spread + 0.25:
            raise ValueError(
                f"thumb_angle must be at least 1.5 * finger_spread + 0.25 "
                f"({1.5 * self.finger_spread + 0.25:.3f} rad), clear of the index finger; got "
                f"{self.thumb_angle}"
            )
