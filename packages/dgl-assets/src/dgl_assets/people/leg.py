"""Legs and feet of a body."""

from __future__ import annotations

import numpy as np

from dgl_assets.people.measures import PersonMeasures
from dgl_assets.people.solids import Blend, Cone
from dgl_assets.people.trunk import compute_half_axes


def make_leg(
    m: PersonMeasures,
    side: str,
    sign: float,
    joints: dict[str, np.ndarray],
    points: dict[str, np.ndarray],
) -> Blend:
    """Lay out a leg, and add its joints and named points.

    Args:
        m: Measures.
        side: "left" or "right".
        sign: 1 for the left leg, -1 for the right.
        joints: Positions of joints [m] by name; the leg's are added.
        points: Named points near the surface [m]; the leg's are added.

    Returns:
        Solids of leg and foot.
    """
    size = m.stature / 1.756
    thigh, calf = m.thigh_girth / (2 * np.pi), m.calf_girth / (2 * np.pi)
    hip_half = compute_half_axes(m.hip_girth, 1.40)[0]
    x = max(0.50 * hip_half, 0.97 * thigh)
    foot = m.foot_length
    ankle_z = 0.285 * foot
    knee_z = ankle_z + 0.52 * (m.crotch_height - ankle_z) + 0.02 * size
    hip = np.array([sign * x * 0.98, 0.006 * size, m.crotch_height + 0.085 * size])
    knee = np.array([sign * x * 1.09, -0.004 * size, knee_z])
    ankle = np.array([sign * x * 1.17, 0.018 * size, ankle_z])
    heel_y = ankle[1] + 0.20 * foot
    ball = np.array([ankle[0] + sign * 0.02 * foot, heel_y - 0.73 * foot, 0.085 * foot])
    toe = np.array([ball[0], heel_y - 0.93 * foot, 0.065 * foot])
    bones = [f"{side}_{name}" for name in ("hip", "knee", "ankle", "toes")]
    joints |= dict(zip(bones, (hip, knee, ankle, ball), strict=True))
    on_hip, on_knee, on_ankle, on_toes = bones

    def between(a: np.ndarray, b: np.ndarray, share: float, back: float = 0.0) -> np.ndarray:
        return a + share * (b - a) + np.array([0, back * size, 0])

    mid_thigh, mid_calf = between(hip, knee, 0.45, -0.008), between(knee, ankle, 0.30, 0.016)
    heel = np.array([ankle[0], heel_y - 0.12 * foot, 0.11 * foot])
    sole = np.array([ankle[0], heel_y - 0.13 * foot, 0.10 * foot])
    instep = ankle - np.array([0, 0.02 * size, 0.05 * foot])
    up = np.array([0.0, 0.0, 1.0])
    leg = [
        Cone(on_hip, between(hip, knee, 0.10), mid_thigh, (thigh, 0.92 * thigh)),
        Cone(on_hip, mid_thigh, knee, (0.92 * thigh, 0.97 * calf)),
        Cone(on_knee, knee, mid_calf, (0.93 * calf, 1.0 * calf)),
        Cone(on_knee, mid_calf, between(knee, ankle, 0.95), (calf, 0.58 * calf)),
    ]
    low = [
        Cone(on_ankle, ankle, heel, (0.60 * calf, 0.125 * foot)),
        Cone(on_ankle, instep, ball, (0.58 * calf, 0.115 * foot)),
        Cone(on_ankle, sole, ball, (0.115 * foot, 0.13 * foot), 0.2, up),
        Cone(on_toes, ball, toe, (0.15 * foot, 0.115 * foot), 0.40, up),
    ]
    points[f"{side}_heel"] = np.array([ankle[0], heel_y, 0.08 * foot])
    points[f"{side}_toe_tip"] = np.array([toe[0], heel_y - foot, 0.06 * foot])
    points[f"{side}_knee_front"] = knee - np.array([0, calf, 0])
    return Blend(0.015 * size, [Blend(0.010 * size, leg), Blend(0.03 * size, low)])
