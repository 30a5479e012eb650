"""Random long-sleeved tops, as a shop would mix them."""

from __future__ import annotations

import math
from dataclasses import asdict

import numpy as np

from dgl_assets.garments.tops.parameters import TopParameters, compute_armhole_width
from dgl_assets.garments.tops.pattern import TopPattern

_ATTEMPTS = 1000
_SPAN_RANGE = (1.0, 1.15)  # cuff to cuff, within the reach of both robots [m]
_SCALE = 0.85  # of life size, as the garments of the paper


def sample_top(rng: np.random.Generator | int) -> TopParameters:
    """Draw the measures of a random long-sleeved top.

    Fit, neckline, sleeve, silhouette and hem are drawn separately, so that tops differ in cut and not only in size. Tops
    that span less than 1.0 m or more than 1.15 m cuff to cuff are drawn again: both robots must reach the cuffs.

    Args:
        rng: Generator, advanced by this call, or a seed.

    Returns:
        Measures that make a valid top.
    """
    rng = np.random.default_rng(rng) if isinstance(rng, int | np.integer) else rng
    for _ in range(_ATTEMPTS):
        try:
            parameters = _draw(rng)
            TopPattern(parameters)  # refuses measures that contradict each other
        except ValueError:
            continue  # the next draw is independent
        return parameters
    raise RuntimeError(f"no valid top in {_ATTEMPTS} draws; the ranges of the sampler are broken")


def _draw(rng: np.random.Generator) -> TopParameters:
    size = rng.uniform(0.95, 1.08)  # between bodies
    ease = rng.beta(1.2, 1.4)  # 0 slim, 1 oversized
    chest = _SCALE * size * (0.232 + 0.085 * ease + rng.normal(0, 0.006))
    natural_shoulder = _SCALE * size * rng.normal(0.208, 0.007)
    drop = np.clip(ease + rng.normal(0, 0.25), 0, 1) ** 1.5
    shoulder = natural_shoulder + drop * max(chest - natural_shoulder, 0.0)
    slope = rng.uniform(0.24, 0.42) - 0.06 * drop
    shoulder_fall = (shoulder - natural_shoulder) * math.tan(slope)
    armhole = _SCALE * size * (0.225 + 0.04 * ease + rng.normal(0, 0.008)) + shoulder_fall
    length = _SCALE * size * (rng.choice([0.58, 0.65, 0.72], p=[0.25, 0.5, 0.25]))
    length += rng.normal(0, 0.018)
    sleeve = _SCALE * size * rng.normal(0.60, 0.02) - 0.8 * (shoulder - natural_shoulder)

    neck = _draw_neck(rng, size=size)
    angle = rng.uniform(0.58, 0.95)
    span = 2 * (shoulder + sleeve * math.cos(angle))
    if not _SPAN_RANGE[0] <= span <= _SPAN_RANGE[1]:
        raise ValueError(f"the span must be in {_SPAN_RANGE} m; got {span}")
    base = TopParameters(
        chest_half_width=float(chest),
        body_length=float(length),
        shoulder_half_width=float(shoulder),
        shoulder_slope=float(slope),
        armhole_depth=float(armhole),
        sleeve_length=float(sleeve),
        sleeve_angle=float(angle),
        sleeve_angle_difference=float(np.clip(rng.normal(0, 0.02), -0.05, 0.05)),
        sleeve_bend=float(rng.uniform(-0.006, 0.014)),
        **neck,
    )
    armhole_width = compute_armhole_width(base, sleeve_angle=angle)
    return TopParameters(
        **(asdict(base) | _draw_sleeve(rng, armhole_width=armhole_width) | _draw_body(rng))
    )


def _draw_neck(rng: np.random.Generator, *, size: float) -> dict[str, float]:
    kind = rng.choice(
        ["crew", "scoop", "v", "boat", "mock", "turtle"], p=[0.4, 0.15, 0.17, 0.08, 0.1, 0.1]
    )
    half, front, back, roundness, collar = {
        "crew": ((0.085, 0.105), (0.075, 0.11), (0.015, 0.025), (1.9, 2.5), (0.0, 0.0)),
        "scoop": ((0.10, 0.125), (0.12, 0.16), (0.02, 0.04), (1.9, 2.6), (0.0, 0.0)),
        "v": ((0.085, 0.105), (0.12, 0.18), (0.015, 0.025), (1.0, 1.15), (0.0, 0.0)),
        "boat": ((0.125, 0.145), (0.062, 0.078), (0.012, 0.02), (1.8, 2.4), (0.0, 0.0)),
        "mock": ((0.08, 0.09), (0.065, 0.085), (0.01, 0.02), (2.0, 2.4), (0.03, 0.05)),
        "turtle": ((0.075, 0.088), (0.065, 0.08), (0.01, 0.02), (2.0, 2.4), (0.065, 0.085)),
    }[str(kind)]
    scale = _SCALE * size
    return {
        "neck_half_width": float(scale * rng.uniform(*half)),
        "neck_front_depth": float(scale * rng.uniform(*front)),
        "neck_back_depth": float(scale * rng.uniform(*back)),
        "neck_roundness": float(rng.uniform(*roundness)),
        "collar_height": float(scale * rng.uniform(*collar)),
    }


def _draw_sleeve(rng: np.random.Generator, *, armhole_width: float) -> dict[str, float]:
    kind = rng.choice(["tapered", "straight", "bell", "bishop"], p=[0.45, 0.3, 0.1, 0.15])
    upper, lower, cuff = {
        "tapered": ((0.86, 0.96), (0.60, 0.72), (0.52, 0.62)),
        "straight": ((0.90, 1.00), (0.78, 0.90), (0.74, 0.86)),
        "bell": ((0.84, 0.92), (0.85, 1.00), (1.0, 1.25)),
        "bishop": ((0.92, 1.02), (0.95, 1.10), (0.52, 0.64)),
    }[str(kind)]
    return {
        "upper_sleeve_width": float(armhole_width * rng.uniform(*upper)),
        "lower_sleeve_width": float(armhole_width * rng.uniform(*lower)),
        "cuff_width": float(armhole_width * rng.uniform(*cuff)),
    }


def _draw_body(rng: np.random.Generator) -> dict[str, float]:
    kind = rng.choice(["straight", "shaped", "a_line", "cocoon"], p=[0.4, 0.25, 0.2, 0.15])
    flare, taper = {
        "straight": ((-0.008, 0.008), (-0.002, 0.010)),
        "shaped": ((-0.005, 0.012), (0.010, 0.024)),
        "a_line": ((0.02, 0.06), (0.0, 0.014)),
        "cocoon": ((-0.04, -0.015), (-0.025, -0.01)),
    }[str(kind)]
    hem = rng.choice(["straight", "tail", "dipped"], p=[0.6, 0.25, 0.15])
    curve = {"straight": (-0.002, 0.006), "tail": (0.02, 0.055), "dipped": (-0.02, -0.006)}
    return {
        "hem_flare": float(rng.uniform(*flare)),
        "waist_taper": float(rng.uniform(*taper)),
        "hem_curve": float(rng.uniform(*curve[str(hem)])),
    }
