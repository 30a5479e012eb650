"""The measures of a baseball cap."""

from __future__ import annotations

from dataclasses import dataclass

from dgl_assets.ranges import Measures, check_limit, measure

PANEL_COUNTS = (5, 6)


@dataclass(frozen=True, kw_only=True)
class CapParameters(Measures):
    """Measures of a cap with a crown of panels and a visor, at about 85 % of life size.

    Source:
        Girths are hat sizes in centimetres, 48 to 54 for children, 55 (S) to 64 (XXL) for adults
        (trade convention, from memory), times 0.85 as in the paper. The default fits the paper's
        demonstration cap, 0.145 by 0.213 by 0.087 m.
    """

    head_girth: float = measure(0.38, 0.62, 0.48)
    """Around the opening [m]."""
    head_ratio: float = measure(1.02, 1.28, 1.17)
    """Length over width of the opening."""
    crown_height: float = measure(0.06, 0.15, 0.087)
    """Opening to the button on top [m]."""
    front_exponent: float = measure(1.9, 3.8, 2.5)
    """Uprightness of the front, from soft and rounded to structured and upright."""
    back_exponent: float = measure(1.8, 3.4, 2.15)
    """Uprightness of sides and back."""
    top_shift: float = measure(-0.012, 0.02, 0.004)
    """Distance of the button in front of the middle [m]."""
    gore_flatness: float = measure(0.0, 1.0, 0.5)
    """0: the crown is round across; 1: stiff panels are flat across near the top."""
    panel_count: int = 6
    """6, or 5 with one wide panel in front (trucker)."""
    front_rise: float = measure(0.0, 0.03, 0.010)
    """Rise of the crown's edge at the front over the ends of the visor [m]; 0 is a flat visor."""
    visor_length: float = measure(0.035, 0.085, 0.055)
    """Crown to the tip of the visor [m]."""
    visor_half_angle: float = measure(1.18, 1.42, 1.32)
    """Middle to end of the visor around the crown [rad]."""
    visor_splay: float = measure(0.35, 1.0, 0.55)
    """Direction of the visor at its ends, outward from straight ahead [rad]."""
    visor_squareness: float = measure(1.8, 4.0, 2.3)
    """Outline of the visor, from pointed to square corners."""
    visor_pitch: float = measure(-0.08, 0.25, 0.10)
    """Fall of the visor towards its tip [rad]."""
    wall_thickness: float = measure(0.0015, 0.005, 0.0028)
    """Thickness of the cloth with its lining [m]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.panel_count not in PANEL_COUNTS:
            raise ValueError(f"panel_count must be one of {PANEL_COUNTS}; got {self.panel_count}")
        most = 0.28 * self.crown_height
        check_limit("front_rise", self.front_rise, "0.28 * crown_height", most=most)
        most = 0.16 * self.head_girth
        check_limit("visor_length", self.visor_length, "0.16 * head_girth", most=most)
