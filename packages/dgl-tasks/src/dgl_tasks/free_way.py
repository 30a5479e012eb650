"""Ways along which the hand may turn as it likes: orientations that keep the arm within reach."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from dgl_assets.robots import Robot, Side
from dgl_tasks.control import ArmKinematics
from dgl_tasks.errors import UnreachableError
from dgl_tasks.grasps import HandAngles, grasp_to_wrist, orient
from dgl_tasks.rotations import to_quaternion, to_rotation

__all__ = ["Waypoint", "choose_orientations"]

YAWS = tuple(range(-180, 180, 30))
"""Yaws of the hand that are tried [degrees]."""
PITCHES = (0, 30, 60)
"""Slopes of the fingers that are tried [degrees]."""
TURN_COST = 1.0
"""Cost of a turn of the hand, which twists what it holds, beside that of the joints."""
AIM_COST = 2.0
"""Cost of fingers that point elsewhere than they should, at the end of each part."""
BEAM = 8
"""Configurations that are kept at each point."""
_STEP = 1.3
"""Largest change of a joint between two points [rad]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Waypoint:
    """A configuration of an arm on its way."""

    joints: np.ndarray
    """Joint positions [rad], shape (n,)."""
    quaternion: np.ndarray
    """Orientation of `ee`, wxyz, shape (4,)."""
    angles: tuple[int, int] | None = None
    """Yaw and pitch [degrees]; None at the start."""
    cost: float = 0.0
    """Sum of the squared changes of joints and orientation, and of the errors of aim, so far
    [rad^2]."""
    before: "Waypoint | None" = None


def choose_orientations(
    arm: ArmKinematics,
    robot: Robot,
    parts: Sequence[np.ndarray],
    start: Waypoint,
    *,
    is_clear: Callable[[np.ndarray], bool],
    towards: np.ndarray | None = None,
) -> list[Waypoint]:
    """Choose the orientation of a hand at the end of each part of a way, palm down.

    A beam search: the configurations at one end with the least cost so far are continued to the
    next with the same orientation and with its neighbours, 30 degrees away.

    Args:
        arm: Its kinematics.
        robot: Whose arm it is.
        parts: Grasp points of each part of the way [m], shape (P, 3), world frame, one a control
            step. The orientation is chosen at the last one, and turns evenly before.
        start: Present configuration.
        is_clear: Tells of joint positions of the arm, shape (n,), that it touches nothing.
        towards: Point that the fingers point at where they can [m], shape (3,).

    Returns:
        The configuration at the end of each part.

    Raises:
        UnreachableError: If there is no way within reach that keeps clear.
    """
    beam = [start]
    for number, points in enumerate(parts):
        found: dict[tuple[int, int], Waypoint] = {}
        for last in beam:
            present = last.angles or _find_angles(last.quaternion, arm.side)
            for angles in _list_neighbours(present):
                reached = _continue(arm, robot, points[-1], angles, last, towards)
                if reached is not None:
                    known = found.get(angles)
                    if known is None or reached.cost < known.cost:
                        found[angles] = reached
        ranked = sorted(found.values(), key=lambda each: each.cost)
        beam, touches = [], False
        for each in ranked:
            if len(beam) == BEAM:
                break
            if is_clear(each.joints):
                beam += _follow(arm, robot, points, each)
            else:
                touches = True
        if not beam:
            what = "without touching an obstacle" if touches else "with any orientation of the hand"
            raise UnreachableError(
                f"{arm.side} arm cannot reach {np.round(points[-1], 3).tolist()} {what}, point "
                f"{number + 1} of {len(parts)} on its way"
            )
    way = [beam[0]]
    while (before := way[-1].before) is not None and before is not start:
        way.append(before)
    return way[::-1]


def _find_angles(quaternion: np.ndarray, side: Side) -> tuple[int, int]:
    """Find the tried yaw and pitch that are nearest to an orientation."""
    known = [(yaw, pitch) for yaw in YAWS for pitch in PITCHES]
    tried = Rotation.concatenate([to_rotation(_orient(angles, side)) for angles in known])
    away = (tried.inv() * to_rotation(quaternion)).magnitude()
    return known[int(away.argmin())]


def _list_neighbours(angles: tuple[int, int]) -> list[tuple[int, int]]:
    """List yaws and pitches next to these."""
    yaw, pitch = angles
    yaws = [(yaw + turn + 180) % 360 - 180 for turn in (-30, 0, 30)]
    return [(y, p) for y in yaws for p in PITCHES if abs(p - pitch) <= 30]


def _continue(
    arm: ArmKinematics,
    robot: Robot,
    point: np.ndarray,
    angles: tuple[int, int],
    last: Waypoint,
    towards: np.ndarray | None,
) -> Waypoint | None:
    q = _orient(angles, arm.side)
    wrist = grasp_to_wrist(point, q, arm.side, robot=robot)
    try:
        joints = arm.solve(wrist, q, last.joints, max_step=_STEP)
    except UnreachableError:
        return None
    turn = float((to_rotation(q).inv() * to_rotation(last.quaternion)).magnitude())
    cost = last.cost + float(((joints - last.joints) ** 2).sum()) + TURN_COST * turn**2
    if towards is not None:
        fingers = to_rotation(q).apply([1.0, 0.0, 0.0])
        aim = (towards - point) / max(float(np.linalg.norm(towards - point)), 1e-6)
        cost += AIM_COST * float(np.arccos(np.clip(fingers @ aim, -1.0, 1.0))) ** 2
    return Waypoint(joints=joints, quaternion=q, angles=angles, cost=cost, before=last)


def _follow(
    arm: ArmKinematics, robot: Robot, points: np.ndarray, reached: Waypoint
) -> list[Waypoint]:
    """Give the waypoint as the arm gets there through these points, or none if it cannot."""
    before = reached.before
    assert before is not None
    ends = Rotation.concatenate([to_rotation(w.quaternion) for w in (before, reached)])
    turns = Slerp([0.0, 1.0], ends)(np.linspace(0.0, 1.0, len(points) + 1)[1:])
    poses = [
        np.concatenate([grasp_to_wrist(point, q, arm.side, robot=robot), q])
        for point, q in zip(points, to_quaternion(turns), strict=True)
    ]
    try:
        path = arm.follow(np.stack(poses), before.joints)
    except UnreachableError:
        return []
    return [replace(reached, joints=path[-1])]


def _orient(angles: tuple[int, int], side: Side) -> np.ndarray:
    yaw, pitch = angles
    return orient(HandAngles(yaw=float(yaw), pitch=float(pitch)), side)
