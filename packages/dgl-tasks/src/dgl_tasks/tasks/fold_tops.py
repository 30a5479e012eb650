"""Fold Tops: left sleeve to the right, right sleeve to the left, bottom to top."""

from dgl_tasks.declaration import Start, Task
from dgl_tasks.layouts import FOLD_CAMERAS
from dgl_tasks.success import ShareInBox

TASK = Task(
    id="FoldTops-v1",
    title="Fold Tops",
    category="Tops_LongSleeve",
    description="Fold a long-sleeved top that lies flat: both sleeves in, then bottom to top.",
    success_text=(
        "at least 85 % of the garment's visible area lies between the sleeve joints (+- 0.05 m) "
        "and between centre and collar (+- 0.1 m)"
    ),
    start=Start(
        x_range=(-0.1, 0.1),
        y_range=(0.7, 0.9),
    ),
    cameras=FOLD_CAMERAS,
    # threshold from the paper, margins from the original code
    success=ShareInBox(
        left=("left_sleeve_joint",),
        right=("right_sleeve_joint",),
        near="centre",
        far="collar",
        margins=(0.05, 0.1, 0.05, 0.1),
        threshold=0.85,
    ),
)
