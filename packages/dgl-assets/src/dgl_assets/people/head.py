"""Head and neck of a body, with a hint of a face."""

from __future__ import annotations

import numpy as np

from dgl_assets.people.measures import PersonMeasures
from dgl_assets.people.solids import Blend, Cone, Ellipsoid, Solid


def make_head(
    m: PersonMeasures, joints: dict[str, np.ndarray], places: dict[str, np.ndarray]
) -> tuple[Blend, tuple[Ellipsoid, ...]]:
    """Lay out head and neck, and add their joints and places.

    Returns:
        Solids, and others that are pressed in: the hollows of the eyes.
    """
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
            start=base + np.array([sign * 0.32 * neck, 0, 0.014 * m.stature]),
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
