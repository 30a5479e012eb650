"""Wear Bowl Hat: from a stand onto somebody's head, with both hands."""

import numpy as np

from dgl_assets.props import HatStandParameters, PersonParameters
from dgl_physics import SolidMaterial
from dgl_tasks.declaration import SceneObject, Start, Task
from dgl_tasks.layouts import FLING_CAMERAS, WEAR_LEFT_BASE, WEAR_RIGHT_BASE
from dgl_tasks.success import SitsOn

TASK = Task(
    id="WearBowlHat-v1",
    title="Wear Bowl Hat",
    category="Bowl_Hat",
    description=(
        "Take a hat with a brim from its stand with both hands, and put it on the head of a person."
    ),
    success_text=(
        "the middle of the hat is no higher than the top of the head and within 10 cm of it, "
        "and it leans by at most 35 degrees"
    ),
    start=Start(on="stand.seat", height=0.005, settle_frames=90),
    objects=(
        SceneObject(
            name="stand",
            prop=HatStandParameters(foot_radius=0.08),
            position=(0.0, 0.79, 0.0),
            x_range=(-0.1, 0.1),
            y_range=(-0.085, 0.085),
            solid_to="garment",
        ),
        SceneObject(
            name="person",
            prop=PersonParameters(measures="woman", scale=0.75),
            position=(0.0, 1.15, 0.0),
            x_range=(-0.15, 0.15),
            y_range=(-0.05, 0.05),
            solid_to="garment",
        ),
    ),
    left_base=WEAR_LEFT_BASE,
    right_base=WEAR_RIGHT_BASE,
    cameras=FLING_CAMERAS,
    picture_camera="video_camera",
    material=SolidMaterial(youngs_modulus=3e5, rest_offset=0.003),
    success=SitsOn(frame="person.head_top", within=0.10, leaning=float(np.radians(35))),
)
