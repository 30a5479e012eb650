"""Arms and hands of a body."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from dgl_assets.people.measures import PersonMeasures
from dgl_assets.people.solids import Blend, Cone, chain

_FINGERS = {
    "index": (-0.29, 0.545, 0.945, -0.17),
    "middle": (-0.06, 0.555, 1.0, -0.05),
    "ring": (0.16, 0.54, 0.94, 0.09),
    "little": (0.37, 0.505, 0.79, 0.24),
}
"""By finger: knuckle behind the middle of the hand (shares of its breadth), knuckle and tip from
the wrist (shares of its length), and the angle by which the finger fans out [rad]."""
_THUMB = ((0.10, -0.20), (0.32, -0.50), (0.47, -0.66), (0.62, -0.74))  # along, forward (breadths)


def make_arm(
    m: PersonMeasures,
    side: str,
    sign: float,
    frame: np.ndarray,
    joints: dict[str, np.ndarray],
    points: dict[str, np.ndarray],
) -> Blend:
    """Lay out an arm, and add its joints and named points.

    Args:
        m: Measures.
        side: "left" or "right".
        sign: 1 for the left arm, -1 for the right.
        frame: Rotation from the hanging arm to the rest pose, shape (3, 3).
        joints: Positions of joints [m] by name; the arm's are added.
        points: Named points near the surface [m]; the arm's are added.

    Returns:
        Solids of arm and hand.
    """
    size = m.stature / 1.756
    upper, fore = m.upper_arm_girth / (2 * np.pi), m.forearm_girth / (2 * np.pi)
    wrist = 0.62 * fore
    half = m.shoulder_breadth / 2
    # The joint is below and inside of the top of the shoulder.
    shoulder = np.array(
        [sign * (half - 0.02 * size), 0.018 * size, m.shoulder_height - 1.02 * upper]
    )
    to_wrist = m.arm_length - 0.03 * size
    to_elbow = 0.545 * to_wrist

    def at(down: float, forward: float = 0.0, inward: float = 0.0) -> np.ndarray:
        return shoulder + frame @ np.array([-sign * inward, -forward, -down])

    joints[f"{side}_clavicle"] = np.array(
        [sign * 0.08 * m.shoulder_breadth, -0.01 * size, m.shoulder_height - 0.05 * size]
    )
    bones = [f"{side}_{name}" for name in ("shoulder", "elbow", "wrist")]
    joints |= dict(zip(bones, (shoulder, at(to_elbow), at(to_wrist)), strict=True))
    on_shoulder, on_elbow, _ = bones
    thin = frame @ np.array([1.0, 0, 0])
    thickest = at(to_elbow + 0.28 * (to_wrist - to_elbow))
    limb = [
        Cone(on_shoulder, at(0.0), at(0.45 * to_elbow), (1.04 * upper, 1.0 * upper)),
        Cone(on_shoulder, at(0.40 * to_elbow), at(to_elbow), (1.0 * upper, 0.88 * fore)),
        Cone(on_elbow, at(to_elbow), thickest, (0.88 * fore, 1.0 * fore)),
        Cone(on_elbow, thickest, at(to_wrist), (fore, wrist), 0.12, thin),
    ]

    def from_wrist(down: float, *rest: float) -> np.ndarray:
        return at(to_wrist + down, *rest)

    hand = _make_hand(m, side, from_wrist, thin, wrist, joints, points)
    points[f"{side}_acromion"] = np.array([sign * half, shoulder[1], m.shoulder_height])
    points[f"{side}_elbow_tip"] = at(to_elbow, -fore)
    for name, forward, inward in (
        ("thumb_side", 1, 0),
        ("little_side", -1, 0),
        ("palm", 0, 1),
        ("back", 0, -1),
    ):
        points[f"{side}_wrist_{name}"] = at(to_wrist, forward * wrist, inward * wrist)
    return Blend(0.02 * size, [Blend(0.008 * size, limb), hand])


def _make_hand(
    m: PersonMeasures,
    side: str,
    at: Callable[..., np.ndarray],
    thin: np.ndarray,
    wrist: float,
    joints: dict[str, np.ndarray],
    points: dict[str, np.ndarray],
) -> Blend:
    """Lay out a hand.

    Args:
        m: Measures.
        side: "left" or "right".
        at: Gives points from the wrist: down, towards the thumb, out of the palm [m].
        thin: Direction across the palm, shape (3,).
        wrist: Radius of the wrist [m].
        joints: As for `make_arm`.
        points: As for `make_arm`.
    """
    length, breadth = m.hand_length, m.hand_breadth
    thick = 0.100 * breadth  # radius of fingers
    bone = f"{side}_wrist"

    def add_digit(digit: str, line: list[np.ndarray], radii: list[float], blend: float) -> Blend:
        names = [f"{side}_{digit}{k}" for k in (1, 2, 3)]
        joints.update(zip(names, line[:3], strict=True))
        last = line[-1] - line[-2]
        points[f"{side}_{digit}_tip"] = line[-1] + last / np.linalg.norm(last) * radii[-1]
        return chain(names, line, radii, blend)

    flesh = [Cone(bone, at(-0.05 * length), at(0.10 * length), (wrist, 0.95 * wrist), 0.15, thin)]
    fingers: list[Blend] = []
    for finger, (back, knuckle, tip, fan) in _FINGERS.items():
        radius = thick * (0.86 if finger == "little" else 1.0)
        start = at(0.04 * length, -0.55 * back * breadth)
        base = at(knuckle * length, -back * breadth)
        flesh.append(Cone(bone, start, base, (1.25 * thick, 1.22 * radius), 0.05, thin))
        reach = (tip - knuckle) * length - 0.8 * radius
        line = [
            at(
                knuckle * length + s * reach * np.cos(fan),
                -back * breadth - s * reach * np.sin(fan),
            )
            for s in (0.0, 0.46, 0.75, 1.0)
        ]
        radii = [1.1 * radius, 1.02 * radius, 0.93 * radius, 0.80 * radius]
        fingers.append(add_digit(finger, line, radii, 0.3 * thick))
        points[f"{side}_{finger}_knuckle"] = at(knuckle * length, -back * breadth, -1.2 * radius)
    line = [
        at(down * length, -forward * breadth, 0.10 * breadth * (k > 0))
        for k, (down, forward) in enumerate(_THUMB)
    ]
    radii = [1.7 * thick, 1.28 * thick, 1.12 * thick, 0.86 * thick]
    thumb = add_digit("thumb", line, radii, 0.5 * thick)
    points[f"{side}_palm_centre"] = at(0.32 * length, 0.0, 1.25 * thick)
    points[f"{side}_hand_back"] = at(0.32 * length, 0.0, -1.25 * thick)
    whole = Blend(1.1 * thick, [Blend(0.9 * thick, flesh), thumb])
    return Blend(0.3 * thick, [whole, *fingers])
