"""Head and neck of a body, with a hint of a face."""

from __future__ import annotations

import numpy as np

from dgl_assets.people.measures import PersonMeasures
from dgl_assets.people.solids import Blend, Cone, Ellipsoid, Solid


def make_head(
    m: PersonMeasures, joints: dict[str, np.ndarray], points: dict[str, np.ndarray]
) -> tuple[Blend, tuple[Ellipsoid, ...]]:
    """Lay out head and neck, and add their joints and named points.

    Returns:
        Solids, and the hollows of the eyes, which are pressed in.
    """
    # Shares of the girth of the head: breadth 0.268, length 0.345, height 0.41.
    half, length, height = 0.134 * m.head_girth, 0.345 * m.head_girth, 0.40 * m.head_girth
    top = m.stature
    y = -0.012 * m.stature / 1.756  # the head is carried forward
    neck = m.neck_girth / (2 * np.pi)

    def at(forward: float, down: float, side: float = 0.0) -> np.ndarray:
        return np.array([side * half, y - forward * length, top - down * height])

    def ball(centre: np.ndarray, *radii: float) -> Ellipsoid:
        return Ellipsoid("head", centre, np.array(radii))

    def bar(start: np.ndarray, end: np.ndarray, *radii: float) -> Cone:
        return Cone("head", start, end, (radii[0] * half, radii[1] * half))

    base = joints["neck"]
    skull = at(-0.12, 0.62)
    joints["head"] = np.array([0.0, skull[1] - 0.12 * length, top - 0.72 * height])
    parts: list[Solid] = [
        ball(at(-0.02, 0.385), half, 0.5 * length, 0.385 * height),
        ball(at(0.155, 0.63), 0.78 * half, 0.315 * length, 0.335 * height),
        bar(at(0.12, 0.84), at(0.345, 0.915), 0.52, 0.25),
        bar(at(0.10, 0.80, 0.45), at(0.32, 0.90, 0.16), 0.32, 0.26),
        bar(at(0.10, 0.80, -0.45), at(0.32, 0.90, -0.16), 0.32, 0.26),
    ]
    detail = [  # nose, brows, lips
        bar(at(0.415, 0.46), at(0.535, 0.655), 0.10, 0.165),
        bar(at(0.40, 0.425, 0.38), at(0.40, 0.425, -0.38), 0.13, 0.13),
        bar(at(0.435, 0.775, 0.16), at(0.435, 0.775, -0.16), 0.11, 0.11),
    ]
    eyes = []
    for sign in (1.0, -1.0):
        ear = at(-0.06, 0.575, sign * 0.98)
        parts.append(ball(ear, 0.13 * half, 0.085 * length, 0.125 * height))
        eye = at(0.485, 0.50, sign * 0.43)
        eyes.append(ball(eye, 0.24 * half, 0.055 * length, 0.055 * height))
    low, high = base, at(-0.04, 0.86)
    throat = [
        Cone("neck", base - [0, 0, 0.02 * m.stature], at(-0.04, 0.78), (0.96 * neck, 0.93 * neck))
    ]
    for side, sign in (("left", 1.0), ("right", -1.0)):  # from the neck to the shoulders
        start = base + np.array([sign * 0.32 * neck, 0, 0.014 * m.stature])
        end = [sign * 0.43 * m.shoulder_breadth, base[1], m.shoulder_height - 0.030 * m.stature]
        radii = (0.55 * neck, 0.60 * neck)
        throat.append(Cone(f"{side}_clavicle", start, np.array(end), radii))
    points |= {
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
    middle = low + 0.55 * (high - low)
    for name, direction in (
        ("front", [0, -1, 0]),
        ("back", [0, 1, 0]),
        ("left", [1, 0, 0]),
        ("right", [-1, 0, 0]),
    ):
        points[f"neck_{name}"] = middle + neck * np.array(direction)
    size = m.head_girth / 0.574
    face = Blend(0.016 * size, [Blend(0.022 * size, parts), *detail])
    return Blend(0.03 * size, [face, Blend(0.03 * size, throat)]), tuple(eyes)
