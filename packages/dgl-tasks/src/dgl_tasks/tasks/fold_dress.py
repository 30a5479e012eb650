"""Fold Dress: left sleeve to the right, right sleeve to the left, skirt up."""

from dgl_tasks.declaration import Start, Task
from dgl_tasks.layouts import FOLD_CAMERAS
from dgl_tasks.success import ShareInBox

TASK = Task(
    id="FoldDress-v1",
    title="Fold Dress",
    category="Dress_LongSleeve",
    description=(
        "Fold a dress that lies flat: both sleeves in, then the skirt up, held below the waist."
    ),
    success_text=(
        "at least 80 % of the garment's visible area lies between the shoulders (+- 0.05 m) "
        "and between the side of the skirt and the shoulder (+- 0.1 m)"
    ),
    start=Start(
        x_range=(-0.1, 0.1),
        y_range=(0.65, 0.9),
    ),
    cameras=FOLD_CAMERAS,
    # threshold from the paper, margins from the original code
    success=ShareInBox(
        left=("left_shoulder",),
        right=("right_shoulder",),
        near="left_side",
        far="left_shoulder",
        margins=(0.05, 0.1, 0.05, 0.1),
        threshold=0.80,
    ),
)
