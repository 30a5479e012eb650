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
    places: dict[str, np.ndarray],
) -> Blend:
    """Lay out a leg, and add its joints and places; sign is 1 for the left leg, -1 for the right."""
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
    joints[f"{side}_hip"], joints[f"{side}_knee"], joints[f"{side}_ankle"] = hip, knee, ankle
    heel_y = ankle[1] + 0.20 * foot
    ball = np.array([ankle[0] + sign * 0.02 * foot, heel_y - 0.73 * foot, 0.085 * foot])
    toe = np.array([ball[0], heel_y - 0.93 * foot, 0.065 * foot])
    joints[f"{side}_toes"] = ball
    bones = {k: f"{side}_{k}" for k in ("hip", "knee", "ankle", "toes")}

    def between(a: np.ndarray, b: np.ndarray, share: float, back: float = 0.0) -> np.ndarray:
        return a + share * (b - a) + np.array([0, back * size, 0])

    up = np.array([0.0, 0.0, 1.0])
    leg = Blend(
        parts=(
            Cone(
                bone=bones["hip"],
                start=between(hip, knee, 0.10),
                end=between(hip, knee, 0.45, -0.008),
                radii=(thigh, 0.92 * thigh),
            ),
            Cone(
                bone=bones["hip"],
                start=between(hip, knee, 0.45, -0.008),
                end=knee,
                radii=(0.92 * thigh, 0.97 * calf),
            ),
            Cone(
                bone=bones["knee"],
                start=knee,
                end=between(knee, ankle, 0.30, 0.016),
                radii=(0.93 * calf, 1.0 * calf),
            ),
            Cone(
                bone=bones["knee"],
                start=between(knee, ankle, 0.30, 0.016),
                end=between(knee, ankle, 0.95),
                radii=(calf, 0.58 * calf),
            ),
        ),
        radius=0.010 * size,
    )
    low = Blend(
        parts=(
            Cone(
                bone=bones["ankle"],
                start=ankle,
                end=np.array([ankle[0], heel_y - 0.12 * foot, 0.11 * foot]),
                radii=(0.60 * calf, 0.125 * foot),
            ),
            Cone(
                bone=bones["ankle"],
                start=ankle - np.array([0, 0.02 * size, 0.05 * foot]),
                end=ball,
                radii=(0.58 * calf, 0.115 * foot),
            ),
            Cone(
                bone=bones["ankle"],
                start=np.array([ankle[0], heel_y - 0.13 * foot, 0.10 * foot]),
                end=ball,
                radii=(0.115 * foot, 0.13 * foot),
                flatness=0.2,
                thin=up,
            ),
            Cone(
                bone=bones["toes"],
                start=ball,
                end=toe,
                radii=(0.15 * foot, 0.115 * foot),
                flatness=0.40,
                thin=up,
            ),
        ),
        radius=0.03 * size,
    )
    places[f"{side}_heel"] = np.array([ankle[0], heel_y, 0.08 * foot])
    places[f"{side}_toe_tip"] = np.array([toe[0], heel_y - foot, 0.06 * foot])
    places[f"{side}_knee_front"] = knee - np.array([0, calf, 0])
    return Blend(parts=(leg, low), radius=0.015 * size)
