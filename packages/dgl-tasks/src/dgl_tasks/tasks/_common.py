"""What several tasks share: cameras, and how steeply a garment falls that is to lie in a heap."""

import numpy as np

from dgl_assets.robots import BasePlacement
from dgl_tasks.cameras import CameraPlacement, Vector3, look_at
from dgl_tasks.declaration import Range

STEEP: Range = (float(np.radians(65)), float(np.radians(80)))
"""Range of the tilt of a garment that lands in a heap [rad] (paper)."""

_VIDEO_EYE: Vector3 = (1.37, 2.36, 2.21)
FOLD_CAMERAS: dict[str, CameraPlacement] = {
    "garment_camera": CameraPlacement(
        name="garment_camera", position=(0.0, 1.0, 6.75), euler_deg=(0, 90, 90)
    ),
    "environment_camera": CameraPlacement(
        name="environment_camera",
        position=(0.0, 4.0, 6.0),
        euler_deg=(0, 60, -90),
    ),
    "video_camera": CameraPlacement(
        name="video_camera",
        position=_VIDEO_EYE,
        # Just wide enough for both parked arms, whose hands point outwards.
        euler_deg=look_at(_VIDEO_EYE, (-0.09, 0.04, 0.30)),
        horizontal_fov=float(np.radians(51.5)),
    ),
}
"""Cameras of the folding tasks; the first two as in the original, the third for people."""

FLING_CAMERAS: dict[str, CameraPlacement] = FOLD_CAMERAS | {
    "environment_camera": CameraPlacement(
        name="environment_camera", position=(0.0, 5.0, 8.0), euler_deg=(0, 60, -90)
    )
}
"""Cameras of the flinging tasks, which reach higher and farther; as `FOLD_CAMERAS`."""

HANG_LEFT_BASE: BasePlacement = (-0.8, 0.0, 0.6, 0.0)
HANG_RIGHT_BASE: BasePlacement = (0.8, 0.0, 0.6, 0.0)
"""Where the robots stand to hang something (original code)."""

HANG_CAMERAS: dict[str, CameraPlacement] = FLING_CAMERAS
"""Cameras of the hanging tasks, which reach as high and as far as flings."""

WEAR_LEFT_BASE: BasePlacement = (-0.6, 0.0, 0.5, 0.0)
WEAR_RIGHT_BASE: BasePlacement = (0.6, 0.0, 0.5, 0.0)
"""Where the robots stand to put a hat on (original code)."""

WEAR_CAMERAS: dict[str, CameraPlacement] = FLING_CAMERAS
"""Cameras of the hats' tasks, which reach as high as flings."""
