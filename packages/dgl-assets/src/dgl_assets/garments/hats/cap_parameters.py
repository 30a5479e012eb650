"""The measures of a baseball cap."""

from __future__ import annotations

from dataclasses import asdict, dataclass

from dgl_assets.ranges import check_ranges

CAP_RANGES: dict[str, tuple[float, float]] = {
    "head_girth": (0.38, 0.62),
    "head_ratio": (1.02, 1.28),
    "crown_height": (0.06, 0.15),
    "front_exponent": (1.9, 3.8),
    "back_exponent": (1.8, 3.4),
    "top_shift": (-0.012, 0.02),
    "gore_flatness": (0.0, 1.0),
    "front_rise": (0.0, 0.03),
    "visor_length": (0.035, 0.085),
    "visor_half_angle": (1.18, 1.42),
    "visor_splay": (0.35, 1.0),
    "visor_squareness": (1.8, 4.0),
    "visor_pitch": (-0.08, 0.25),
    "wall_thickness": (0.0015, 0.005),
}
"""Smallest and largest accepted value of each measure, in its own unit."""

PANEL_COUNTS = (5, 6)


@dataclass(frozen=True, kw_only=True)
class CapParameters:
    """Measures of a cap with a crown of panels and a visor.

    Lengths are in metres at about 85 % of life size, angles in radians. Ranges are in `CAP_RANGES`.

    Attributes:
        head_girth: Around the opening [m], 0.38 to 0.62.
        head_ratio: Length over width of the opening, 1.02 to 1.28.
        crown_height: Opening to the button on top [m], 0.06 (low) to 0.15 (high).
        front_exponent: Uprightness of the front, 1.9 (soft, rounded) to 3.8 (structured, upright).
        back_exponent: The same of sides and back, 1.8 to 3.4.
        top_shift: How far the button is in front of the middle [m], -0.012 to 0.02.
        gore_flatness: 0: the crown is round across; 1: panels are flat across near the top, as stiff ones are.
        panel_count: 6, or 5 with one wide panel in front (trucker).
        front_rise: Rise of the crown's edge at the front over the ends of the visor [m], 0 (flat visor) to 0.03: bending
            a visor bends the edge that it is sewn to.
        visor_length: Crown to the tip of the visor [m], 0.035 to 0.085.
        visor_half_angle: Middle to end of the visor around the crown [rad], 1.18 to 1.42.
        visor_splay: Direction of the visor at its ends, outward from straight ahead [rad], 0.35 to 1.
        visor_squareness: Outline of the visor, 1.8 (pointed) to 4 (square corners).
        visor_pitch: Fall of the visor towards its tip [rad], -0.08 to 0.25.
        wall_thickness: Of the cloth with its lining [m], 0.0015 to 0.005.

    Source:
        Girths are hat sizes, which are head girths in centimetres: 48 to 54 for children, 55 (S) to 64 (XXL) for adults
        (trade convention, from memory), times 0.85 as in the paper. The default fits the paper's demonstration cap,
        0.145 by 0.213 by 0.087 m.
    """

    head_girth: float = 0.48
    head_ratio: float = 1.17
    crown_height: float = 0.087
    front_exponent: float = 2.5
    back_exponent: float = 2.15
    top_shift: float = 0.004
    gore_flatness: float = 0.5
    panel_count: int = 6
    front_rise: float = 0.010
    visor_length: float = 0.055
    visor_half_angle: float = 1.32
    visor_splay: float = 0.55
    visor_squareness: float = 2.3
    visor_pitch: float = 0.10
    wall_thickness: float = 0.0028

    def __post_init__(self) -> None:
        check_ranges(asdict(self), CAP_RANGES)
        if self.panel_count not in PANEL_COUNTS:
            raise ValueError(f"panel_count must be one of {PANEL_COUNTS}; got {self.panel_count}")
        if self.front_rise > 0.28 * self.crown_height:
            raise ValueError(
                f"front_rise must be at most 0.28 * crown_height ({0.28 * self.crown_height:.4f} m); "
                f"got {self.front_rise}"
            )
        if self.visor_length > 0.16 * self.head_girth:
            raise ValueError(
                f"visor_length must be at most 0.16 * head_girth ({0.16 * self.head_girth:.4f} m); "
                f"got {self.visor_length}"
            )
