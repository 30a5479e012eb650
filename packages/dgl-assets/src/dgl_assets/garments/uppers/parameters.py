"""The measures of the parts of a garment for the upper body.

Lengths are in metres at about 85 % of life size, angles in radians. "Highest point of the shoulder" is where the shoulder
seam meets the neckline.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from dgl_assets.garments.measures import check_choice, check_ranges

NeckFinish = Literal["plain", "stand", "fold", "hood", "lapel"]
SleeveSeam = Literal["set_in", "raglan"]

BODY_RANGES: dict[str, tuple[float, float]] = {
    "chest_half_width": (0.11, 0.36),
    "length": (0.28, 1.26),
    "shoulder_half_width": (0.06, 0.34),
    "shoulder_slope": (0.02, 0.55),
    "armhole_depth": (0.10, 0.36),
    "waist_depth": (0.16, 0.60),
    "waist_half_width": (0.10, 0.40),
    "hip_half_width": (0.0, 0.42),
    "hem_half_width": (0.11, 0.62),
    "hem_curve": (-0.06, 0.10),
    "hem_tilt": (-0.04, 0.04),
}
NECK_RANGES: dict[str, tuple[float, float]] = {
    "half_width": (0.045, 0.17),
    "front_depth": (0.02, 0.52),
    "back_depth": (0.004, 0.20),
    "roundness": (0.9, 5.0),
    "height": (0.0, 0.34),
    "spread": (-0.01, 0.07),
    "leaf_width": (0.0, 0.12),
    "leaf_angle": (0.3, 1.6),
}
SLEEVE_RANGES: dict[str, tuple[float, float]] = {
    "length": (0.07, 0.62),
    "angle": (0.20, 1.15),
    "angle_difference": (-0.08, 0.08),
    "bend": (-0.02, 0.03),
    "upper_width": (0.045, 0.30),
    "lower_width": (0.04, 0.30),
    "cuff_width": (0.04, 0.32),
}
ARMHOLE_RANGES: dict[str, tuple[float, float]] = {
    "front_scoop": (-0.02, 0.06),
    "back_scoop": (-0.02, 0.08),
    "squareness": (0.6, 1.6),
}
OPENING_RANGES: dict[str, tuple[float, float]] = {
    "top_gap": (-0.06, 0.10),
    "hem_gap": (-0.06, 0.16),
    "corner_radius": (0.0, 0.12),
}


@dataclass(frozen=True, kw_only=True)
class Body:
    """Front and back of the body, without neckline.

    Attributes:
        chest_half_width: Centre to armpit [m]. A quarter of the girth of the garment.
        length: Highest point of the shoulder to the hem at the centre [m].
        shoulder_half_width: Centre to the end of the shoulder line [m]. Near `chest_half_width` the shoulder is dropped.
        shoulder_slope: Fall of the shoulder line below horizontal [rad].
        armhole_depth: Highest point of the shoulder down to the armpit [m].
        waist_depth: Highest point of the shoulder down to the waist [m]. Without effect where the hem is higher.
        waist_half_width: Centre to the side seam at the waist [m].
        hip_half_width: Centre to the side seam 0.17 m below the waist [m]; 0 leaves the side free there.
        hem_half_width: Centre to the side seam at the hem [m].
        hem_curve: Rise of the hem from the centre to the side seams [m].
        hem_tilt: How much higher the hem is at the right side than at the centre, and lower at the left [m].
    """

    chest_half_width: float = 0.228
    length: float = 0.56
    shoulder_half_width: float = 0.188
    shoulder_slope: float = 0.32
    armhole_depth: float = 0.215
    waist_depth: float = 0.36
    waist_half_width: float = 0.222
    hip_half_width: float = 0.0
    hem_half_width: float = 0.228
    hem_curve: float = 0.0
    hem_tilt: float = 0.0

    def __post_init__(self) -> None:
        check_ranges(self, BODY_RANGES)
        if self.shoulder_half_width > self.chest_half_width + 0.012:
            raise ValueError(
                f"shoulder_half_width must be at most chest_half_width + 0.012 m "
                f"({self.chest_half_width + 0.012:.3f}); got {self.shoulder_half_width}"
            )
        if self.waist_depth < self.armhole_depth + 0.02:
            raise ValueError(
                f"waist_depth must be at least 0.02 m more than armhole_depth ({self.armhole_depth}); "
                f"got {self.waist_depth}"
            )
        if self.length < self.armhole_depth + 0.08:
            raise ValueError(
                f"length must be at least 0.08 m more than armhole_depth ({self.armhole_depth}); got "
                f"{self.length}"
            )
        if 0 < self.hip_half_width < 0.8 * self.waist_half_width:
            raise ValueError(
                f"hip_half_width must be 0 or at least 0.8 of waist_half_width "
                f"({self.waist_half_width}); got {self.hip_half_width}"
            )


@dataclass(frozen=True, kw_only=True)
class Neck:
    """Neckline and what is sewn to it.

    Attributes:
        half_width: Centre to the highest point of the shoulder [m].
        front_depth: Fall of the front neckline at the centre, or at the opening [m].
        back_depth: Fall of the back neckline at the centre [m].
        roundness: Exponent of the front neckline, 1 (V) through 2 (round) to 5 (square).
        finish: "plain", "stand" (mock and turtlenecks), "fold" (shirt and polo collars: a leaf folded over onto the front,
            its back standing), "hood" (spread above the neck), or "lapel" (a leaf along the whole roll line, open fronts
            only).
        height: Height of a standing collar or of the back of a folded one, or of a hood [m]; 0 if plain.
        spread: How far the side of a collar leans outward at its top, or a hood bulges beyond the neck [m].
        leaf_width: Width of a folded leaf [m]; 0 without one.
        leaf_angle: Direction of the tip of a leaf below horizontal, 1.57 straight down [rad].
    """

    half_width: float = 0.082
    front_depth: float = 0.085
    back_depth: float = 0.018
    roundness: float = 2.2
    finish: NeckFinish = "plain"
    height: float = 0.0
    spread: float = 0.0
    leaf_width: float = 0.0
    leaf_angle: float = 1.0

    def __post_init__(self) -> None:
        check_ranges(self, NECK_RANGES)
        check_choice("finish", self.finish, ("plain", "stand", "fold", "hood", "lapel"))
        low, high = {
            "plain": (0.0, 0.0),
            "stand": (0.015, 0.09),
            "fold": (0.015, 0.06),
            "lapel": (0.015, 0.06),
            "hood": (0.18, 0.34),
        }[self.finish]
        if not low <= self.height <= high:
            raise ValueError(
                f"height must be in [{low}, {high}] for finish {self.finish!r}; got {self.height}"
            )
        has_leaf = self.finish in ("fold", "lapel")
        if has_leaf != (self.leaf_width > 0) or 0 < self.leaf_width < 0.025:
            raise ValueError(
                "leaf_width must be at least 0.025 m for finishes 'fold' and 'lapel' and 0 for others; "
                f"got {self.leaf_width} for {self.finish!r}"
            )
        if has_leaf and self.spread > 1.2 * self.height:
            raise ValueError(
                f"spread of a folded collar must be at most 1.2 times its height ({self.height}), or its "
                f"corner is too sharp; got {self.spread}"
            )
        if self.back_depth > self.front_depth + 0.02:
            raise ValueError(
                f"back_depth must be at most 0.02 m more than front_depth ({self.front_depth}); got "
                f"{self.back_depth}"
            )


@dataclass(frozen=True, kw_only=True)
class Sleeve:
    """A pair of sleeves.

    Attributes:
        length: Shoulder to cuff along the upper edge [m].
        angle: Fall of the sleeves below horizontal [rad].
        angle_difference: Left angle minus right angle [rad]: no garment lies perfectly.
        bend: Sideways bow of the sleeve at its middle [m], positive upward.
        upper_width: Width at a quarter of the underarm seam [m].
        lower_width: Width at four fifths of the underarm seam [m].
        cuff_width: Width at the cuff [m].
        seam: "set_in" is sewn around the armhole, "raglan" up to the neck.
    """

    length: float = 0.50
    angle: float = 0.76
    angle_difference: float = 0.0
    bend: float = 0.0
    upper_width: float = 0.122
    lower_width: float = 0.088
    cuff_width: float = 0.078
    seam: SleeveSeam = "set_in"

    def __post_init__(self) -> None:
        check_ranges(self, SLEEVE_RANGES)
        check_choice("seam", self.seam, ("set_in", "raglan"))


@dataclass(frozen=True, kw_only=True)
class Armhole:
    """The edge of an armhole without sleeve.

    Attributes:
        front_scoop: How far the front edge is cut towards the neck beyond a quarter of an ellipse [m].
        back_scoop: The same at the back [m]; large for racerbacks.
        squareness: Below 1 the edge leaves the shoulder straight down and turns late, above 1 it runs slantwise.
    """

    front_scoop: float = 0.0
    back_scoop: float = 0.0
    squareness: float = 1.0

    def __post_init__(self) -> None:
        check_ranges(self, ARMHOLE_RANGES)


@dataclass(frozen=True, kw_only=True)
class Opening:
    """An open front.

    Attributes:
        top_gap: Half of the gap between the fronts at the neck [m]; negative where they overlap, right over left.
        hem_gap: The same at the hem [m].
        corner_radius: Radius of rounded corners at the hem [m].
    """

    top_gap: float = 0.008
    hem_gap: float = 0.012
    corner_radius: float = 0.0

    def __post_init__(self) -> None:
        check_ranges(self, OPENING_RANGES)

    @property
    def overlap(self) -> float:
        """Largest half overlap of the fronts [m], 0 if they do not overlap."""
        return max(0.0, -self.top_gap, -self.hem_gap)
