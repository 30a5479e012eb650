"""Fold Scarf: both ends to the middle."""

from dgl_tasks.declaration import Start, Task
from dgl_tasks.layouts import FOLD_CAMERAS
from dgl_tasks.success import ShareInBox

TASK = Task(
    id="FoldScarf-v1",
    title="Fold Scarf",
    category="Scarf",
    description="Fold a scarf that lies flat: both ends to the middle.",
    success_text="at least 85 % of the visible area lies between the quarters (+- 0.06 m)",
    start=Start(x_range=(-0.1, 0.1), y_range=(0.7, 0.9)),
    cameras=FOLD_CAMERAS,
    success=ShareInBox(
        left=("left_quarter",),
        right=("right_quarter",),
        near="lower_centre",
        far="upper_centre",
        margins=(0.06, 0.08, 0.06, 0.08),  # wider at the left, near, right and far side [m]
        threshold=0.85,
    ),
)
