"""Hang Vest: a sleeveless top over a low bar."""

from dgl_assets.props import HangerParameters
from dgl_tasks.declaration import HandFriction, SceneObject, Start, Task
from dgl_tasks.layouts import FLING_CAMERAS
from dgl_tasks.success import HangsOver

TASK = Task(
    id="HangVest-v1",
    title="Hang Vest",
    category="Tops_NoSleeve",
    description="Hang a sleeveless top that lies flat over a low bar.",
    success_text="at most 0.7 % lies lower than 1 cm; middle within 8 cm of the bar's",
    start=Start(x_range=(-0.05, 0.05), y_range=(0.5, 0.6)),
    objects=(
        SceneObject(
            name="bar",
            prop=HangerParameters(height=0.6),
            position=(0.0, 0.9, 0.0),
            x_range=(-0.1, 0.1),
            friction=1.0,
        ),
    ),
    cameras=FLING_CAMERAS,
    # the thumb lies inside the garment when the hand leaves
    hand_friction=HandFriction(fingers=25.0, thumb=0.6),
    success=HangsOver(frame="bar.target", sideways=0.08),
)
