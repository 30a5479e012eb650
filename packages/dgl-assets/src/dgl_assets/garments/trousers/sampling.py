"""Random trousers, as a shop would mix them."""

from __future__ import annotations

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
from dgl_assets.garments.trousers.garment import cut_trousers
from dgl_assets.garments.trousers.parameters import TrousersParameters

REACH_LENGTH = 1.0
"""Longest trousers that the robots fold [m]; the paper's demonstration garment is 0.905 m long."""

# Widths of knee, ankle and hem as shares of the thigh's.
_LEGS: dict[str, tuple[tuple[float, float], tuple[float, float], tuple[float, float]]] = {
    "straight": ((0.72, 0.82), (0.66, 0.76), (0.64, 0.76)),
    "tapered": ((0.66, 0.76), (0.50, 0.58), (0.46, 0.56)),
    "skinny": ((0.56, 0.64), (0.40, 0.46), (0.38, 0.44)),
    "bootcut": ((0.62, 0.70), (0.72, 0.82), (0.78, 0.88)),
    "flared": ((0.58, 0.68), (0.90, 1.05), (1.02, 1.25)),
    "wide": ((0.92, 1.04), (0.92, 1.10), (0.92, 1.14)),
    "jogger": ((0.74, 0.86), (0.60, 0.72), (0.38, 0.48)),
    "balloon": ((0.95, 1.08), (0.66, 0.80), (0.50, 0.62)),
}


def draw_trousers(rng: np.random.Generator, sizes: Sizes) -> TrousersParameters:
    """Draw trousers or shorts: body, leg shape, length, rise and waist separately.

    Args:
        rng: Generator, advanced by this call.
        sizes: "reach" for adults' garments that the robots reach, "all" for children to XXL.

    Raises:
        ValueError: If what was drawn does not fit together, or into the sizes.
    """
    body = draw_body(rng, populations=ADULTS if sizes == "reach" else EVERYBODY)
    kind = pick(rng, _LENGTHS)
    leg = pick(rng, _SHORT_LEGS if kind in ("shorts", "bermuda") else _LONG_LEGS)
    is_tight = leg == "skinny"
    hip = SCALE * body.hip / 4 * (span(rng, -0.06, 0.02) + 1 if is_tight else span(rng, 1.03, 1.18))
    rise_kind = span(rng, 0.0, 1.0)  # 0 on the hips, 1 high
    rise = SCALE * body.rise * (0.78 + 0.36 * rise_kind) + (
        span(rng, 0.03, 0.06) if leg == "balloon" else 0.0
    )
    gathered = rng.random() < (0.9 if leg == "jogger" else 0.25)
    waist = SCALE * body.waist / 4 * (1.0 - 0.04 * gathered) * span(rng, 0.98, 1.06)
    waist += (1 - rise_kind) * 0.55 * max(hip - waist, 0.0)
    thigh = hip * (span(rng, 0.93, 1.0) if is_tight else span(rng, 1.0, 1.1))
    inseam = _draw_inseam(rng, kind, body)
    # A short leg ends where a long one still tapers.
    reached = min(1.0, inseam / (SCALE * body.inside_leg))
    knee, ankle, hem = (thigh * span(rng, *bounds) for bounds in _LEGS[leg])
    if leg not in _GATHERED:
        ankle = knee + (hem - knee) * span(rng, 0.72, 0.9)
    if kind in ("shorts", "bermuda"):
        shares = (0.5 * reached, 0.9 * reached, reached)
        widths = zip((knee, ankle, hem), shares, strict=True)
        knee, ankle, hem = (thigh + (width - thigh) * share for width, share in widths)
    needed = max(
        (width / 2 - thigh / 2 + 0.012) / (share * inseam)
        for width, share in zip((knee, ankle, hem), (0.5, 0.9, 1.0), strict=True)
    )
    angle = max(span(rng, 0.03, 0.14), needed + span(rng, 0.01, 0.03))
    trousers = TrousersParameters(
        waist_half_width=float(min(waist, hip)),
        hip_half_width=float(hip),
        rise=float(rise),
        waist_front_drop=float(span(rng, 0.004, 0.028)),
        waist_back_rise=float(span(rng, 0.0, 0.015)),
        inseam_length=float(inseam),
        thigh_width=float(thigh),
        knee_width=float(knee),
        ankle_width=float(ankle),
        hem_width=float(hem),
        leg_angle=float(angle),
        leg_angle_difference=float(np.clip(rng.normal(0, 0.012), -0.03, 0.03)),
        pocket_bulge=float(
            span(rng, 0.006, 0.02) if inseam > 0.3 and rng.random() < 0.15 and not is_tight else 0.0
        ),
        hem_slant=float(span(rng, -0.008, 0.012)),
    )
    length = trousers.rise + trousers.inseam_length
    if sizes == "reach" and length > REACH_LENGTH:
        raise ValueError(f"the length must be at most {REACH_LENGTH} m; got {length}")
    check_size(cut_trousers(trousers))
    return trousers


_GATHERED = ("jogger", "balloon")  # a cuff at the ankle
_LENGTHS = {"long": 0.56, "cropped": 0.12, "bermuda": 0.14, "shorts": 0.18}
_LONG_LEGS = {
    "straight": 0.24, "tapered": 0.17, "skinny": 0.14, "bootcut": 0.08, "flared": 0.1, "wide": 0.12,
    "jogger": 0.1, "balloon": 0.05,
}  # fmt: skip
_SHORT_LEGS = {"straight": 0.35, "tapered": 0.2, "skinny": 0.1, "wide": 0.2, "flared": 0.15}


def _draw_inseam(rng: np.random.Generator, kind: str, body: BodySize) -> float:
    shares = {"long": (0.92, 1.04), "cropped": (0.62, 0.85)}
    shares |= {"bermuda": (0.3, 0.45), "shorts": (0.1, 0.25)}
    return SCALE * body.inside_leg * span(rng, *shares[kind])
