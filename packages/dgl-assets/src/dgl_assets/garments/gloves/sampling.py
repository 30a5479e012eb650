"""Random gloves, as a shop would mix them."""

from __future__ import annotations

import numpy as np

from dgl_assets.garments.drawing import Style, draw_ranges, draw_style
from dgl_assets.garments.gloves.parameters import GloveParameters
from dgl_assets.garments.sizes import SCALE, Sizes

_SIZES = (0.93, 0.97, 1.0, 1.05, 1.10)  # S to XXL, relative to M
_SIZE_SHARES = (0.17, 0.26, 0.28, 0.19, 0.10)

# Shares; life-size lengths [m].
_STYLES: dict[str, tuple[float, Style]] = {
    "knitted": (0.27, {
        "hand_width": (0.142, 0.150), "finger_puff": (0.55, 0.75), "palm_puff": (0.002, 0.006),
        "wrist_ratio": (0.63, 0.72), "cuff_length": (0.06, 0.10), "cuff_ratio": (0.90, 1.05),
        "wall_thickness": (0.0016, 0.0022),
    }),
    "leather": (0.25, {
        "hand_width": (0.142, 0.150), "finger_puff": (0.65, 0.9), "palm_puff": (0.001, 0.005),
        "wrist_ratio": (0.66, 0.76), "cuff_length": (0.022, 0.055), "cuff_ratio": (0.98, 1.15),
        "wall_thickness": (0.0012, 0.0017),
    }),
    "work": (0.22, {
        "hand_width": (0.148, 0.160), "finger_puff": (0.6, 0.9), "palm_puff": (0.002, 0.008),
        "wrist_ratio": (0.74, 0.9), "cuff_length": (0.05, 0.09), "cuff_ratio": (1.05, 1.30),
        "wall_thickness": (0.0016, 0.0026),
    }),
    "winter": (0.18, {
        "hand_width": (0.154, 0.166), "finger_puff": (0.8, 1.0), "palm_puff": (0.005, 0.010),
        "wrist_ratio": (0.66, 0.78), "cuff_length": (0.05, 0.11), "cuff_ratio": (1.0, 1.28),
        "wall_thickness": (0.002, 0.003),
    }),
    "evening": (0.08, {
        "hand_width": (0.142, 0.148), "finger_puff": (0.55, 0.8), "palm_puff": (0.001, 0.004),
        "wrist_ratio": (0.60, 0.68), "cuff_length": (0.11, 0.165), "cuff_ratio": (1.05, 1.30),
        "wall_thickness": (0.0012, 0.0015),
    }),
}  # fmt: skip
_LENGTHS = ("hand_width", "palm_puff", "cuff_length")


def draw_glove(rng: np.random.Generator, _: Sizes) -> GloveParameters:
    """Draw a glove for either hand, S to XXL; the robots reach all sizes.

    Material and cuff, proportions of the hand, and spread of the fingers are drawn separately.
    """
    _style_name, style = draw_style(rng, _STYLES)
    values = draw_ranges(rng, style)
    scale = SCALE * float(rng.choice(_SIZES, p=_SIZE_SHARES))
    for name in _LENGTHS:
        values[name] *= scale
    return GloveParameters(
        hand="left" if rng.uniform() < 0.5 else "right",
        palm_length=scale * float(rng.uniform(0.095, 0.112)),
        middle_length=scale * float(rng.uniform(0.084, 0.104)),
        index_ratio=float(rng.uniform(0.86, 0.97)),
        ring_ratio=float(rng.uniform(0.88, 1.0)),
        little_ratio=float(rng.uniform(0.68, 0.82)),
        little_width_ratio=float(rng.uniform(0.88, 0.98)),
        finger_taper=float(rng.uniform(0.87, 0.94)),
        finger_spread=float(rng.uniform(0.05, 0.17)),
        web_width=scale * float(rng.uniform(0.0048, 0.007)),
        knuckle_slant=float(rng.uniform(0.04, 0.20)),
        thumb_length=scale * float(rng.uniform(0.078, 0.096)),
        thumb_width=scale * float(rng.uniform(0.034, 0.041)),
        thumb_angle=float(rng.uniform(0.63, 1.05)),  # closer to a narrow wrist its wall seldom fits
        **values,
    )
