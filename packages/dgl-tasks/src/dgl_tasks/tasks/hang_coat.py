"""Hang Coat: over a hook on a post, held beside the neck."""

import numpy as np

from dgl_tasks.declaration import HandFriction, SceneObject, Start, Task
from dgl_tasks.layouts import HANG_LEFT_BASE, HANG_RIGHT_BASE, HOOK_CAMERAS
from dgl_tasks.success import HangsOver

TASK = Task(
    id="HangCoat-v1",
    title="Hang Coat",
    category="Tops_FrontOpen",
    description="Hang a coat that lies flat, its neck towards the robots, over a hook on a post.",
    success_text=(
        "no more than 0.7 % of the garment is less than 1 cm above the ground, its middle is "
        "within 10 cm of the hook's, sideways, and no more than 50 cm below it, and its top at "
        "the hook"
    ),
    start=Start(x_range=(-0.1, 0.1), y_range=(0.5, 0.7), yaw=float(np.pi)),
    objects=(
        SceneObject(
            name="hook",
            prop="pothook",
            position=(0.0, 0.81, 0.0),
            x_range=(-0.25, 0.25),
            y_range=(-0.125, 0.125),
            friction=1.0,
        ),
    ),
    left_base=HANG_LEFT_BASE,
    right_base=HANG_RIGHT_BASE,
    cameras=HOOK_CAMERAS,
    picture_camera="video_camera",
    # with less, a coat slips out of the fingers; the thumb is inside as the hand retreats
    hand_friction=HandFriction(fingers=25.0, thumb=3.0),
    # the hook's arm reaches 0.2 m behind its cross-bar
    success=HangsOver(frame="hook.target", sideways=0.10, over=0.15, below=0.5),
)
