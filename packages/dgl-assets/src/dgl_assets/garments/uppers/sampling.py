"""Random parts of upper garments, drawn separately so that garments differ in cut."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from dgl_assets.garments.drawing import pick, span
from dgl_assets.garments.sizes import SCALE, BodySize
from dgl_assets.garments.uppers.parameters import Body, Neck, Sleeve, SleeveSeam
from dgl_assets.garments.uppers.sleeve import compute_armhole_width

Bounds = tuple[float, float]


class NeckStyle(NamedTuple):
    """Ranges of one kind of neckline in life size, for a women's M [m]."""

    finish: str
    half_width: Bounds
    front_depth: Bounds
    back_depth: Bounds
    roundness: Bounds
    height: Bounds = (0.0, 0.0)
    spread: Bounds = (0.0, 0.0)
    leaf_width: Bounds = (0.0, 0.0)
    leaf_angle: Bounds = (1.0, 1.0)


NECK_STYLES: dict[str, NeckStyle] = {
    "crew": NeckStyle("plain", (0.082, 0.105), (0.07, 0.11), (0.012, 0.025), (1.9, 2.6)),
    "wide_crew": NeckStyle("plain", (0.105, 0.13), (0.09, 0.12), (0.015, 0.035), (1.9, 2.6)),
    "scoop": NeckStyle("plain", (0.10, 0.13), (0.13, 0.18), (0.02, 0.06), (1.9, 2.8)),
    "v": NeckStyle("plain", (0.08, 0.11), (0.13, 0.20), (0.015, 0.03), (0.95, 1.2)),
    "boat": NeckStyle("plain", (0.125, 0.165), (0.04, 0.075), (0.012, 0.03), (1.7, 2.6)),
    "square": NeckStyle("plain", (0.095, 0.13), (0.10, 0.15), (0.015, 0.05), (3.6, 4.8)),
    "mock": NeckStyle(
        "stand", (0.075, 0.09), (0.06, 0.085), (0.01, 0.02), (2.0, 2.4),
        (0.03, 0.05), (-0.004, 0.006),
    ),
    "turtle": NeckStyle(
        "stand", (0.07, 0.088), (0.06, 0.08), (0.01, 0.02), (2.0, 2.4),
        (0.065, 0.09), (-0.006, 0.012),
    ),
    "funnel": NeckStyle(
        "stand", (0.09, 0.115), (0.07, 0.10), (0.01, 0.03), (2.0, 2.6),
        (0.06, 0.095), (0.01, 0.035),
    ),
    "polo": NeckStyle(
        "fold", (0.075, 0.092), (0.075, 0.14), (0.01, 0.02), (1.15, 2.0),
        (0.022, 0.035), (0.025, 0.045), (0.045, 0.06), (0.8, 1.2),
    ),
    "shirt": NeckStyle(
        "fold", (0.072, 0.088), (0.065, 0.095), (0.01, 0.02), (1.5, 2.2),
        (0.028, 0.042), (0.025, 0.04), (0.05, 0.072), (0.95, 1.35),
    ),
    "camp": NeckStyle(
        "fold", (0.08, 0.10), (0.12, 0.18), (0.01, 0.02), (1.0, 1.25),
        (0.022, 0.035), (0.03, 0.05), (0.055, 0.085), (0.45, 0.9),
    ),
    "hood": NeckStyle(
        "hood", (0.082, 0.10), (0.075, 0.105), (0.012, 0.022), (1.9, 2.4),
        (0.28, 0.35), (0.035, 0.06),
    ),
    "lapel": NeckStyle(
        "lapel", (0.08, 0.098), (0.20, 0.46), (0.01, 0.02), (0.98, 1.12),
        (0.028, 0.045), (0.028, 0.045), (0.065, 0.105), (0.45, 0.75),
    ),
    "deep_v": NeckStyle("plain", (0.085, 0.11), (0.20, 0.40), (0.012, 0.025), (0.95, 1.2)),
}  # fmt: skip
"""Kinds of necklines; values from memory of garments in shops."""


def draw_neck(rng: np.random.Generator, shares: Mapping[str, float], *, body: BodySize) -> Neck:
    """Draw a neckline of one of some kinds, each with its share."""
    style = NECK_STYLES[pick(rng, shares)]
    scale = SCALE * body.size_factor
    height = span(rng, *style.height)
    spread = span(rng, *style.spread)
    if style.leaf_width[0] > 0:
        spread = min(spread, 1.15 * height)
    return Neck(
        half_width=scale * span(rng, *style.half_width),
        front_depth=scale * span(rng, *style.front_depth),
        back_depth=scale * span(rng, *style.back_depth),
        roundness=span(rng, *style.roundness),
        finish=style.finish,  # type: ignore[arg-type]
        height=scale * height,
        spread=scale * spread,
        leaf_width=scale * span(rng, *style.leaf_width),
        leaf_angle=span(rng, *style.leaf_angle),
    )


class Fit(NamedTuple):
    """Fit on a body: share of ease, half widths and depths [m], shoulder slope [rad]."""

    ease: float
    chest: float
    natural_shoulder: float
    shoulder: float
    slope: float
    armhole: float


def draw_fit(rng: np.random.Generator, body: BodySize, *, ease: Bounds = (1.02, 1.40)) -> Fit:
    """Draw ease, shoulder and armhole.

    Args:
        rng: Generator.
        body: Wearer.
        ease: Girth of slim and of oversized garments, relative to the body's chest.
    """
    share = rng.beta(1.2, 1.4)  # 0 slim, 1 oversized
    chest = SCALE * body.chest / 4 * (ease[0] + (ease[1] - ease[0]) * share)
    natural = SCALE * body.shoulder_width / 2 * rng.normal(1.03, 0.03)
    drop = float(np.clip(share + rng.normal(0, 0.25), 0, 1)) ** 1.5
    shoulder = min(natural + drop * max(chest - natural, 0.0), chest + 0.01)
    slope = span(rng, 0.20, 0.44) - 0.06 * drop
    fall = (shoulder - natural) * math.tan(slope)
    depth = SCALE * (0.118 + 0.117 * body.chest + 0.04 * share + rng.normal(0, 0.008))
    return Fit(share, chest, natural, shoulder, slope, depth + max(fall, 0.0))


class Silhouette(NamedTuple):
    """Half widths of waist and hem relative to the chest."""

    waist: Bounds
    hem: Bounds


SILHOUETTES: dict[str, Silhouette] = {
    "straight": Silhouette((0.97, 1.0), (0.96, 1.03)),
    "shaped": Silhouette((0.84, 0.93), (0.94, 1.05)),
    "a_line": Silhouette((1.0, 1.07), (1.12, 1.32)),
    "cocoon": Silhouette((1.0, 1.06), (0.76, 0.90)),
    "peplum": Silhouette((0.82, 0.91), (1.12, 1.28)),
}


def draw_hem(rng: np.random.Generator) -> tuple[float, float]:
    """Draw curve and tilt of a hem [m]: straight, tailed, dipped, rarely slanted."""
    kind = pick(rng, {"straight": 0.58, "tail": 0.24, "dipped": 0.12, "slanted": 0.06})
    curve = {"straight": (-0.002, 0.006), "tail": (0.02, 0.07), "dipped": (-0.03, -0.006)}
    tilt = float(rng.normal(0.0, 0.002))
    if kind == "slanted":
        return 0.0, float(rng.choice([-1.0, 1.0]) * span(rng, 0.012, 0.035))
    return span(rng, *curve[kind]), tilt


# Widths at a quarter, at four fifths and at the cuff relative to the armhole.
_SLEEVES: dict[str, tuple[Bounds, Bounds, Bounds]] = {
    "tapered": ((0.84, 0.96), (0.58, 0.72), (0.50, 0.62)),
    "slim": ((0.70, 0.80), (0.46, 0.56), (0.42, 0.50)),
    "straight": ((0.90, 1.00), (0.78, 0.92), (0.74, 0.88)),
    "bell": ((0.80, 0.92), (0.85, 1.10), (1.0, 1.45)),
    "bishop": ((0.92, 1.04), (0.95, 1.15), (0.48, 0.62)),
    "cuffed": ((0.90, 1.00), (0.72, 0.84), (0.46, 0.54)),
    "balloon": ((1.06, 1.22), (1.05, 1.2), (0.45, 0.56)),
}
_SLEEVE_SHARES = {
    "tapered": 0.34, "slim": 0.1, "straight": 0.22, "bell": 0.09, "bishop": 0.09, "cuffed": 0.1,
    "balloon": 0.06,
}  # fmt: skip
_SHORT_SLEEVE_SHARES = {"straight": 0.5, "tapered": 0.2, "bell": 0.2, "balloon": 0.1}


def draw_sleeve(
    rng: np.random.Generator,
    *,
    body: Body,
    neck: Neck,
    length: float,
    angles: Bounds = (0.40, 1.02),
    raglan: float = 0.18,
    is_short: bool = False,
) -> Sleeve:
    """Draw sleeves for a body.

    Args:
        rng: Generator.
        body: Measures of the body.
        neck: Measures of the neck.
        length: Shoulder to cuff [m].
        angles: Range of the sleeves' fall [rad].
        raglan: Share of raglan sleeves.
        is_short: Choose among the shapes of short sleeves.
    """
    angle = span(rng, max(angles[0], body.shoulder_slope + 0.03), angles[1])
    seam: SleeveSeam = "raglan" if rng.random() < raglan else "set_in"
    width = compute_armhole_width(body, neck, sleeve_angle=angle)
    kind = pick(rng, _SHORT_SLEEVE_SHARES if is_short else _SLEEVE_SHARES)
    upper, lower, cuff = (width * span(rng, *bounds) for bounds in _SLEEVES[kind])
    if is_short and kind in ("straight", "tapered"):  # it ends where a long one is still wide
        bounds = ((0.92, 1.0), (0.84, 0.96), (0.78, 0.95))
        upper, lower, cuff = (width * span(rng, *bound) for bound in bounds)
    return Sleeve(
        length=length,
        angle=angle,
        angle_difference=float(np.clip(rng.normal(0, 0.02), -0.06, 0.06)),
        bend=0.0 if is_short else span(rng, -0.008, 0.016),
        upper_width=upper,
        lower_width=lower,
        cuff_width=cuff,
        seam=seam,
    )
