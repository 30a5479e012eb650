"""Random tops, as a shop would mix them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from dgl_assets.garments.assembly import check_size
from dgl_assets.garments.drawing import pick, span
from dgl_assets.garments.sizes import (
    ADULTS,
    EVERYBODY,
    SCALE,
    BodySize,
    Sizes,
    draw_body,
)
from dgl_assets.garments.tops.garment import FRONT_OPEN_PINS, SLEEVELESS_PINS, TOP_PINS
from dgl_assets.garments.tops.parameters import (
    FrontOpenParameters,
    SleevelessParameters,
    TopParameters,
)
from dgl_assets.garments.uppers.cutting import cut_upper
from dgl_assets.garments.uppers.parameters import Armhole, Body, Neck, Opening
from dgl_assets.garments.uppers.sampling import (
    SILHOUETTES,
    Fit,
    draw_fit,
    draw_hem,
    draw_neck,
    draw_sleeve,
)

REACH_SPAN = (1.0, 1.15)
"""Cuff to cuff of tops that both robots reach [m]; the paper's demonstration top has 1.11 m."""
REACH_LENGTH = 0.85
"""Longest coats and tops that the robots hang, store or fold [m], nominal."""

# Highest point of the shoulder to the hem, as shares of the stature.
_LENGTHS = {
    "cropped": (0.27, 0.32), "waist": (0.32, 0.35), "hip": (0.35, 0.39), "long": (0.39, 0.44),
    "tunic": (0.44, 0.52),
}  # fmt: skip
_COAT_LENGTHS = {
    "jacket": (0.34, 0.39), "hip": (0.38, 0.43), "thigh": (0.44, 0.52), "knee": (0.55, 0.64),
}  # fmt: skip
_TOP_NECKS = {
    "crew": 0.20, "wide_crew": 0.06, "scoop": 0.09, "v": 0.12, "boat": 0.07, "square": 0.06,
    "mock": 0.06, "turtle": 0.07, "funnel": 0.04, "polo": 0.07, "shirt": 0.06, "camp": 0.04,
    "hood": 0.06,
}  # fmt: skip
_COAT_NECKS = {
    "crew": 0.13, "v": 0.1, "deep_v": 0.1, "mock": 0.09, "funnel": 0.06, "shirt": 0.1, "camp": 0.12,
    "hood": 0.12, "lapel": 0.22,
}  # fmt: skip
_SLEEVELESS_NECKS = {
    "crew": 0.22, "wide_crew": 0.08, "scoop": 0.22, "v": 0.14, "square": 0.08, "boat": 0.04,
    "mock": 0.05, "turtle": 0.03, "polo": 0.05, "shirt": 0.04, "camp": 0.02, "hood": 0.04,
}  # fmt: skip


def _check_reach(sizes: Sizes, *, length: float, width: float | None = None) -> None:
    if sizes == "all":
        return
    if width is not None and not REACH_SPAN[0] <= width <= REACH_SPAN[1]:
        raise ValueError(f"the span must be in {REACH_SPAN} m; got {width}")
    if length > REACH_LENGTH:
        raise ValueError(f"the length must be at most {REACH_LENGTH} m; got {length}")


def draw_top(rng: np.random.Generator, sizes: Sizes) -> TopParameters:
    """Draw a long-sleeved top: body, fit, neckline, sleeve, silhouette and hem separately.

    Args:
        rng: Generator, advanced by this call.
        sizes: "reach" for tops of 1.0 to 1.15 m cuff to cuff without a hood, as the paper's; "all"
            for children to XXL, hoods among them.

    Raises:
        ValueError: If what was drawn does not fit together, or into the sizes.
    """
    size = draw_body(rng, populations=ADULTS if sizes == "reach" else EVERYBODY)
    fit = draw_fit(rng, size)
    armhole = fit.armhole
    if rng.random() < 0.08:  # batwing
        armhole += SCALE * span(rng, 0.03, 0.09)
    lengths = {"cropped": 0.12, "waist": 0.13, "hip": 0.42, "long": 0.23, "tunic": 0.10}
    body = _draw_body_part(rng, size, fit, armhole=armhole, lengths=lengths)
    neck = draw_neck(rng, _TOP_NECKS, body=size)
    length = SCALE * size.arm_length * rng.normal(1.06, 0.03)
    if rng.random() < 0.08:  # three quarters
        length *= span(rng, 0.72, 0.85)
    length -= 0.8 * (fit.shoulder - fit.natural_shoulder)
    sleeve = draw_sleeve(rng, body=body, neck=neck, length=length)
    top = TopParameters(body=body, neck=neck, sleeve=sleeve)
    if sizes == "reach" and top.neck.finish == "hood":
        raise ValueError("tops for the robots have no hood")
    _check_reach(sizes, length=top.body.length, width=top.span)
    check_size(cut_upper(top.cuts, TOP_PINS))
    return top


def draw_front_open_top(rng: np.random.Generator, sizes: Sizes) -> FrontOpenParameters:
    """Draw a coat, jacket or cardigan; arguments and errors as of `draw_top`."""
    size = draw_body(rng, populations=ADULTS if sizes == "reach" else EVERYBODY)
    fit = draw_fit(rng, size, ease=(1.10, 1.50))
    lengths = {"jacket": 0.28, "hip": 0.34, "thigh": 0.22, "knee": 0.16}
    body = _draw_body_part(
        rng, size, fit, armhole=fit.armhole, lengths=lengths, table=_COAT_LENGTHS
    )
    neck = draw_neck(rng, _COAT_NECKS, body=size)
    length = SCALE * size.arm_length * rng.normal(1.08, 0.03)
    length -= 0.8 * (fit.shoulder - fit.natural_shoulder)
    sleeve = draw_sleeve(rng, body=body, neck=neck, length=length, raglan=0.14)
    opening = _draw_opening(rng, neck)
    top = FrontOpenParameters(body=body, neck=neck, sleeve=sleeve, opening=opening)
    _check_reach(sizes, length=top.body.length, width=max(top.span, REACH_SPAN[0]))
    check_size(cut_upper(top.cuts, FRONT_OPEN_PINS))
    return top


def _draw_opening(rng: np.random.Generator, neck: Neck) -> Opening:
    lapped = 0.0 if neck.finish == "hood" else 0.3
    shares = {"meeting": 0.4, "lapped": lapped, "apart": 0.15, "flaring": 0.15}
    kind = pick(rng, shares)
    top, hem = {
        "meeting": ((0.003, 0.008), (0.003, 0.01)),
        "lapped": ((-0.035, -0.01), (-0.035, -0.01)),
        "apart": ((0.01, 0.035), (0.015, 0.06)),
        "flaring": ((0.004, 0.012), (0.04, 0.12)),
    }[kind]
    gap = span(rng, *top)
    if neck.leaf_width > 0:  # a leaf on the lower front leaves little room below the upper one
        gap = max(gap, -0.02)
    is_round = rng.random() < 0.25
    return Opening(
        top_gap=gap,
        hem_gap=gap + span(rng, -0.004, 0.004) if kind == "lapped" else span(rng, *hem),
        corner_radius=span(rng, 0.03, 0.10) if is_round else 0.0,
    )


# End of the shoulder between neck (0) and natural shoulder (1), scoops of front and back [m],
# squareness.
_STRAPS: dict[str, tuple[tuple[float, float], ...]] = {
    "tank": ((0.30, 0.65), (0.0, 0.012), (0.0, 0.02), (0.85, 1.15)),
    "strap": ((0.16, 0.28), (0.0, 0.0), (0.0, 0.0), (0.8, 1.0)),
    "racer": ((0.28, 0.5), (0.005, 0.02), (0.025, 0.05), (0.8, 1.1)),
    "vest": ((0.70, 0.95), (0.005, 0.022), (0.005, 0.018), (0.85, 1.15)),
    "muscle": ((0.98, 1.14), (0.0, 0.012), (0.0, 0.01), (0.8, 1.2)),
    "halter": ((0.12, 0.26), (-0.005, 0.004), (0.0, 0.02), (1.2, 1.55)),
}


def draw_sleeveless_top(rng: np.random.Generator, sizes: Sizes) -> SleevelessParameters:
    """Draw a top without sleeves; arguments and errors as of `draw_top`."""
    size = draw_body(rng, populations=ADULTS if sizes == "reach" else EVERYBODY)
    fit = draw_fit(rng, size, ease=(0.98, 1.34))
    kind = pick(
        rng, {"tank": 0.3, "strap": 0.1, "racer": 0.1, "vest": 0.24, "muscle": 0.16, "halter": 0.1}
    )
    share, front, back, squareness = (span(rng, *bounds) for bounds in _STRAPS[kind])
    necks: Mapping[str, float] = _SLEEVELESS_NECKS
    if kind in ("strap", "racer"):
        necks = {"scoop": 0.55, "v": 0.25, "square": 0.2}
    elif kind == "halter":
        necks = {"crew": 0.4, "v": 0.2, "mock": 0.2, "turtle": 0.2}
    neck = draw_neck(rng, necks, body=size)
    natural = max(fit.natural_shoulder, neck.half_width + 0.06)
    shoulder = neck.half_width + max(share * (natural - neck.half_width), 0.028)
    depth = fit.armhole * span(rng, 0.86, 1.0) + (
        SCALE * span(rng, 0.02, 0.07) if kind == "muscle" and rng.random() < 0.5 else 0.0
    )
    lengths = {"cropped": 0.14, "waist": 0.14, "hip": 0.42, "long": 0.2, "tunic": 0.10}
    fit = fit._replace(shoulder=min(shoulder, fit.chest + 0.01))
    body = _draw_body_part(rng, size, fit, armhole=depth, lengths=lengths)
    back = max(back, front * 0.5)
    armhole = Armhole(front_scoop=front, back_scoop=back, squareness=squareness)
    top = SleevelessParameters(body=body, neck=neck, armhole=armhole)
    _check_reach(sizes, length=top.body.length)
    check_size(cut_upper(top.cuts, SLEEVELESS_PINS))
    return top


def _draw_body_part(
    rng: np.random.Generator,
    size: BodySize,
    fit: Fit,
    *,
    armhole: float,
    lengths: Mapping[str, float],
    table: Mapping[str, tuple[float, float]] = _LENGTHS,
) -> Body:
    kind = pick(
        rng, {"straight": 0.36, "shaped": 0.24, "a_line": 0.18, "cocoon": 0.14, "peplum": 0.08}
    )
    silhouette = SILHOUETTES[kind]
    length = SCALE * size.stature * span(rng, *table[pick(rng, lengths)])
    curve, tilt = draw_hem(rng)
    hem = fit.chest * span(rng, *silhouette.hem)
    if length > 0.6:  # a long garment must let the legs move
        hem = max(hem, SCALE * size.hip / 4 * 1.08) + 0.1 * (length - 0.6)
    return Body(
        chest_half_width=fit.chest,
        length=length,
        shoulder_half_width=fit.shoulder,
        shoulder_slope=fit.slope,
        armhole_depth=armhole,
        waist_depth=max(SCALE * size.back_length * span(rng, 0.94, 1.04), armhole + 0.04),
        waist_half_width=fit.chest * span(rng, *silhouette.waist),
        hem_half_width=hem,
        hem_curve=curve,
        hem_tilt=tilt,
    )
