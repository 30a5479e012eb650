"""Random dresses, as a shop would mix them."""

from __future__ import annotations

import numpy as np

from dgl_assets.garments.assembly import check_size
from dgl_assets.garments.drawing import pick, span
from dgl_assets.garments.dresses.garment import DRESS_PINS
from dgl_assets.garments.dresses.parameters import DressParameters
from dgl_assets.garments.sizes import SCALE, BodySize, Sizes, draw_body
from dgl_assets.garments.uppers.cutting import cut_upper
from dgl_assets.garments.uppers.parameters import Body
from dgl_assets.garments.uppers.sampling import Fit, draw_fit, draw_neck, draw_sleeve

REACH_SPAN = 1.15
"""Widest dresses that both robots reach, cuff to cuff [m]."""
REACH_LENGTH = 1.0
"""Longest dresses that the robots fold and hang [m]; the paper's demonstration dress has 0.90 m."""

# Highest point of the shoulder to the hem, as shares of the stature.
_SHORT = {"mini": ((0.50, 0.55), 0.4), "knee": ((0.55, 0.63), 0.6)}
_LONG = {"midi": ((0.64, 0.73), 0.5), "ankle": ((0.76, 0.85), 0.5)}
_NECKS = {
    "crew": 0.2, "wide_crew": 0.07, "scoop": 0.13, "v": 0.18, "boat": 0.1, "square": 0.1,
    "mock": 0.05, "turtle": 0.05, "shirt": 0.05, "camp": 0.05, "hood": 0.02,
}  # fmt: skip
_LINES = {
    "straight": 0.2, "a_line": 0.24, "fit_and_flare": 0.24, "empire": 0.13, "sheath": 0.12,
    "trapeze": 0.07,
}  # fmt: skip


def draw_dress(rng: np.random.Generator, sizes: Sizes) -> DressParameters:
    """Draw a dress: length, sleeves, silhouette, neckline and fit separately.

    Args:
        rng: Generator, advanced by this call.
        sizes: "reach" for at most 1.15 m cuff to cuff and 1.0 m length, "all" for girls' to XXL.

    Raises:
        ValueError: If what was drawn does not fit together, or into the sizes.
    """
    size = draw_body(rng, populations=("women",) if sizes == "reach" else ("children", "women"))
    fit = draw_fit(rng, size, ease=(0.98, 1.26))
    body = _draw_body(rng, size, fit)
    neck = draw_neck(rng, _NECKS, body=size)
    is_short = rng.random() < 0.35
    share = span(rng, 0.26, 0.52) if is_short else rng.normal(1.04, 0.03)
    length = SCALE * size.arm_length * share
    length = max(length - 0.8 * (fit.shoulder - fit.natural_shoulder), 0.12)
    sleeve = draw_sleeve(rng, body=body, neck=neck, length=length, raglan=0.08, is_short=is_short)
    dress = DressParameters(body=body, neck=neck, sleeve=sleeve)
    if sizes == "reach" and (dress.span > REACH_SPAN or dress.body.length > REACH_LENGTH):
        raise ValueError(f"a dress in reach is smaller; got {dress.span}, {dress.body.length}")
    check_size(cut_upper(dress.cuts, DRESS_PINS))
    return dress


def _draw_body(rng: np.random.Generator, size: BodySize, fit: Fit) -> Body:
    lengths = _SHORT if rng.random() < 0.66 else _LONG
    kind = pick(rng, {name: share for name, (_, share) in lengths.items()})
    length = SCALE * size.stature * span(rng, *lengths[kind][0])
    line = pick(rng, _LINES)
    natural = SCALE * size.back_length * span(rng, 0.97, 1.06)
    waist = SCALE * size.waist / 4
    skirt = length - natural
    hip = SCALE * size.hip / 4
    seam, waist_width, hip_width = natural, fit.chest * span(rng, 0.95, 1.0), 0.0
    if line == "straight":
        hem = max(fit.chest * span(rng, 0.98, 1.1), hip * span(rng, 1.04, 1.12))
    elif line == "a_line":
        waist_width = min(waist * span(rng, 1.12, 1.25), fit.chest)
        hem = max(hip, waist_width) * 1.08 + skirt * span(rng, 0.12, 0.26)
    elif line == "fit_and_flare":
        waist_width = min(waist * span(rng, 1.04, 1.14), 0.92 * fit.chest)
        hem = hip * 1.1 + skirt * span(rng, 0.26, 0.5)
    elif line == "empire":
        seam = fit.armhole + SCALE * span(rng, 0.06, 0.09)
        waist_width = fit.chest * span(rng, 0.86, 0.93)
        hem = hip * 1.05 + (length - seam) * span(rng, 0.12, 0.34)
    elif line == "sheath":
        waist_width = min(waist * span(rng, 1.06, 1.16), 0.94 * fit.chest)
        hip_width = hip * span(rng, 1.03, 1.08)
        hem = hip_width * span(rng, 0.82, 1.0)
    else:
        waist_width = fit.chest * span(rng, 1.12, 1.25)
        hem = waist_width + skirt * span(rng, 0.2, 0.34)
    has_flare = line in ("a_line", "fit_and_flare", "empire")
    if has_flare and rng.random() < 0.6:  # a skirt of straight seams
        share = 0.17 / (length - seam)
        hip_width = waist_width + (hem - waist_width) * share * span(rng, 1.0, 1.5)
    curve = span(rng, *_draw_curve(rng))
    if hem > 1.25 * hip:  # a flared hem is a part of a circle
        curve += 0.16 * (hem - 1.1 * hip)
    return Body(
        chest_half_width=fit.chest,
        length=length,
        shoulder_half_width=fit.shoulder,
        shoulder_slope=fit.slope,
        armhole_depth=fit.armhole,
        waist_depth=max(seam, fit.armhole + 0.05),
        waist_half_width=waist_width,
        hip_half_width=hip_width,
        hem_half_width=hem,
        hem_curve=min(curve, 0.1),
        hem_tilt=float(rng.normal(0.0, 0.002)),
    )


def _draw_curve(rng: np.random.Generator) -> tuple[float, float]:
    """Draw a range for the curve of a hem [m]."""
    kind = pick(rng, {"straight": 0.75, "tail": 0.15, "dipped": 0.1})
    return {"straight": (0.0, 0.008), "tail": (0.02, 0.05), "dipped": (-0.025, -0.008)}[kind]
