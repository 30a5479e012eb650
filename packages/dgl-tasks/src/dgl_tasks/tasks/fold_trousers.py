"""Fold Trousers: one leg over the other, then the hems to the waistband."""

import numpy as np

from dgl_physics import ClothMaterial
from dgl_tasks.declaration import Start, Task
from dgl_tasks.layouts import FOLD_CAMERAS
from dgl_tasks.success import ShareInBox

TASK = Task(
    id="FoldTrousers-v1",
    title="Fold Trousers",
    category="Trousers",
    description=(
        "Fold trousers that lie flat, the waistband to the left: the near leg over the far one, "
        "then the hems to the waistband."
    ),
    success_text=(
        "at least 85 % of the garment's visible area lies in the half of the far leg next to the "
        "waistband, between its outer seam and the middle of the trousers (+- 0.1 m)"
    ),
    start=Start(
        x_range=(-0.1, 0.1),
        y_range=(0.7, 0.9),
        yaw=float(np.pi / 2),
    ),
    cameras=FOLD_CAMERAS,
    # four layers are taken in one pinch: with no more friction between layers than with the ground
    # the upper leg slides off the lower one, which stays behind
    material=ClothMaterial(particle_friction_scale=1.0),
    # threshold from the paper, margins from the original code
    success=ShareInBox(
        left=("right_waist",),
        right=("right_waist", "right_hem_outer"),
        near="centre",
        far="right_waist",
        margins=(0.1, 0.1, 0.05, 0.1),
        threshold=0.85,
    ),
)
