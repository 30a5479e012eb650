"""Whether a hand can do all that a stage asks of it, found out before it goes."""

from collections.abc import Sequence

import numpy as np

from dgl_assets.robots import Side
from dgl_collect.demonstration import RetargetedWaypoint
from dgl_tasks.approach import plan_approach, plan_leave
from dgl_tasks.declaration import Stage
from dgl_tasks.motion import BimanualMotion

__all__ = ["rehearse_stage"]


def rehearse_stage(
    motion: BimanualMotion,
    stage: Stage,
    side: Side,
    orientation: np.ndarray,
    grasp: np.ndarray,
    waypoints: Sequence[RetargetedWaypoint],
    *,
    leaves: bool = True,
) -> None:
    """Plan one hand's whole stage, for `BimanualMotion.choose_turns`: approach, waypoints and leave.

    Args:
        motion: Plans; its targets move along, see `BimanualMotion.rehearsal`.
        stage: The stage.
        side: The hand.
        orientation: Of its `ee`, wxyz, shape (4,).
        grasp: Where it grasps [m], shape (3,), world frame.
        waypoints: The demonstration's, carried over to this garment; the first of them, or none, for the stage's
            beginning alone.
        leaves: Whether the hand leaves the cloth after the last of them.

    Raises:
        UnreachableError: If it cannot go there.
    """
    orientations: dict[Side, np.ndarray] = {side: orientation}
    plan_approach(motion, {side: grasp}, orientations)
    for waypoint in waypoints:
        motion.move({side: waypoint.targets[side]}, orientations, spacing=waypoint.spacing)
    if leaves:
        end = waypoints[-1].targets[side]
        plan_leave(motion, {side: end}, orientations, stage.leave)
