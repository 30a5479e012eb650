"""Arms and hands of a body."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from dgl_assets.people.measures import PersonMeasures
from dgl_assets.people.solids import Blend, Cone, Solid

# Of the hand's breadth: knuckles to the back (+), from the middle finger; of its length: knuckle, tip.
_FINGERS = {
    "index": (-0.29, 0.545, 0.945, -0.17),
    "middle": (-0.06, 0.555, 1.0, -0.05),
    "ring": (0.16, 0.54, 0.94, 0.09),
    "little": (0.37, 0.505, 0.79, 0.24),
}
_THUMB = ((0.10, -0.20), (0.32, -0.50), (0.47, -0.66), (0.62, -0.74))  # along, forward (breadths)


def make_arm(
    m: PersonMeasures,
    side: str,
    sign: float,
    frame: np.ndarray,
    joints: dict[str, np.ndarray],
    places: dict[str, np.ndarray],
) -> Blend:
    """Lay out an arm, and add its joints and places.

    Args:
        m: Measures.
        side: "left" or "right".
        sign: 1 for the left arm, -1 for the right.
        frame: Rotation from the hanging arm to the rest pose, shape (3, 3).
        joints: Places of joints [m] by name, of which the arm's are added.
        places: Points near the surface [m] by name, to which the arm's are added.

    Returns:
        Solids of arm and hand.
    """
    size = m.stature / 1.756
    upper, fore = m.upper_arm_girth / (2 * np.pi), m.forearm_girth / (2 * np.pi)
    wrist = 0.62 * fore
    # The joint is below and inside of the top of the shoulder.
    shoulder = np.array(
        [
            sign * (m.shoulder_breadth / 2 - 0.02 * size),
            0.018 * size,
            m.shoulder_height - 1.02 * upper,
        ]
    )
    to_wrist = m.arm_length - 0.03 * size
    to_elbow = 0.545 * to_wrist

    def at(down: float, forward: float = 0.0, inward: float = 0.0) -> np.ndarray:
        return shoulder + frame @ np.array([-sign * inward, -forward, -down])

    joints[f"{side}_clavicle"] = np.array(
        [sign * 0.08 * m.shoulder_breadth, -0.01 * size, m.shoulder_height - 0.05 * size]
    )
    joints[f"{side}_shoulder"] = shoulder
    joints[f"{side}_elbow"] = at(to_elbow)
    joints[f"{side}_wrist"] = at(to_wrist)
    bones = {k: f"{side}_{k}" for k in ("shoulder", "elbow", "wrist")}
    thin = frame @ np.array([1.0, 0, 0])
    limb = Blend(
        parts=(
            Cone(
                bone=bones["shoulder"],
                start=at(0.0),
                end=at(0.45 * to_elbow),
                radii=(1.04 * upper, 1.0 * upper),
            ),
            Cone(
                bone=bones["shoulder"],
                start=at(0.40 * to_elbow),
                end=at(to_elbow),
                radii=(1.0 * upper, 0.88 * fore),
            ),
            Cone(
                bone=bones["elbow"],
                start=at(to_elbow),
                end=at(to_elbow + 0.28 * (to_wrist - to_elbow)),
                radii=(0.88 * fore, 1.0 * fore),
            ),
            Cone(
                bone=bones["elbow"],
                start=at(to_elbow + 0.28 * (to_wrist - to_elbow)),
                end=at(to_wrist),
                radii=(fore, wrist),
                flatness=0.12,
                thin=thin,
            ),
        ),
        radius=0.008 * size,
    )
    hand = _make_hand(
        m,
        side,
        lambda down, *rest: at(to_wrist + down, *rest),
        thin=thin,
        wrist=wrist,
        joints=joints,
        places=places,
    )
    places[f"{side}_acromion"] = np.array(
        [sign * m.shoulder_breadth / 2, shoulder[1], m.shoulder_height]
    )
    places[f"{side}_elbow_tip"] = at(to_elbow, -fore)
    for name, forward, inward in (
        ("thumb_side", 1, 0),
        ("little_side", -1, 0),
        ("palm", 0, 1),
        ("back", 0, -1),
    ):
        places[f"{side}_wrist_{name}"] = at(to_wrist, forward * wrist, inward * wrist)
    return Blend(parts=(limb, hand), radius=0.02 * size)


def _make_hand(
    m: PersonMeasures,
    side: str,
    at: Callable[..., np.ndarray],
    *,
    thin: np.ndarray,
    wrist: float,
    joints: dict[str, np.ndarray],
    places: dict[str, np.ndarray],
) -> Blend:
    """Lay out a hand; `at` gives points from the wrist: down, to the thumb, out of the palm [m]."""
    length, breadth = m.hand_length, m.hand_breadth
    thick = 0.100 * breadth  # radius of fingers
    palm: list[Solid] = []
    fingers: list[Blend] = []
    bone = f"{side}_wrist"
    for finger, (back, knuckle, tip, fan) in _FINGERS.items():
        radius = thick * (0.86 if finger == "little" else 1.0)
        start = at(0.04 * length, -0.55 * back * breadth)
        base = at(knuckle * length, -back * breadth)
        palm.append(
            Cone(
                bone=bone,
                start=start,
                end=base,
                radii=(1.25 * thick, 1.22 * radius),
                flatness=0.05,
                thin=thin,
            )
        )
        reach = (tip - knuckle) * length - 0.8 * radius
        points = [
            at(
                knuckle * length + s * reach * np.cos(fan),
                -back * breadth - s * reach * np.sin(fan),
            )
            for s in (0.0, 0.46, 0.75, 1.0)
        ]
        radii = (1.1 * radius, 1.02 * radius, 0.93 * radius, 0.80 * radius)
        names = [f"{side}_{finger}{k}" for k in (1, 2, 3)]
        for k, name in enumerate(names):
            joints[name] = points[k]
        fingers.append(
            Blend(
                parts=tuple(
                    Cone(
                        bone=name,
                        start=points[k],
                        end=points[k + 1],
                        radii=(radii[k], radii[k + 1]),
                    )
                    for k, name in enumerate(names)
                ),
                radius=0.3 * thick,
            )
        )
        places[f"{side}_{finger}_tip"] = (
            points[-1]
            + (points[-1] - points[-2]) / np.linalg.norm(points[-1] - points[-2]) * radii[-1]
        )
        places[f"{side}_{finger}_knuckle"] = at(knuckle * length, -back * breadth, -1.2 * radius)
    points = [
        at(down * length, -forward * breadth, 0.10 * breadth * (k > 0))
        for k, (down, forward) in enumerate(_THUMB)
    ]
    names = [f"{side}_thumb{k}" for k in (1, 2, 3)]
    radii = (1.7 * thick, 1.28 * thick, 1.12 * thick, 0.86 * thick)
    for k, name in enumerate(names):
        joints[name] = points[k]
    thumb = Blend(
        parts=tuple(
            Cone(bone=name, start=points[k], end=points[k + 1], radii=(radii[k], radii[k + 1]))
            for k, name in enumerate(names)
        ),
        radius=0.5 * thick,
    )
    places[f"{side}_thumb_tip"] = (
        points[-1] + (points[-1] - points[-2]) / np.linalg.norm(points[-1] - points[-2]) * radii[-1]
    )
    places[f"{side}_palm_centre"] = at(0.32 * length, 0.0, 1.25 * thick)
    places[f"{side}_hand_back"] = at(0.32 * length, 0.0, -1.25 * thick)
    root = Cone(
        bone=bone,
        start=at(-0.05 * length),
        end=at(0.10 * length),
        radii=(wrist, 0.95 * wrist),
        flatness=0.15,
        thin=thin,
    )
    flesh = Blend(parts=(root, *palm), radius=0.9 * thick)
    whole = Blend(parts=(flesh, thumb), radius=1.1 * thick)
    return Blend(parts=(whole, *fingers), radius=0.3 * thick)
