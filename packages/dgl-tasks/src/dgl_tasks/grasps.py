"""How the hands take hold: orientations, and the wrist pose for a grasp point.

The frame `ee` has x along the fingers, y out of the palm and z = x cross y, the thumb side of the
right hand and the little-finger side of the left.
"""

from typing import Literal

import numpy as np
from scipy.spatial.transform import Rotation

from dgl_assets.robots import DEFAULT_ROBOT, Robot, Side
from dgl_tasks.rotations import to_quaternion, to_rotation

GraspName = Literal[
    "standard",
    "heap",
    "sides",
    "heap_sides",
    "trousers_2",
    "hems",
    "scoop",
    "cap",
    "tray",
    "scarf",
    "glove",
    "glove_retreat",
]

HEAP_PITCH = np.radians(30)
"""How far the fingers of "heap" and "hems" grasps point down: they take hold of all layers, and the forearm
stays above the cloth, so that nothing hangs over it when the hand leaves [rad]."""
SIDE_TURN = np.radians(45)
"""How far the hands of "sides" and "heap_sides" are turned inwards: they take the cloth from its sides, and
pull apart as they draw back along their fingers [rad]."""

_GRASP_ROWS: dict[GraspName, dict[Side, tuple[float, float, float, float]]] = {
    "standard": {"left": (0.579, -0.579, -0.406, 0.406), "right": (0.406, -0.406, -0.579, 0.579)},
    "trousers_2": {"right": (0.0, 0.0, 0.707, -0.707)},
    "scoop": {
        "left": (0.7010574, 0.5609855, 0.4304593, 0.092296),
        "right": (0.4304593, 0.092296, 0.7010574, 0.5609855),
    },
    "cap": {"right": (0.5, 0.5, 0.5, 0.5)},
    "tray": {"left": (0.653, 0.653, 0.271, 0.271), "right": (0.271, 0.271, 0.653, 0.653)},
    "scarf": {"left": (0.707, -0.707, 0.0, 0.0), "right": (0.0, 0.0, -0.707, 0.707)},
    "glove": {"left": (-0.129, 0.837, 0.483, -0.224), "right": (0.483, -0.224, -0.129, 0.837)},
    "glove_retreat": {"left": (0.0, 0.866, 0.5, 0.0), "right": (0.5, 0.0, 0.0, 0.866)},
}


def pitch_fingers(quaternion: np.ndarray, angle: float) -> np.ndarray:
    """Turn an orientation about the knuckles so that the fingers point more to where the palm looks.

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
    found: dict[GraspName, dict[Side, np.ndarray]] = {
        name: {side: to_quaternion(to_rotation(q)) for side, q in row.items()}
        for name, row in _GRASP_ROWS.items()
    }
    pitched: dict[GraspName, GraspName] = {"heap": "standard", "hems": "trousers_2"}
    for name, level in pitched.items():
        found[name] = {side: pitch_fingers(q, HEAP_PITCH) for side, q in found[level].items()}
    turned: dict[GraspName, GraspName] = {
        "sides": "standard",
        "heap_sides": "heap",
    }
    for name, ahead in turned.items():
        found[name] = {side: turn_inward(q, SIDE_TURN, side) for side, q in found[ahead].items()}
    return found


GRASP_ORIENTATIONS: dict[GraspName, dict[Side, np.ndarray]] = _make_orientations()
"""Orientation of `ee` for each kind of grasp, by side: unit quaternions wxyz, shape (4,)."""


def orient(name: GraspName, side: Side, turn: float = 0.0) -> np.ndarray:
    """Give the orientation of `ee` for a kind of grasp, turned inward [rad]: wxyz, shape (4,)."""
    return turn_inward(GRASP_ORIENTATIONS[name][side], turn, side)


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
    """Turn an orientation about the fingers so that the thumb of a hand whose palm looks down sinks.

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
