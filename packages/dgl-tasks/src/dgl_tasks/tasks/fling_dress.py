"""Fling Dress: fling a crumpled dress flat, then pull its sleeves apart."""

from dgl_tasks.cameras import FLING_CAMERAS
from dgl_tasks.declaration import FLING_GRASP_HEIGHT, FLING_ROLL, FLING_ROUNDS, Stage, Task
from dgl_tasks.success import FlingRule

TASK = Task(
    id="FlingDress-v1",
    title="Fling Dress",
    category="Dress_LongSleeve",
    description="Lift a crumpled dress where its sleeves begin, fling it flat, and pull its sleeves apart.",
    success_text="the covered area differs from that of the flat garment by less than 20 %",
    x_range=(-0.1, 0.1),
    y_range=(0.5, 0.7),
    roll_range=FLING_ROLL,
    start_below=0.6,
    settle_frames=120,
    rounds=FLING_ROUNDS,
    hand_friction=25.0,
    turns_over=True,
    cameras=FLING_CAMERAS,
    stages=(
        Stage(
            name="fling",
            grasp={"left": "left_sleeve_joint", "right": "right_sleeve_joint"},
            orientation="heap_sides",
            grasp_height=FLING_GRASP_HEIGHT,
            policy_loops=12,
        ),
        Stage(
            name="spread_sleeves",
            grasp={"left": "left_cuff", "right": "right_cuff"},
            orientation="sides",
            grasp_height=0.02,
            short_by=0.03,
            looks_again=True,
            moved_at_most=None,
            policy_loops=4,
        ),
    ),
    success=FlingRule(),
)
