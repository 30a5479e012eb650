"""Layouts for declarations: cameras, bases of the robots, a hanger, and the slope of a drop."""

import numpy as np

from dgl_assets.props import HatStandParameters, PersonParameters
from dgl_assets.robots import BasePlacement
from dgl_physics.drawing.camera import Vector3
from dgl_tasks.cameras import CameraPlacement, look_at
from dgl_tasks.declaration import Range, SceneObject

STEEP: Range = (float(np.radians(65)), float(np.radians(80)))
"""Slope of a garment that lands crumpled [rad] (paper)."""


def _film_from(eye: Vector3, towards: Vector3) -> CameraPlacement:
    """Place the camera for people [m]."""
    return CameraPlacement(
        name="video_camera",
        position=eye,
        euler_deg=look_at(eye, towards),
        horizontal_fov=float(np.radians(51.5)),
    )


FOLD_CAMERAS: dict[str, CameraPlacement] = {
    "garment_camera": CameraPlacement(
        name="garment_camera", position=(0.0, 1.0, 6.75), euler_deg=(0, 90, 90)
    ),
    "environment_camera": CameraPlacement(
        name="environment_camera",
        position=(0.0, 4.0, 6.0),
        euler_deg=(0, 60, -90),
    ),
    # just wide enough for both parked arms, whose hands point outwards
    "video_camera": _film_from((1.37, 2.36, 2.21), (-0.09, 0.04, 0.30)),
}
"""Cameras for folds; the first two as in the original, the third for people."""

FLING_CAMERAS: dict[str, CameraPlacement] = FOLD_CAMERAS | {
    "environment_camera": CameraPlacement(
        name="environment_camera", position=(0.0, 5.0, 8.0), euler_deg=(0, 60, -90)
    )
}
"""Cameras for flings, hangs and hats, which reach higher and farther."""

HANG_LEFT_BASE: BasePlacement = (-0.8, 0.0, 0.6, 0.0)
HANG_RIGHT_BASE: BasePlacement = (0.8, 0.0, 0.6, 0.0)
"""Bases for hanging (original code)."""

HANGER = SceneObject(
    name="hanger",
    prop="hanger",
    position=(0.0, 0.85, 0.0),
    x_range=(-0.15, 0.15),
    y_range=(-0.05, 0.05),
    friction=1.0,
)
"""Bar for tops, dresses and trousers (original code, but for the friction)."""

HOOK_CAMERAS: dict[str, CameraPlacement] = FLING_CAMERAS | {
    "video_camera": _film_from((2.1, 1.9, 1.9), (-0.1, 0.3, 0.4))
}
"""Cameras for hanging before a post, which the video camera looks past."""

WEAR_LEFT_BASE: BasePlacement = (-0.6, 0.0, 0.5, 0.0)
WEAR_RIGHT_BASE: BasePlacement = (0.6, 0.0, 0.5, 0.0)
"""Bases for hats (original code)."""

WEAR_CAMERAS: dict[str, CameraPlacement] = FLING_CAMERAS | {
    "video_camera": _film_from((1.7, 0.35, 1.75), (-0.1, 0.75, 0.85))
}
"""Cameras for wearing; the video camera shows the way from the stand to the head."""

HAT_STAND = SceneObject(
    name="stand",
    prop=HatStandParameters(foot_radius=0.08),
    position=(0.0, 0.75, 0.0),
    x_range=(-0.1, 0.1),
    y_range=(-0.07, 0.07),
    solid_to="garment",
)
"""Stand that hats are taken from."""

PERSON = SceneObject(
    name="person",
    prop=tuple(
        PersonParameters(measures=measures, scale=scale)
        for measures, scale in (
            ("woman", 0.75),
            ("woman", 0.72),
            ("slim_woman", 0.78),
            ("heavy_woman", 0.75),
            ("man", 0.7),
            ("slim_man", 0.73),
            ("heavy_man", 0.71),
        )
    ),
    position=(0.0, 1.15, 0.0),
    x_range=(-0.15, 0.15),
    y_range=(-0.05, 0.05),
    yaw_range=(-float(np.radians(15)), float(np.radians(15))),
    avoided=True,
)
"""Somebody of another build, size and direction in each episode, who faces the robots; garments of
this package fit their heads."""

STORE_LEFT_BASE: BasePlacement = (-0.9, 0.0, 0.5, 0.0)
STORE_RIGHT_BASE: BasePlacement = (0.9, 0.0, 0.5, 0.0)
"""Bases for storing (original code)."""

STORE_CAMERAS: dict[str, CameraPlacement] = FLING_CAMERAS | {
    "video_camera": _film_from((1.55, 2.85, 2.3), (-0.05, 0.3, 0.2))
}
"""Cameras for storing; the video camera shows the whole platform."""
