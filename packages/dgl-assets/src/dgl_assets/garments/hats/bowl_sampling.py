"""Random bowl hats, as a shop would mix them."""

from __future__ import annotations

import numpy as np

from dgl_assets.garments.drawing import Style, draw_ranges, draw_style
from dgl_assets.garments.hats.bowl_parameters import BowlHatParameters
from dgl_assets.garments.hats.oval import draw_head
from dgl_assets.garments.sizes import Sizes

# Shares; life-size lengths [m].
_STYLES: dict[str, tuple[float, Style]] = {
    "bucket": (0.26, {
        "crown_height": (0.088, 0.115), "crown_exponent": (3.2, 5.0), "crown_taper": (0.10, 0.26),
        "brim_width": (0.045, 0.075), "brim_slope": (0.45, 0.95), "brim_curve": (-0.15, 0.15),
        "wave_height": (0.0, 0.005),
    }),
    "bowler": (0.18, {
        "crown_height": (0.105, 0.135), "crown_exponent": (2.2, 2.9), "crown_taper": (0.0, 0.06),
        "brim_width": (0.036, 0.056), "brim_slope": (-0.05, 0.15), "brim_curve": (-0.5, -0.1),
        "side_curl": (0.008, 0.026),
    }),
    "cloche": (0.17, {
        "crown_height": (0.115, 0.150), "crown_exponent": (2.15, 2.8),
        "crown_taper": (0.02, 0.12), "brim_width": (0.028, 0.055), "brim_slope": (0.7, 1.1),
        "brim_curve": (-0.6, 0.1),
    }),
    "boater": (0.12, {
        "crown_height": (0.085, 0.105), "crown_exponent": (4.5, 6.0),
        "crown_taper": (-0.02, 0.04), "brim_width": (0.050, 0.072), "brim_slope": (-0.02, 0.06),
        "brim_curve": (-0.03, 0.03),
    }),
    "sun": (0.15, {
        "crown_height": (0.095, 0.12), "crown_exponent": (2.3, 3.4), "crown_taper": (0.04, 0.16),
        "brim_width": (0.080, 0.115), "brim_slope": (0.05, 0.4), "brim_curve": (-0.1, 0.35),
        "wave_height": (0.003, 0.012), "side_curl": (-0.008, 0.008),
    }),
    "fedora": (0.12, {
        "crown_height": (0.112, 0.135), "crown_exponent": (2.8, 3.8), "crown_taper": (0.08, 0.20),
        "top_dent": (0.010, 0.022), "brim_width": (0.050, 0.075), "brim_slope": (0.0, 0.2),
        "brim_curve": (-0.25, 0.1), "side_curl": (0.006, 0.024),
    }),
}  # fmt: skip
_LENGTHS = ("crown_height", "top_dent", "brim_width", "side_curl", "wave_height")


def draw_bowl_hat(rng: np.random.Generator, _: Sizes) -> BowlHatParameters:
    """Draw a bowl hat, S to XXL; the robots reach all sizes."""
    _style_name, style = draw_style(rng, _STYLES)
    values = draw_ranges(rng, style)
    girth, scale = draw_head(rng)
    for name in _LENGTHS:
        if name in values:
            values[name] *= scale
    return BowlHatParameters(
        head_girth=girth,
        head_ratio=float(rng.uniform(1.10, 1.26)),
        wave_phase=float(rng.uniform(-np.pi, np.pi)),
        wall_thickness=float(rng.uniform(0.002, 0.0045)),
        **values,
    )
