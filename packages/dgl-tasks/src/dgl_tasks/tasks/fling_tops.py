"""Fling Tops: fling a crumpled top flat, then pull its sleeves apart."""

from dgl_tasks.declaration import HandFriction, Start, Task
from dgl_tasks.layouts import FLING_CAMERAS, STEEP
from dgl_tasks.success import CoversFlatArea

TASK = Task(
    id="FlingTops-v1",
    title="Fling Tops",
    category="Tops_LongSleeve",
    description=(
        "Lift a crumpled top where its sleeves begin, fling it flat, and pull its sleeves apart."
    ),
    success_text="the covered area differs from that of the flat garment by less than 20 %",
    hand_friction=HandFriction(fingers=25.0),
    start=Start(
        x_range=(-0.1, 0.1),
        y_range=(0.5, 0.7),
        roll_range=STEEP,
        value_below=0.7,
        settle_frames=120,
    ),
    cameras=FLING_CAMERAS,
    success=CoversFlatArea(),
)
