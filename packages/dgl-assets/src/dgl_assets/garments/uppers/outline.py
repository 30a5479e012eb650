"""Curves of the body of an upper garment, on the side +x."""

from __future__ import annotations

import math

import numpy as np
from scipy.interpolate import PchipInterpolator

from dgl_assets.garments.uppers.neckline import Neckline
from dgl_assets.garments.uppers.parameters import Armhole, Body, Opening
from dgl_assets.ranges import check_limit

SAMPLES = 400
"""Points of a curve."""

_HIP_BELOW_WAIST = 0.17  # [m]
_LEAST_STEP = 0.035  # between heights that shape the side seam [m]
_LEAST_SIDE = 0.05  # length of the side seam [m]
_ROOM_AT_NECK = 0.02  # between an armhole and the neck [m]


def evaluate_hem(body: Body, x: np.ndarray, *, sign: int) -> np.ndarray:
    """Height of the hem at x [m], of the right half (+1) or the left one (-1)."""
    share = np.clip(x / body.hem_half_width, 0.0, 1.0)
    return -body.length + body.hem_curve * share**2 + sign * body.hem_tilt * share


def cut_hem(body: Body, *, sign: int, start: float) -> np.ndarray:
    """Hem from x = `start` to the corner [m], shape (N, 2)."""
    x = np.linspace(start, body.hem_half_width, SAMPLES)
    return np.stack([x, evaluate_hem(body, x, sign=sign)], axis=1)


def cut_side(body: Body, *, sign: int) -> np.ndarray:
    """Side seam from the corner of the hem to the armpit [m], shape (N, 2).

    Raises:
        ValueError: If it is shorter than 0.05 m.
    """
    knots = [(-body.length + body.hem_curve + sign * body.hem_tilt, body.hem_half_width)]
    hip = body.waist_depth + _HIP_BELOW_WAIST
    for depth, width in ((hip, body.hip_half_width), (body.waist_depth, body.waist_half_width)):
        # Levels beyond the hem, or almost on another one, do not shape the seam.
        if width > 0 and -depth > knots[-1][0] + _LEAST_STEP:
            knots.append((-depth, width))
    if knots[-1][0] > -body.armhole_depth - _LEAST_STEP and len(knots) > 1:
        knots.pop()
    knots.append((-body.armhole_depth, body.chest_half_width))
    y, x = np.array(knots).T
    if y[-1] - y[0] < _LEAST_SIDE:
        raise ValueError(
            f"the side seam must be at least {_LEAST_SIDE} m long; got {y[-1] - y[0]:.3f} from "
            f"length {body.length}, hem_curve {body.hem_curve} and armhole_depth "
            f"{body.armhole_depth}"
        )
    heights = np.linspace(y[0], y[-1], SAMPLES)
    return np.stack([PchipInterpolator(y, x)(heights), heights], axis=1)


def cut_armhole(
    armhole: Armhole, start: np.ndarray, end: np.ndarray, *, layer: int, neck: float
) -> np.ndarray:
    """Edge of an armhole without sleeve from the shoulder point to the armpit [m], shape (N, 2).

    Raises:
        ValueError: If it comes nearer than 0.02 m to the neck, whose half width is `neck`.
    """
    angle = np.linspace(0.0, math.pi / 2, SAMPLES)
    x = start[0] + (end[0] - start[0]) * (1 - np.cos(angle)) ** (1 / armhole.squareness)
    y = start[1] + (end[1] - start[1]) * np.sin(angle)
    scoop = armhole.front_scoop if layer > 0 else armhole.back_scoop
    x -= 1.3 * scoop * np.sin(angle) ** 2 * np.sin(2 * angle)
    x[-1], y[-1] = end
    if x.min() < neck + _ROOM_AT_NECK:
        raise ValueError(
            f"the armhole reaches the neck: front_scoop {armhole.front_scoop} and back_scoop "
            f"{armhole.back_scoop} are too deep for a strap that ends at {start[0]:.3f}"
        )
    return np.stack([x, y], axis=1)


def cut_opening(opening: Opening, neckline: Neckline, body: Body, *, sign: int) -> np.ndarray:
    """Edge of an open front from the hem to the neckline [m], shape (N, 2).

    Raises:
        ValueError: If it opens the neck by more than 0.6 of its width.
    """
    most = 0.6 * neckline.neck.half_width
    check_limit("top_gap", opening.top_gap, "0.6 of the neck's half width", most=most)
    top = float(neckline.evaluate(np.array([opening.top_gap]), layer=1)[0])
    bottom = float(evaluate_hem(body, np.array([opening.hem_gap]), sign=sign)[0])
    y = np.linspace(bottom, top, SAMPLES)
    x = opening.hem_gap + (opening.top_gap - opening.hem_gap) * (y - bottom) / (top - bottom)
    if opening.corner_radius > 0:
        share = np.clip((bottom + opening.corner_radius - y) / opening.corner_radius, 0.0, 1.0)
        # Not quite a quarter of a circle: the hem must not meet it in a line.
        x += opening.corner_radius * (1 - np.sqrt(1 - 0.96 * share**2))
        y[0] = evaluate_hem(body, x[:1], sign=sign)[0]
    return np.stack([x, y], axis=1)


def cut_collar_edge(opening: np.ndarray, neckline: Neckline) -> np.ndarray:
    """Front edge of a standing collar above the top of an open front [m], shape (N, 2)."""
    x, y = opening[-1:].T
    rise = np.linspace(y[0], neckline.evaluate_edge(x, layer=1)[0], SAMPLES // 8)
    return np.stack([x * neckline.scale(rise), rise], axis=1)
