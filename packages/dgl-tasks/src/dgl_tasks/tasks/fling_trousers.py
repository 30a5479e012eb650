"""Fling Trousers: fling crumpled trousers flat by their waistband."""

from dgl_tasks.cameras import FLING_CAMERAS
from dgl_tasks.declaration import FLING_GRASP_HEIGHT, FLING_ROLL, FLING_START_BELOW, Stage, Task
from dgl_tasks.success import FlingRule

TASK = Task(
    id="FlingTrousers-v1",
    title="Fling Trousers",
    category="Trousers",
    description="Lift crumpled trousers by their waistband and fling them flat.",
    success_text="the covered area differs from that of the flat garment by less than 20 %",
    x_range=(-0.1, 0.1),
    y_range=(0.5, 0.7),
    roll_range=FLING_ROLL,
    start_below=FLING_START_BELOW,
    settle_frames=120,
    cameras=FLING_CAMERAS,
    stages=(
        Stage(
            name="fling",
            grasp={"left": "left_waistband", "right": "right_waistband"},
            orientation="heap_sides",
            grasp_height=FLING_GRASP_HEIGHT,
            leave="shed",
            policy_loops=12,
        ),
    ),
    success=FlingRule(),
)
