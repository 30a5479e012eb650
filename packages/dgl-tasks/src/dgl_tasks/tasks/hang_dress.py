"""Hang Dress: over the bar of a hanger, held where its sleeves begin."""

from dgl_tasks.declaration import HandFriction, Start, Task
from dgl_tasks.layouts import FLING_CAMERAS, HANG_LEFT_BASE, HANG_RIGHT_BASE, HANGER
from dgl_tasks.success import HangsOver

TASK = Task(
    id="HangDress-v1",
    title="Hang Dress",
    category="Dress_LongSleeve",
    description="Hang a dress that lies flat over the bar of a hanger.",
    success_text=(
        "no more than 0.7 % of the garment is less than 1 cm above the ground, its middle is "
        "within 5 cm of the bar's, and its top at the bar"
    ),
    start=Start(x_range=(-0.1, 0.1), y_range=(0.5, 0.8)),
    objects=(HANGER,),
    left_base=HANG_LEFT_BASE,
    right_base=HANG_RIGHT_BASE,
    cameras=FLING_CAMERAS,
    picture_camera="video_camera",
    # what hangs from both hands slips out with less
    hand_friction=HandFriction(fingers=25.0),
    success=HangsOver(frame="hanger.target", sideways=0.05),
)
