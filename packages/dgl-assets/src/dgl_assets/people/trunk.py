"""The trunk of a body: sections from the crotch to the neck, seat and chest."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import PchipInterpolator

from dgl_assets.people.measures import PersonMeasures
from dgl_assets.people.solids import Blend, Ellipsoid, Loft, Solid

_EXPONENT = 2.3  # of the sections: a little fuller than ellipses
_GROWN = 1.6  # stature [m] above which the chest has muscles that show


def compute_half_axes(girth: float, ratio: float) -> tuple[float, float]:
    """Half width and half depth [m] of a section of a girth [m] and a ratio of width to depth."""
    turn = np.arange(360) * (2 * np.pi / 360)
    n = _EXPONENT
    radius = ((np.abs(np.cos(turn))) ** n + (np.abs(np.sin(turn)) * ratio) ** n) ** (-1 / n)
    points = radius[:, None] * np.column_stack([np.cos(turn), np.sin(turn)])
    length = np.linalg.norm(np.roll(points, -1, axis=0) - points, axis=1).sum()
    return girth / length, girth / length / ratio


def make_trunk(
    m: PersonMeasures, joints: dict[str, np.ndarray], points: dict[str, np.ndarray]
) -> Blend:
    """Lay out the trunk, and add its joints and named points."""
    low, high = m.crotch_height, m.shoulder_height
    size = m.stature / 1.756

    def at(share: float) -> float:
        return low + share * (high - low)

    hip, waist = compute_half_axes(m.hip_girth, 1.40), compute_half_axes(m.waist_girth, 1.32)
    chest = compute_half_axes(m.chest_girth * (0.97 - 0.05 * m.bust), 1.42)
    neck = m.neck_girth / (2 * np.pi)
    wide = m.shoulder_breadth / 2
    belly = np.clip((m.waist_girth / m.chest_girth - 0.8) / 0.2, 0, 1)
    sections = [  # share of the height, half width, half depth, y of the centre
        (-0.03, 0.45 * hip[0], 0.5 * hip[1], 0.004),
        (0.05, 0.90 * hip[0], 0.86 * hip[1], 0.006),
        (0.12, 0.99 * hip[0], 0.95 * hip[1], 0.005),
        (0.20, 0.98 * hip[0], 0.92 * hip[1], 0.002),
        (0.30, 0.5 * (hip[0] + waist[0]), 0.5 * (hip[1] + waist[1]) * 0.97, -0.004),
        (0.42, waist[0], waist[1], -0.008 - 0.014 * belly),
        (0.55, 0.35 * waist[0] + 0.65 * chest[0] * 0.93, 0.55 * waist[1] + 0.45 * chest[1], -0.006),
        (0.68, 0.97 * chest[0], 0.99 * chest[1], 0.0),
        (0.78, chest[0], 0.98 * chest[1], 0.004),
        (0.87, 0.5 * chest[0] + 0.5 * wide, 0.86 * chest[1], 0.010),
        (0.94, 0.90 * wide, 0.66 * chest[1], 0.014),
        (0.99, 0.60 * wide, 0.48 * chest[1], 0.016),
        (1.03, 1.15 * neck, 1.1 * neck, 0.016),
    ]
    share, width, depth, centre = (np.array(column) for column in zip(*sections, strict=True))
    fine = np.linspace(share[0], share[-1], 60)
    width, depth, centre = (
        PchipInterpolator(share, values)(fine) for values in (width, depth, centre)
    )
    loft = Loft(
        bones=("pelvis", "spine", "chest"),
        borders=(at(0.34), at(0.60)),
        heights=low + fine * (high - low),
        half_widths=width,
        half_depths=depth,
        centres=centre * size,
        exponent=_EXPONENT,
    )
    parts: list[Solid] = [loft]
    for sign in (1.0, -1.0):
        seat = np.array([sign * 0.46 * hip[0], 0.42 * hip[1], at(0.08)])
        parts.append(Ellipsoid("pelvis", seat, np.array([0.44, 0.62, 0.62]) * hip[1]))
        if m.bust > 0.05:
            breast = np.array([sign * 0.47 * chest[0], -0.66 * chest[1], at(0.70)])
            radius = m.bust**0.5 * 0.44 * chest[1]
            parts.append(Ellipsoid("chest", breast, radius * np.array([1.08, 1.05, 1.0])))
        elif m.stature > _GROWN:
            breast = np.array([sign * 0.42 * chest[0], -0.62 * chest[1], at(0.76)])
            parts.append(Ellipsoid("chest", breast, np.array([0.50, 0.36, 0.42]) * chest[1]))
    joints["pelvis"] = np.array([0.0, 0.01 * size, at(0.10)])
    joints["spine"] = np.array([0.0, 0.02 * size, at(0.34)])
    joints["chest"] = np.array([0.0, 0.025 * size, at(0.60)])
    joints["neck"] = np.array([0.0, 0.022 * size, at(0.985)])
    for name, y, level in (
        ("sternum", -1.0, 0.76),
        ("navel", -1.0, 0.42),
        ("upper_back", 1.0, 0.8),
    ):
        depth_here = float(np.interp(level, fine, depth))
        points[name] = np.array([0.0, y * depth_here, at(level)])
    return Blend(0.03 * size, parts)
