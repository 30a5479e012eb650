"""The measures of the parts of a garment for the upper body, at about 85 % of life size.

The highest point of the shoulder is the end of the shoulder seam at the neckline.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Literal

from dgl_assets.ranges import Measures, check_choice, check_limit, measure

NeckFinish = Literal["plain", "stand", "fold", "hood", "lapel"]
SleeveSeam = Literal["set_in", "raglan"]


@dataclass(frozen=True, kw_only=True)
class Body(Measures):
    """Front and back of the body, without neckline."""

    chest_half_width: float = measure(0.11, 0.36, 0.228)
    """Centre to armpit [m]: a quarter of the girth of the garment."""
    length: float = measure(0.28, 1.26, 0.56)
    """Highest point of the shoulder to the hem at the centre [m]."""
    shoulder_half_width: float = measure(0.06, 0.34, 0.188)
    """Centre to the end of the shoulder [m]; near `chest_half_width` if it is dropped."""
    shoulder_slope: float = measure(0.02, 0.55, 0.32)
    """Fall of the shoulder line below horizontal [rad]."""
    armhole_depth: float = measure(0.1, 0.36, 0.215)
    """Highest point of the shoulder down to the armpit [m]."""
    waist_depth: float = measure(0.16, 0.6, 0.36)
    """Highest point of the shoulder down to the waist [m]; ignored where the hem is higher."""
    waist_half_width: float = measure(0.1, 0.4, 0.222)
    """Centre to the side seam at the waist [m]."""
    hip_half_width: float = measure(0.0, 0.42, 0.0)
    """Centre to the side seam 0.17 m below the waist [m]; 0 leaves the side free there."""
    hem_half_width: float = measure(0.11, 0.62, 0.228)
    """Centre to the side seam at the hem [m]."""
    hem_curve: float = measure(-0.06, 0.1, 0.0)
    """Rise of the hem from the centre to the side seams [m]."""
    hem_tilt: float = measure(-0.04, 0.04, 0.0)
    """Rise of the hem from the centre to the right side, and fall to the left side [m]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        most = self.chest_half_width + 0.012
        formula = "chest_half_width + 0.012 m"
        check_limit("shoulder_half_width", self.shoulder_half_width, formula, most=most)
        for name, room in (("waist_depth", 0.02), ("length", 0.08)):
            least = self.armhole_depth + room
            check_limit(name, getattr(self, name), f"armhole_depth + {room} m", least=least)
        if 0 < self.hip_half_width < 0.8 * self.waist_half_width:
            raise ValueError(
                f"hip_half_width must be 0 or at least 0.8 of waist_half_width "
                f"({self.waist_half_width}); got {self.hip_half_width}"
            )


@dataclass(frozen=True, kw_only=True)
class Neck(Measures):
    """Neckline, collar and hood."""

    half_width: float = measure(0.045, 0.17, 0.082)
    """Centre to the highest point of the shoulder [m]."""
    front_depth: float = measure(0.02, 0.52, 0.085)
    """Fall of the front neckline at the centre, or at the opening [m]."""
    back_depth: float = measure(0.004, 0.2, 0.018)
    """Fall of the back neckline at the centre [m]."""
    roundness: float = measure(0.9, 5.0, 2.2)
    """Exponent of the front neckline, 1 (V) through 2 (round) to 5 (square)."""
    finish: NeckFinish = "plain"
    """Collar: none, "stand" (mock and turtlenecks), "fold" (shirts and polos: a leaf folded onto
    the front, its back standing), "hood" (spread above the neck), or "lapel" (a leaf along the
    whole roll line, open fronts only)."""
    height: float = measure(0.0, 0.34, 0.0)
    """Height of a standing collar, of the back of a folded one, or of a hood [m]; 0 if plain."""
    spread: float = measure(-0.01, 0.07, 0.0)
    """Outward lean of a collar's side at its top, or bulge of a hood beyond the neck [m]."""
    leaf_width: float = measure(0.0, 0.12, 0.0)
    """Width of a folded leaf [m]; 0 without one."""
    leaf_angle: float = measure(0.3, 1.6, 1.0)
    """Direction of the tip of a leaf below horizontal, 1.57 straight down [rad]."""

    def __post_init__(self) -> None:
        super().__post_init__()
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
                "leaf_width must be at least 0.025 m for finishes 'fold' and 'lapel' and 0 for "
                f"others; got {self.leaf_width} for {self.finish!r}"
            )
        if has_leaf:
            formula = "1.2 times its height, or its corner is too sharp,"
            most = 1.2 * self.height
            check_limit("spread of a folded collar", self.spread, formula, most=most)
        most = self.front_depth + 0.02
        check_limit("back_depth", self.back_depth, "front_depth + 0.02 m", most=most)


@dataclass(frozen=True, kw_only=True)
class Sleeve(Measures):
    """A pair of sleeves."""

    length: float = measure(0.07, 0.62, 0.50)
    """Shoulder to cuff along the upper edge [m]."""
    angle: float = measure(0.2, 1.15, 0.76)
    """Fall of the sleeves below horizontal [rad]."""
    angle_difference: float = measure(-0.08, 0.08, 0.0)
    """Left angle minus right angle [rad]: no garment lies perfectly."""
    bend: float = measure(-0.02, 0.03, 0.0)
    """Sideways bow of the sleeve at its middle [m], positive upward."""
    upper_width: float = measure(0.045, 0.3, 0.122)
    """Width at a quarter of the underarm seam [m]."""
    lower_width: float = measure(0.04, 0.3, 0.088)
    """Width at four fifths of the underarm seam [m]."""
    cuff_width: float = measure(0.04, 0.32, 0.078)
    """Width at the cuff [m]."""
    seam: SleeveSeam = "set_in"
    """Seam to the body: "set_in" is sewn around the armhole, "raglan" up to the neck."""

    def __post_init__(self) -> None:
        super().__post_init__()
        check_choice("seam", self.seam, ("set_in", "raglan"))


@dataclass(frozen=True, kw_only=True)
class Armhole(Measures):
    """The edge of an armhole without sleeve."""

    front_scoop: float = measure(-0.02, 0.06, 0.0)
    """Depth of the front edge towards the neck beyond a quarter of an ellipse [m]."""
    back_scoop: float = measure(-0.02, 0.08, 0.0)
    """Depth of the back edge [m]; large for racerbacks."""
    squareness: float = measure(0.6, 1.6, 1.0)
    """Below 1 the edge falls straight from the shoulder and turns late; above 1 it slants."""


@dataclass(frozen=True, kw_only=True)
class Opening(Measures):
    """An open front."""

    top_gap: float = measure(-0.06, 0.1, 0.008)
    """Half of the gap between the fronts at the neck [m]; negative if right overlaps left."""
    hem_gap: float = measure(-0.06, 0.16, 0.012)
    """Half of the gap at the hem [m]."""
    corner_radius: float = measure(0.0, 0.12, 0.0)
    """Radius of rounded corners at the hem [m]."""

    @property
    def overlap(self) -> float:
        """Largest half overlap of the fronts [m], 0 if they do not overlap."""
        return max(0.0, -self.top_gap, -self.hem_gap)


@dataclass(frozen=True, kw_only=True)
class Cuts:
    """Parts of an upper garment."""

    body: Body
    neck: Neck
    sleeve: Sleeve | None = None
    armhole: Armhole | None = None
    """Edge of the armholes, if there are no sleeves."""
    opening: Opening | None = None
    """Open front."""
    neck_dip: tuple[float, float] = (0.18, 0.035)
    """Fall of the neckline at the centre in v: front, back."""
    has_waist: bool = False
    """Fix v at the waist."""


@dataclass(frozen=True, kw_only=True)
class SleevedParameters:
    """Measures of a garment with sleeves that lies flat, arms down and out."""

    body: Body = field(default_factory=Body)
    neck: Neck = field(default_factory=Neck)
    sleeve: Sleeve = field(default_factory=Sleeve)

    @property
    def span(self) -> float:
        """Upper corner of one cuff to that of the other, sleeves at the mean angle [m]."""
        reach = self.sleeve.length * math.cos(self.sleeve.angle)
        return 2 * (self.body.shoulder_half_width + reach)

    @property
    def cuts(self) -> Cuts:
        """Parts that it is composed of."""
        return Cuts(body=self.body, neck=self.neck, sleeve=self.sleeve)
