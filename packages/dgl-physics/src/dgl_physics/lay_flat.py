"""A garment laid flat by simulation: it falls onto a table and is pressed."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from dgl_physics.fabrics import get_fabric
from dgl_physics.model import ModelBuilder
from dgl_physics.scene import Scene

__all__ = ["FRAMES", "lay_flat"]

FRAMES = 150
"""Frames of 1/60 s in all."""
_FALL, _PRESS = 60, 45  # frames of falling, then of pressing; the rest is for coming to rest
_PRESS_GRAVITY = 8.0  # as if the cloth were so much heavier
_FRICTION = 0.05  # so that it spreads instead of wrinkling
_START = 0.006  # height of the lowest point above the table [m]


def lay_flat(
    vertices: np.ndarray,
    faces: np.ndarray,
    rest_vertices: np.ndarray,
    *,
    on_frame: Callable[[], None] | None = None,
) -> np.ndarray:
    """Let a garment fall onto its back and come to rest.

    Args:
        vertices: Positions [m], shape (V, 3), front up.
        faces: Triangles, shape (F, 3), int.
        rest_vertices: Unstrained positions [m], shape (V, 3).
        on_frame: Called after each of `FRAMES` frames.

    Returns:
        Positions [m], shape (V, 3), float64.

    Raises:
        SimulationDivergedError: If the garment cannot be simulated.

    Limitations:
        Sleeves of a body that stands with raised arms stay raised; wide shapes keep folds.
    """
    slippery = replace(get_fabric("knit_cotton"), friction=_FRICTION)
    builder = ModelBuilder()
    lifted = vertices - [0.0, 0.0, vertices[:, 2].min() - _START]
    builder.add_garment(lifted, faces, rest=rest_vertices, material=slippery)
    builder.add_ground()
    scene = Scene(builder)
    for frame in range(FRAMES):
        is_pressed = _FALL <= frame < _FALL + _PRESS
        scene.state.set_gravity_scale(_PRESS_GRAVITY if is_pressed else 1.0)
        scene.step()
        if on_frame is not None:
            on_frame()
    return scene.x
