"""Fling Trousers: fling crumpled trousers flat by their waistband, pull their legs straight, and spread the waistband."""

from dgl_tasks.cameras import FLING_CAMERAS
from dgl_tasks.declaration import FLING_GRASP_HEIGHT, FLING_ROLL, FLING_ROUNDS, Stage, Task
from dgl_tasks.success import FlingRule

TASK = Task(
    id="FlingTrousers-v1",
    title="Fling Trousers",
    category="Trousers",
    description="Lift crumpled trousers by their waistband, fling them flat, pull their legs straight by the hems, and spread the waistband.",
    success_text="the covered area differs from that of the flat garment by less than 20 %",
    x_range=(-0.1, 0.1),
    y_range=(0.5, 0.7),
    roll_range=FLING_ROLL,
    start_below=0.6,
    settle_frames=120,
    rounds=FLING_ROUNDS,
    nearly_done=0.65,
    turns_over=True,
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
        Stage(
            name="pull_legs",
            grasp={"left": "left_hem_middle", "right": "right_hem_middle"},
            # level fingers take the edge of a hem alone, which slips
            orientation="heap",
            grasp_height=FLING_GRASP_HEIGHT,
            looks_again=True,
            moved_at_most=None,
            policy_loops=4,
        ),
        Stage(
            name="spread_waist",
            grasp={"left": "left_waistband", "right": "right_waistband"},
            orientation="heap_sides",
            grasp_height=FLING_GRASP_HEIGHT,
            looks_again=True,
            moved_at_most=None,
            leave="shed",
            policy_loops=4,
        ),
    ),
    success=FlingRule(),
)
