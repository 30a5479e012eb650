"""Fold Dress: left sleeve to the right, right sleeve to the left, skirt up."""

from dgl_tasks.cameras import FOLD_CAMERAS
from dgl_tasks.declaration import Stage, Task
from dgl_tasks.success import FoldRule

TASK = Task(
    id="FoldDress-v1",
    title="Fold Dress",
    category="Dress_LongSleeve",
    description="Fold a dress that lies flat: both sleeves in, then the skirt up, held below the waist.",
    success_text=(
        "at least 80 % of the garment's visible area lies between the shoulders (+- 0.05 m) "
        "and between the side of the skirt and the shoulder (+- 0.1 m)"
    ),
    x_range=(-0.1, 0.1),
    y_range=(0.65, 0.9),
    cameras=FOLD_CAMERAS,
    stages=(
        Stage(name="left_sleeve", grasp={"left": "left_cuff"}, policy_loops=8),
        Stage(name="right_sleeve", grasp={"right": "right_cuff"}, policy_loops=8),
        Stage(
            name="skirt_up",
            grasp={"left": "left_side", "right": "right_side"},
            orientation="heap",
            grasp_height=0.0,
            policy_loops=12,
        ),
    ),
    # threshold from the paper, margins from the original code
    success=FoldRule(
        left=("left_shoulder",),
        right=("right_shoulder",),
        near="left_side",
        far="left_shoulder",
        margins=(0.05, 0.1, 0.05, 0.1),
        threshold=0.80,
    ),
)
