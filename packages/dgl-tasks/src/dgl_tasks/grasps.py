"""Orientations of the hands, and wrist poses for grasp points.

The frame `ee` has x along the fingers, y out of the palm and z = x cross y, the thumb side of the
right hand and the little-finger side of the left.
"""

from dataclasses import dataclass
from typing import Annotated, Literal, get_args

import numpy as np
from annotated_types import Interval
from scipy.spatial.transform import Rotation

from dgl_assets.robots import DEFAULT_ROBOT, SIDES, Robot, Side
from dgl_files.fields import STRICT, check_fields
from dgl_tasks.rotations import to_quaternion, to_rotation

GraspName = Literal["standard", "heap", "sides", "heap_sides", "hems", "scoop", "tray"]
"""Named orientations of the hands; `docs/add_a_task.md` describes them."""


@dataclass(frozen=True, kw_only=True)
class HandAngles:
    """An orientation by angles; all zero, the palm looks down and the fingers point straight ahead.

    The hand is rolled first, then pitched, then yawed. Left and right hand mirror each other.
    """

    __pydantic_config__ = STRICT

    yaw: Annotated[float, Interval(ge=-180, le=180)] = 0.0
    """Turn about the vertical, towards the other hand [degrees]."""
    pitch: Annotated[float, Interval(ge=-80, le=80)] = 0.0
    """Slope of the fingers, positive downwards [degrees]."""
    roll: Annotated[float, Interval(ge=-180, le=180)] = 0.0
    """Turn about the fingers, the thumb downwards [degrees]; at 180 the palm looks up."""

    def __post_init__(self) -> None:
        check_fields(self)


Orientation = GraspName | HandAngles
"""An orientation of a hand: a name, or angles."""

HEAP_PITCH = np.radians(30)
"""Downward slope of the fingers of "heap" and "hems" [rad]: the forearm stays above the cloth, so
that nothing hangs over it when the hand retreats."""
SIDE_TURN = np.radians(45)
"""Inward turn of "sides" and "heap_sides", beyond that of "standard" and "heap" [rad]."""

_AHEAD = Rotation.from_matrix([[0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
# rounded as in the original code: from angles, recorded motions would differ in the last bits
_ROWS: dict[str, dict[Side, tuple[float, float, float, float]]] = {
    "standard": {"left": (0.579, -0.579, -0.406, 0.406), "right": (0.406, -0.406, -0.579, 0.579)},
    "sideways": {"right": (0.0, 0.0, 0.707, -0.707)},
    "scoop": {
        "left": (0.7010574, 0.5609855, 0.4304593, 0.092296),
        "right": (0.4304593, 0.092296, 0.7010574, 0.5609855),
    },
    "tray": {"left": (0.653, 0.653, 0.271, 0.271), "right": (0.271, 0.271, 0.653, 0.653)},
}


def pitch_fingers(quaternion: np.ndarray, angle: float) -> np.ndarray:
    """Turn an orientation about the knuckles, the fingers towards the palm's side.

    Args:
        quaternion: Orientation of `ee`, wxyz, shape (4,).
        angle: Turn [rad].

    Returns:
        The turned orientation, wxyz, shape (4,).
    """
    return to_quaternion(to_rotation(quaternion) * Rotation.from_rotvec([0.0, 0.0, angle]))


def turn_inward(quaternion: np.ndarray, angle: float, side: Side) -> np.ndarray:
    """Turn an orientation about the vertical so that the hand points more to the other side.

    Args:
        quaternion: Orientation of `ee`, wxyz, shape (4,).
        angle: Turn [rad]; clockwise from above for the left hand, the reverse for the right.
        side: "left" or "right".

    Returns:
        The turned orientation, wxyz, shape (4,).
    """
    turn = Rotation.from_rotvec([0.0, 0.0, -angle if side == "left" else angle])
    return to_quaternion(turn * to_rotation(quaternion))


def _make_orientations() -> dict[GraspName, dict[Side, np.ndarray]]:
    rows: dict[str, dict[Side, np.ndarray]] = {
        name: {side: to_quaternion(to_rotation(q)) for side, q in row.items()}
        for name, row in _ROWS.items()
    }
    for name, level in (("heap", "standard"), ("hems", "sideways")):
        rows[name] = {side: pitch_fingers(q, HEAP_PITCH) for side, q in rows[level].items()}
    for name, ahead in (("sides", "standard"), ("heap_sides", "heap")):
        rows[name] = {side: turn_inward(q, SIDE_TURN, side) for side, q in rows[ahead].items()}
    return {name: rows[name] for name in get_args(GraspName)}


GRASP_ORIENTATIONS: dict[GraspName, dict[Side, np.ndarray]] = _make_orientations()
"""Orientation of `ee` by name and side: unit quaternions wxyz, shape (4,)."""


def find_sides(orientation: Orientation) -> tuple[Side, ...]:
    """Give the hands that an orientation is for.

    Raises:
        ValueError: If it is neither a known name nor angles.
    """
    if isinstance(orientation, HandAngles):
        return SIDES
    if not isinstance(orientation, str) or orientation not in GRASP_ORIENTATIONS:
        raise ValueError(
            f"orientation must be one of {list(GRASP_ORIENTATIONS)}, or yaw, pitch and roll; "
            f"got {orientation!r}"
        )
    return tuple(GRASP_ORIENTATIONS[orientation])


def orient(orientation: Orientation, side: Side, turn: float = 0.0) -> np.ndarray:
    """Compute an orientation of `ee`, turned further inward [rad]: wxyz, shape (4,)."""
    if not isinstance(orientation, HandAngles):
        return turn_inward(GRASP_ORIENTATIONS[orientation][side], turn, side)
    yaw, pitch, roll = np.radians([orientation.yaw, orientation.pitch, orientation.roll])
    pitched = pitch_fingers(to_quaternion(_AHEAD), float(pitch))
    return turn_inward(roll_thumb_down(pitched, float(roll), side), float(yaw) + turn, side)


def grasp_to_wrist(
    point: np.ndarray, quaternion: np.ndarray, side: Side, *, robot: Robot = DEFAULT_ROBOT
) -> np.ndarray:
    """Compute where `ee` must be for the grasp point between the fingers to be at `point`.

    Args:
        point: Grasp point [m], shape (3,), world frame.
        quaternion: Orientation of `ee` in the world, wxyz, shape (4,).
        side: "left" or "right": the thumb, and so the grasp point, is on opposite sides.
        robot: Whose hand it is.

    Returns:
        Wrist position [m], shape (3,), world frame.
    """
    offset = to_rotation(quaternion).apply(robot.get_grasp_offset(side))
    return np.asarray(point, dtype=float) - offset


def wrist_to_grasp(
    position: np.ndarray, quaternion: np.ndarray, side: Side, *, robot: Robot = DEFAULT_ROBOT
) -> np.ndarray:
    """Compute the grasp point [m], shape (3,), of a wrist pose; inverse of `grasp_to_wrist`."""
    offset = to_rotation(quaternion).apply(robot.get_grasp_offset(side))
    return np.asarray(position, dtype=float) + offset


def roll_thumb_down(quaternion: np.ndarray, angle: float, side: Side) -> np.ndarray:
    """Turn an orientation about the fingers, the thumb downwards where the palm looks down.

    Args:
        quaternion: Orientation of `ee`, wxyz, shape (4,).
        angle: Turn [rad].
        side: "left" or "right".

    Returns:
        The turned orientation, wxyz, shape (4,).
    """
    turn = Rotation.from_rotvec([angle if side == "left" else -angle, 0.0, 0.0])
    return to_quaternion(to_rotation(quaternion) * turn)


def point_along_fingers(quaternion: np.ndarray) -> np.ndarray:
    """Compute the level direction in which the fingers of an orientation of `ee` point, shape (3,).

    Raises:
        ValueError: If they point straight up or down.
    """
    along = to_rotation(quaternion).apply([1.0, 0.0, 0.0]) * [1.0, 1.0, 0.0]
    length = float(np.linalg.norm(along))
    if length < 1e-3:
        raise ValueError(f"fingers must not point straight up or down; got quaternion {quaternion}")
    return along / length


def point_level(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Give the level direction from one point to another [m], each of shape (3,)."""
    way = (end - start) * [1.0, 1.0, 0.0]
    return way / max(float(np.linalg.norm(way)), 1e-9)
