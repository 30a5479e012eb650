"""Random baseball caps, as a shop would mix them."""

from __future__ import annotations

import numpy as np

from dgl_assets.garments.drawing import Style, draw_ranges, draw_style
from dgl_assets.garments.hats.cap_parameters import CapParameters
from dgl_assets.garments.hats.oval import draw_head
from dgl_assets.garments.sizes import Sizes

# Shares of the crowns; life-size lengths [m].
_CROWNS: dict[str, tuple[float, Style]] = {
    "soft": (0.26, {
        "crown_height": (0.096, 0.112), "front_exponent": (1.95, 2.25),
        "back_exponent": (1.9, 2.2), "gore_flatness": (0.0, 0.35), "top_shift": (-0.004, 0.004),
    }),
    "structured": (0.32, {
        "crown_height": (0.108, 0.126), "front_exponent": (2.4, 2.9),
        "back_exponent": (2.05, 2.35), "gore_flatness": (0.35, 0.8), "top_shift": (0.0, 0.010),
    }),
    "high": (0.24, {
        "crown_height": (0.124, 0.150), "front_exponent": (2.7, 3.5), "back_exponent": (2.1, 2.5),
        "gore_flatness": (0.5, 1.0), "top_shift": (0.004, 0.016),
    }),
    "military": (0.18, {
        "crown_height": (0.080, 0.100), "front_exponent": (3.0, 3.8), "back_exponent": (2.7, 3.4),
        "gore_flatness": (0.0, 0.2), "top_shift": (0.0, 0.010),
    }),
}  # fmt: skip
# Shares of the visors; life-size lengths [m].
_VISORS: dict[str, tuple[float, Style]] = {
    "flat": (0.28, {
        "visor_length": (0.066, 0.078), "front_rise": (0.0, 0.003), "visor_pitch": (-0.04, 0.06),
        "visor_splay": (0.55, 0.85), "visor_squareness": (2.5, 3.6),
    }),
    "curved": (0.42, {
        "visor_length": (0.064, 0.080), "front_rise": (0.010, 0.019), "visor_pitch": (0.04, 0.17),
        "visor_splay": (0.45, 0.75), "visor_squareness": (2.1, 2.9),
    }),
    "strongly curved": (0.16, {
        "visor_length": (0.066, 0.084), "front_rise": (0.019, 0.030), "visor_pitch": (0.02, 0.12),
        "visor_splay": (0.40, 0.65), "visor_squareness": (2.1, 2.7),
    }),
    "short": (0.14, {
        "visor_length": (0.044, 0.058), "front_rise": (0.002, 0.012), "visor_pitch": (0.02, 0.22),
        "visor_splay": (0.40, 0.65), "visor_squareness": (1.9, 2.6),
    }),
}  # fmt: skip
_LENGTHS = ("crown_height", "top_shift", "visor_length", "front_rise")


def draw_cap(rng: np.random.Generator, _: Sizes) -> CapParameters:
    """Draw a cap, children's to XXL; the robots reach all sizes."""
    crown, shape = draw_style(rng, _CROWNS)
    _visor_name, visor = draw_style(rng, _VISORS)
    values = draw_ranges(rng, {**shape, **visor})
    girth, scale = draw_head(rng)
    for name in _LENGTHS:
        values[name] *= scale
    is_trucker = crown in ("structured", "high") and rng.uniform() < 0.4
    return CapParameters(
        head_girth=girth,
        head_ratio=float(rng.uniform(1.10, 1.25)),
        panel_count=5 if is_trucker else 6,
        visor_half_angle=float(rng.uniform(1.23, 1.38)),
        wall_thickness=float(rng.uniform(0.002, 0.0038)),
        **values,
    )
