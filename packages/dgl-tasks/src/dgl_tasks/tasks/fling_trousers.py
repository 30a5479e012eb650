"""Fling Trousers: fling them flat, pull the legs straight, and spread the waistband."""

from dgl_tasks.declaration import Start, Task
from dgl_tasks.layouts import FLING_CAMERAS, STEEP
from dgl_tasks.success import CoversFlatArea

TASK = Task(
    id="FlingTrousers-v1",
    title="Fling Trousers",
    category="Trousers",
    description=(
        "Lift crumpled trousers by their waistband, fling them flat, pull their legs straight "
        "by the hems, and spread the waistband."
    ),
    success_text="the covered area differs from that of the flat garment by less than 20 %",
    start=Start(
        x_range=(-0.1, 0.1),
        y_range=(0.5, 0.7),
        roll_range=STEEP,
        value_below=0.6,
        settle_frames=120,
    ),
    cameras=FLING_CAMERAS,
    success=CoversFlatArea(),
)
