"""Wear Baseball Cap: from a stand onto somebody's head, between both palms."""

import numpy as np

from dgl_physics import SolidMaterial
from dgl_tasks.declaration import HandFriction, Start, Task
from dgl_tasks.layouts import HAT_STAND, PERSON, WEAR_CAMERAS, WEAR_LEFT_BASE, WEAR_RIGHT_BASE
from dgl_tasks.success import SitsOn

TASK = Task(
    id="WearBaseballCap-v1",
    title="Wear Baseball Cap",
    category="Baseball_Cap",
    description=(
        "Take a cap with a visor from its stand with both hands, and put it on the head of a "
        "person."
    ),
    success_text=(
        "the middle of the cap is no higher than the top of the head and within 10 cm of it, "
        "and it leans by at most 30 degrees"
    ),
    # the crown is over the stand, not the middle of crown and visor
    start=Start(on="stand.seat", y_range=(-0.034, -0.034), height=0.005, settle_frames=90),
    objects=(HAT_STAND, PERSON),
    left_base=WEAR_LEFT_BASE,
    right_base=WEAR_RIGHT_BASE,
    cameras=WEAR_CAMERAS,
    picture_camera="video_camera",
    material=SolidMaterial(youngs_modulus=1e6, rest_offset=0.003),
    stiffness={"visor": 5.0},
    hand_friction=HandFriction(fingers=4.0),
    success=SitsOn(frame="person.head_top", within=0.10, leaning=float(np.radians(30))),
)
