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
        props = {item.name: _make_props(item) for item in task.objects}
        frames = {name: made[0].landmarks for name, made in props.items()}
        for name in (*task.success.frames, *([task.start.on] if task.start.on else [])):
            get_frame(frames, name)
        _check_room(task, {item.name: _bound(item, props[item.name]) for item in task.objects})
        for item in task.objects:
            for prop in props[item.name]:
                _check_reach(task, item, prop)
    except ValueError as err:
        raise ValueError(f"task {task.id}: {err}") from err


def _make_props(item: SceneObject) -> list[Prop]:
    try:
        made = [make_prop(prop) for prop in item.props]
    except ValueError as err:
        raise ValueError(f"object {item.name!r}: {err}") from err
    if any(set(prop.landmarks) != set(made[0].landmarks) for prop in made):
        raise ValueError(f"object {item.name!r}: its props must have landmarks of the same names")
    return made


def _bound(item: SceneObject, props: list[Prop]) -> np.ndarray:
    """Corners of the box that holds an object in all its drawn poses [m], shape (2, 3)."""
    ends = np.stack([prop.extent for prop in props])
    flat = np.concatenate([list(product(*extent[:, :2].T)) for extent in ends])
    corners = np.concatenate([flat @ _make_turn(yaw).T for yaw in _list_yaws(item)])
    heights = [ends[:, 0, 2].min(), ends[:, 1, 2].max()]
    box = np.column_stack([[corners.min(axis=0), corners.max(axis=0)], heights])
    box[:, :2] += np.transpose([item.x_range, item.y_range])
    return box + item.position


def _list_yaws(item: SceneObject) -> np.ndarray:
    """List turns that an object may have, every 5 degrees or less [rad]."""
    low, high = item.yaw_range
    return item.yaw + np.linspace(low, high, 1 + int(np.ceil((high - low) / np.radians(5))))


def _make_turn(yaw: float) -> np.ndarray:
    c, s = np.cos(yaw), np.sin(yaw)
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
    bases = np.array([task.left_base[:3], task.right_base[:3]])
    for yaw, *offset in product(_list_yaws(item), item.x_range, item.y_range, [0.0]):
        target = prop.landmarks["target"].copy()
        target[:2] = _make_turn(yaw) @ target[:2]
        place = target + item.position + offset
        away = float(np.linalg.norm(bases - place, axis=1).min())
        if away > REACH:
            raise ValueError(
                f"the target of object {item.name!r} must be within {REACH} m of a robot's base; "
                f"it may be {away:.2f} m away"
            )
