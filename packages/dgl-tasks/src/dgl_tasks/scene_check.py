"""Checks of a declaration's scene, before anything is simulated."""

from itertools import combinations, product

import numpy as np

from dgl_assets.props import Prop, make_prop
from dgl_tasks.declaration import SceneObject, Task
from dgl_tasks.success import get_frame

BODY, BODY_HEIGHT = 0.15, 0.6
"""Half width of the body around a robot's base, and its height above it [m]."""
REACH = 1.6
"""Reach of a grasp point from the base of an arm [m]: 1.3 of the UR10e, and the hand."""


def check_scene(task: Task) -> None:
    """Check the objects of a task.

    Raises:
        ValueError: If the start or the rule names an unknown frame, two objects may overlap,
            or one may stand in a robot or is out of reach.
    """
    try:
        props = {item.name: _make_prop(item) for item in task.objects}
        frames = {name: prop.landmarks for name, prop in props.items()}
        for name in (*task.success.frames, *([task.start.on] if task.start.on else [])):
            get_frame(frames, name)
        _check_room(task, {item.name: _bound(item, props[item.name]) for item in task.objects})
        for item in task.objects:
            _check_reach(task, item, props[item.name])
    except ValueError as err:
        raise ValueError(f"task {task.id}: {err}") from err


def _make_prop(item: SceneObject) -> Prop:
    try:
        return make_prop(item.prop)
    except ValueError as err:
        raise ValueError(f"object {item.name!r}: {err}") from err


def _bound(item: SceneObject, prop: Prop) -> np.ndarray:
    """Corners of the box that holds an object in all its drawn poses [m], shape (2, 3)."""
    ends = prop.extent
    corners = np.array(list(product(*ends[:, :2].T))) @ _make_turn(item).T
    box = np.column_stack([[corners.min(axis=0), corners.max(axis=0)], ends[:, 2]])
    box[:, :2] += np.transpose([item.x_range, item.y_range])
    return box + item.position


def _make_turn(item: SceneObject) -> np.ndarray:
    c, s = np.cos(item.yaw), np.sin(item.yaw)
    return np.array([[c, -s], [s, c]])


def _check_room(task: Task, boxes: dict[str, np.ndarray]) -> None:
    for (one, first), (other, second) in combinations(boxes.items(), 2):
        if _overlap(first, second):
            raise ValueError(f"objects {one!r} and {other!r} overlap, or may where they are drawn")
    for side, (x, y, z, _) in (("left", task.left_base), ("right", task.right_base)):
        body = np.array([[x - BODY, y - BODY, 0.0], [x + BODY, y + BODY, z + BODY_HEIGHT]])
        for name, box in boxes.items():
            if _overlap(box, body):
                raise ValueError(
                    f"object {name!r} stands in the base of the {side} robot at "
                    f"({x:g}, {y:g}), or may where it is drawn"
                )


def _overlap(first: np.ndarray, second: np.ndarray) -> bool:
    return bool((first[0] < second[1]).all() and (second[0] < first[1]).all())


def _check_reach(task: Task, item: SceneObject, prop: Prop) -> None:
    target = prop.landmarks["target"].copy()
    target[:2] = _make_turn(item) @ target[:2]
    bases = np.array([task.left_base[:3], task.right_base[:3]])
    for offset in product(item.x_range, item.y_range, [0.0]):
        place = target + item.position + offset
        away = float(np.linalg.norm(bases - place, axis=1).min())
        if away > REACH:
            raise ValueError(
                f"the target of object {item.name!r} must be within {REACH} m of a robot's base; "
                f"it may be {away:.2f} m away"
            )
