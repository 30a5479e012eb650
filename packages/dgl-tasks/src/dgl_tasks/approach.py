"""How hands come to the cloth and how they leave it, for whatever acts in between."""

from collections.abc import Mapping

import numpy as np

from dgl_assets.robots import Side
from dgl_tasks.declaration import Stage
from dgl_tasks.errors import UnreachableError
from dgl_tasks.grasps import point_along_fingers, roll_thumb_down
from dgl_tasks.leaving import LEAVES, LeaveName
from dgl_tasks.motion import BimanualMotion

APPROACH_HEIGHT = 0.15
"""Height above the grasp point from which a hand comes down [m]."""
ARRIVAL_FRAMES = 10
"""Frames for the arm to arrive at the grasp points before the hand closes."""
RELEASE_FRAMES = 15
"""Frames for the cloth to fall from an opened hand before it leaves."""
CLEARANCE = 0.15
"""How far it then rises [m]."""
FREE_DRAW_BACKS = (0.12, 0.08, 0.04, 0.0)
"""How far a hand draws back from cloth that came along [m]: the first of these that the arm can reach."""
REACHABLE_WITHIN = 0.1
"""How far from a point that is out of reach a hand may take hold of the garment instead [m]."""
REACHABLE_SPACING = 0.02
"""Distance between places of the garment that are tried then [m]."""
LEAVE_SPACING = 0.005
"""Distance between samples of its way [m]; 0.005 is 0.3 m/s."""


def plan_approach(
    motion: BimanualMotion,
    points: Mapping[Side, np.ndarray],
    orientations: Mapping[Side, np.ndarray],
) -> np.ndarray:
    """Plan how hands come to grasp points: above them, straight down, and a wait.

    Args:
        motion: Plans the arms.
        points: Grasp point of each hand [m], shape (3,), world frame.
        orientations: Of `ee` of each of these hands, wxyz, shape (4,).

    Returns:
        Joint targets [rad], shape (N, D).

    Raises:
        UnreachableError: If a hand cannot go there.
    """
    up = np.array([0, 0, APPROACH_HEIGHT])
    above: dict[Side, np.ndarray] = {side: point + up for side, point in points.items()}
    way = motion.reach(above, orientations)
    return np.concatenate([way, motion.move(points, orientations), motion.hold(ARRIVAL_FRAMES)])


def find_reachable(
    motion: BimanualMotion, stage: Stage, side: Side, point: np.ndarray, cloud: np.ndarray
) -> np.ndarray:
    """Find where a hand can take hold of a garment, as near to a point of it as can be.

    Args:
        motion: Plans the arms.
        stage: Names the orientation and the height of the grasp.
        side: The hand.
        point: Where it should [m], shape (3,), world frame.
        cloud: What is seen of the garment [m], shape (N, 3), world frame.

    Returns:
        Place of the garment [m], shape (3,), world frame: the point itself if it is within reach.

    Raises:
        UnreachableError: If the hand can go neither there nor to anything of the garment within `REACHABLE_WITHIN` of it.
    """

    def come(side: Side, orientation: np.ndarray) -> None:
        plan_approach(motion, {side: grasp}, {side: orientation})

    refused: UnreachableError | None = None
    for place in (np.asarray(point), *_get_places(point, cloud)):
        grasp = stage.place_grasp(side, place)
        try:
            motion.choose_turns(stage.orientation, (side,), come)
        except UnreachableError as err:
            refused = refused or err
        else:
            return place
    assert refused is not None
    raise refused


def _get_places(point: np.ndarray, cloud: np.ndarray) -> np.ndarray:
    """Give places of a cloud around a point [m], shape (M, 3), from the nearest to the farthest."""
    distances = np.linalg.norm(cloud[:, :2] - point[:2], axis=1)
    order = np.argsort(distances, kind="stable")
    order = order[distances[order] <= REACHABLE_WITHIN]
    squares = np.floor(cloud[order, :2] / REACHABLE_SPACING)
    _, first = np.unique(squares, axis=0, return_index=True)
    return cloud[order[np.sort(first)]]


def plan_leave(
    motion: BimanualMotion,
    points: Mapping[Side, np.ndarray],
    orientations: Mapping[Side, np.ndarray],
    name: LeaveName = "slide",
) -> list[np.ndarray]:
    """Plan how opened hands leave the cloth, from where `motion` is.

    They roll, draw back along their fingers, and go straight up.

    Args:
        motion: Plans the arms.
        points: Grasp point of each hand [m], shape (3,), world frame.
        orientations: Of `ee` of each hand that leaves, wxyz, shape (4,).
        name: Which of `LEAVES`.

    Returns:
        Joint targets of each part, shape (N, D) [rad].

    Raises:
        UnreachableError: If a hand cannot even go straight up.
    """
    leave = LEAVES[name]
    rolled: dict[Side, np.ndarray] = {
        side: roll_thumb_down(q, leave.roll, side) for side, q in orientations.items()
    }
    starts = {side: points[side] + np.array([0, 0, leave.rise]) for side in orientations}
    return _plan_way_out(motion, starts, rolled, leave.draw_backs, frames=leave.frames)


def plan_free(
    motion: BimanualMotion,
    points: Mapping[Side, np.ndarray],
    orientations: Mapping[Side, np.ndarray],
) -> list[np.ndarray]:
    """Plan how risen hands get free of cloth that has come along: down again, a wait, back along their fingers, up.

    Args:
        motion: Plans the arms.
        points: Where the grasp point of each of these hands is [m], shape (3,), world frame.
        orientations: Of `ee` of each of these hands, wxyz, shape (4,).

    Returns:
        Joint targets of each part, shape (N, D) [rad].

    Raises:
        UnreachableError: If a hand cannot go down and up again.
    """
    starts = {side: points[side] - np.array([0, 0, CLEARANCE]) for side in orientations}
    return _plan_way_out(motion, starts, orientations, FREE_DRAW_BACKS, frames=RELEASE_FRAMES)


def _plan_way_out(
    motion: BimanualMotion,
    starts: Mapping[Side, np.ndarray],
    orientations: Mapping[Side, np.ndarray],
    lengths: tuple[float, ...],
    *,
    frames: int,
) -> list[np.ndarray]:
    """Plan a way to `starts`, a wait, a way back along the fingers, of the first of `lengths` in reach, and one up."""
    ways: dict[Side, tuple[np.ndarray, ...]] = {}
    for side, q in orientations.items():
        for length in lengths:
            back = starts[side] - length * point_along_fingers(q)
            ways[side] = (starts[side], back, back + np.array([0, 0, CLEARANCE]))
            with motion.rehearsal():
                try:
                    for target in ways[side]:
                        motion.move({side: target}, {side: q}, spacing=LEAVE_SPACING)
                except UnreachableError:
                    if length == lengths[-1]:
                        raise
                else:
                    break
    parts = []
    for k in range(3):
        targets: dict[Side, np.ndarray] = {side: way[k] for side, way in ways.items()}
        parts.append(motion.move(targets, orientations, spacing=LEAVE_SPACING))
        if k == 0:
            parts.append(motion.hold(frames))
    return parts
