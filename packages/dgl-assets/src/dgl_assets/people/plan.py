"""Where joints are, and what solids a body is blended from, given its measures.

Person frame: standing on z = 0, facing -y, the left hand towards +x. In the rest pose the arms are held away from the trunk
by `REST_ABDUCTION`, fingers straight, palms towards the trunk, thumbs to the front.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation

from dgl_assets.people.measures import PersonMeasures
from dgl_assets.people.skeleton import REST_ABDUCTION, Skeleton, make_joints
from dgl_assets.people.solids import Blend, Cone, Ellipsoid, Loft, Solid

# Of the hand's breadth: knuckles to the back (+), from the middle finger; of its length: knuckle, tip.
_FINGERS = {
    "index": (-0.29, 0.545, 0.945, -0.17),
    "middle": (-0.06, 0.555, 1.0, -0.05),
    "ring": (0.16, 0.54, 0.94, 0.09),
    "little": (0.37, 0.505, 0.79, 0.24),
}
_THUMB = ((0.10, -0.20), (0.32, -0.50), (0.47, -0.66), (0.62, -0.74))  # along, forward (breadths)


@dataclass(frozen=True, kw_only=True, eq=False)
class Plan:
    """Joints, solids and named places of a body in the rest pose.

    Attributes:
        skeleton: Joints.
        body: Solids.
        carving: Solids that are cut out with rounded edges.
        places: Points near the surface [m] by name, to find landmarks, each of shape (3,).
        arm_frames: Rotation from hanging arms to the rest pose by side.
        scale: Stature over that of a man: how coarse a mesh may be.
    """

    skeleton: Skeleton
    body: Blend
    carving: tuple[Ellipsoid, ...]
    places: dict[str, np.ndarray] = field(default_factory=dict)
    arm_frames: dict[str, np.ndarray] = field(default_factory=dict)
    scale: float = 1.0


def make_plan(m: PersonMeasures) -> Plan:
    """Lay out a body.

    Args:
        m: Measures.

    Returns:
        The plan.

    Source:
        Sections and ratios that the measures do not give are drawn by eye after artists' mannequins.
    """
    joints: dict[str, np.ndarray] = {}
    places: dict[str, np.ndarray] = {}
    trunk = _make_trunk(m, joints, places)
    head, carving = _make_head(m, joints, places)
    arms, frames, legs = [], {}, []
    for side, sign in (("left", 1.0), ("right", -1.0)):
        frames[side] = Rotation.from_rotvec([0, -sign * REST_ABDUCTION, 0]).as_matrix()
        arms.append(_make_arm(m, side, sign, frames[side], joints, places))
        legs.append(_make_leg(m, side, sign, joints, places))
    size = m.stature / 1.756
    lower = Blend(parts=(trunk, Blend(parts=tuple(legs), radius=0.012 * size)), radius=0.03 * size)
    body = Blend(parts=(Blend(parts=(lower, *arms), radius=0.035 * size), head), radius=0.03 * size)

    made = make_joints()
    hanging = {"elbow", "wrist", *(f"{f}{k}" for f in ("thumb", *_FINGERS) for k in (1, 2, 3))}
    turned = [
        frames[joint.name.split("_")[0]] if joint.name.split("_")[-1] in hanging else np.eye(3)
        for joint in made
    ]
    skeleton = Skeleton(
        joints=made,
        positions=np.stack([joints[joint.name] for joint in made]),
        frames=np.stack(turned),
    )
    return Plan(
        skeleton=skeleton, body=body, carving=carving, places=places, arm_frames=frames, scale=size
    )


def _half_axes(girth: float, ratio: float) -> tuple[float, float]:
    """Half width and half depth of a superellipse of some girth."""
    turn = np.arange(360) * (2 * np.pi / 360)
    n = 2.3
    radius = ((np.abs(np.cos(turn))) ** n + (np.abs(np.sin(turn)) * ratio) ** n) ** (-1 / n)
    points = radius[:, None] * np.column_stack([np.cos(turn), np.sin(turn)])
    length = np.linalg.norm(np.roll(points, -1, axis=0) - points, axis=1).sum()
    return girth / length, girth / length / ratio


def _make_trunk(
    m: PersonMeasures, joints: dict[str, np.ndarray], places: dict[str, np.ndarray]
) -> Blend:
    low, high = m.crotch_height, m.shoulder_height
    size = m.stature / 1.756

    def at(share: float) -> float:
        return low + share * (high - low)

    hip, waist = _half_axes(m.hip_girth, 1.40), _half_axes(m.waist_girth, 1.32)
    chest = _half_axes(m.chest_girth * (0.97 - 0.05 * m.bust), 1.42)
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
    width, depth, centre = (_smooth(fine, share, values) for values in (width, depth, centre))
    loft = Loft(
        bones=("pelvis", "spine", "chest"),
        borders=(at(0.34), at(0.60)),
        heights=low + fine * (high - low),
        half_widths=width,
        half_depths=depth,
        centres=centre * size,
    )
    parts: list[Solid] = [loft]
    for sign in (1.0, -1.0):
        seat = np.array([sign * 0.46 * hip[0], 0.42 * hip[1], at(0.08)])
        parts.append(
            Ellipsoid(bone="pelvis", centre=seat, radii=np.array([0.44, 0.62, 0.62]) * hip[1])
        )
        if m.bust > 0.05:
            centre_y = -0.66 * chest[1]
            breast = np.array([sign * 0.47 * chest[0], centre_y, at(0.70)])
            radius = m.bust**0.5 * 0.44 * chest[1]
            parts.append(
                Ellipsoid(bone="chest", centre=breast, radii=radius * np.array([1.08, 1.05, 1.0]))
            )
        else:
            breast = np.array([sign * 0.42 * chest[0], -0.62 * chest[1], at(0.76)])
            parts.append(
                Ellipsoid(
                    bone="chest", centre=breast, radii=np.array([0.50, 0.36, 0.42]) * chest[1]
                )
            )
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
        places[name] = np.array([0.0, y * depth_here, at(level)])
    return Blend(parts=tuple(parts), radius=0.03 * size)


def _smooth(fine: np.ndarray, share: np.ndarray, values: np.ndarray) -> np.ndarray:
    from scipy.interpolate import PchipInterpolator

    return PchipInterpolator(share, values)(fine)


def _make_head(
    m: PersonMeasures, joints: dict[str, np.ndarray], places: dict[str, np.ndarray]
) -> tuple[Blend, tuple[Ellipsoid, ...]]:
    # Breadth and length of the head follow from its girth: 0.268 and 0.345 of it; its height is 0.41.
    half, length, height = 0.134 * m.head_girth, 0.345 * m.head_girth, 0.40 * m.head_girth
    top = m.stature
    y = -0.012 * m.stature / 1.756  # the head is carried forward
    neck = m.neck_girth / (2 * np.pi)

    def at(forward: float, down: float, side: float = 0.0) -> np.ndarray:
        return np.array([side * half, y - forward * length, top - down * height])

    base = joints["neck"]
    skull = at(-0.12, 0.62)
    joints["head"] = np.array([0.0, skull[1] - 0.12 * length, top - 0.72 * height])
    parts: list[Solid] = [
        Ellipsoid(
            bone="head",
            centre=at(-0.02, 0.385),
            radii=np.array([half, 0.5 * length, 0.385 * height]),
        ),
        Ellipsoid(
            bone="head",
            centre=at(0.155, 0.63),
            radii=np.array([0.78 * half, 0.315 * length, 0.335 * height]),
        ),
        Cone(
            bone="head",
            start=at(0.12, 0.84),
            end=at(0.345, 0.915),
            radii=(0.52 * half, 0.25 * half),
        ),
        Cone(
            bone="head",
            start=at(0.10, 0.80, 0.45),
            end=at(0.32, 0.90, 0.16),
            radii=(0.32 * half, 0.26 * half),
        ),
        Cone(
            bone="head",
            start=at(0.10, 0.80, -0.45),
            end=at(0.32, 0.90, -0.16),
            radii=(0.32 * half, 0.26 * half),
        ),
    ]
    detail: list[Solid] = [
        Cone(
            bone="head",
            start=at(0.415, 0.46),
            end=at(0.535, 0.655),
            radii=(0.10 * half, 0.165 * half),
        ),
        Cone(
            bone="head",
            start=at(0.40, 0.425, 0.38),
            end=at(0.40, 0.425, -0.38),
            radii=(0.13 * half, 0.13 * half),
        ),
        Cone(
            bone="head",
            start=at(0.435, 0.775, 0.16),
            end=at(0.435, 0.775, -0.16),
            radii=(0.11 * half, 0.11 * half),
        ),
    ]
    carving = []
    for sign in (1.0, -1.0):
        parts.append(
            Ellipsoid(
                bone="head",
                centre=at(-0.06, 0.575, sign * 0.98),
                radii=np.array([0.13 * half, 0.085 * length, 0.125 * height]),
            )
        )
        carving.append(
            Ellipsoid(
                bone="head",
                centre=at(0.485, 0.50, sign * 0.43),
                radii=np.array([0.24 * half, 0.055 * length, 0.055 * height]),
            )
        )
    throat = Cone(
        bone="neck",
        start=base - [0, 0, 0.02 * m.stature],
        end=at(-0.04, 0.78),
        radii=(0.96 * neck, 0.93 * neck),
    )
    collar = [  # from the neck to the shoulders
        Cone(
            bone=f"{side}_clavicle",
            start=base + [sign * 0.32 * neck, 0, 0.014 * m.stature],
            end=np.array(
                [sign * 0.43 * m.shoulder_breadth, base[1], m.shoulder_height - 0.030 * m.stature]
            ),
            radii=(0.55 * neck, 0.60 * neck),
        )
        for side, sign in (("left", 1.0), ("right", -1.0))
    ]
    places |= {
        "head_top": at(-0.02, 0.0),
        "brow": at(0.5, 0.40),
        "occiput": at(-0.52, 0.42),
        "left_temple": at(0.0, 0.40, 1.0),
        "right_temple": at(0.0, 0.40, -1.0),
        "left_ear": at(-0.06, 0.575, 1.1),
        "right_ear": at(-0.06, 0.575, -1.1),
        "nose_tip": at(0.56, 0.65),
        "chin": at(0.42, 0.98),
    }
    low, high = base, at(-0.04, 0.86)
    middle = base + 0.55 * (high - low)
    for name, direction in (
        ("front", [0, -1, 0]),
        ("back", [0, 1, 0]),
        ("left", [1, 0, 0]),
        ("right", [-1, 0, 0]),
    ):
        places[f"neck_{name}"] = middle + neck * np.array(direction)
    size = m.head_girth / 0.574
    face = Blend(parts=tuple(parts), radius=0.022 * size)
    whole = Blend(parts=(face, *detail), radius=0.016 * size)
    return Blend(
        parts=(whole, Blend(parts=(throat, *collar), radius=0.03 * size)), radius=0.03 * size
    ), tuple(carving)


def _make_arm(
    m: PersonMeasures,
    side: str,
    sign: float,
    frame: np.ndarray,
    joints: dict[str, np.ndarray],
    places: dict[str, np.ndarray],
) -> Blend:
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
    hand = _make_hand(m, side, lambda *a: at(to_wrist + a[0], *a[1:]), thin, wrist, joints, places)
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


def _make_hand(m, side, at, thin, wrist, joints, places) -> Blend:  # noqa: ANN001
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
                    Cone(bone=name, start=points[k], end=points[k + 1], radii=radii[k : k + 2])
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
            Cone(bone=name, start=points[k], end=points[k + 1], radii=radii[k : k + 2])
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


def _make_leg(
    m: PersonMeasures,
    side: str,
    sign: float,
    joints: dict[str, np.ndarray],
    places: dict[str, np.ndarray],
) -> Blend:
    size = m.stature / 1.756
    thigh, calf = m.thigh_girth / (2 * np.pi), m.calf_girth / (2 * np.pi)
    hip_half = _half_axes(m.hip_girth, 1.40)[0]
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
                start=ankle + [0, -0.02 * size, -0.05 * foot],
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
    places[f"{side}_knee_front"] = knee + [0, -calf, 0]
    return Blend(parts=(leg, low), radius=0.015 * size)
