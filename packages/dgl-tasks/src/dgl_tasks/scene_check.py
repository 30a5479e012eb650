"""Checks of a declaration's scene, before anything is simulated."""

from collections.abc import Mapping
from itertools import combinations

import numpy as np

from dgl_assets.props import Prop, make_prop
from dgl_tasks.declaration import SceneObject, Task

BODY, BODY_HEIGHT = 0.15, 0.6
"""Half width of the body around a robot's base, and its height above it [m]."""
REACH = 1.6
"""Reach of a grasp point from the base of an arm [m]: 1.3 of the UR10e, and the hand."""


def get_frame(frames: Mapping[str, Mapping[str, np.ndarray]], name: str) -> np.ndarray:
    """Look up a frame of an object, such as "stand.top" [m], shape (3,).

    Raises:
        ValueError: If there is no such object, or it has no such frame.
    """
    owner, _, place = name.partition(".")
    if owner not in frames:
        raise ValueError(f"{name!r}: there is no object {owner!r}; there are {sorted(frames)}")
    if place not in frames[owner]:
        raise ValueError(
            f"{name!r}: {owner} has no frame {place!r}; it has {sorted(frames[owner])}"
        )
    return frames[owner][place]


def check_scene(task: Task) -> None:
    """Check the objects of a task.

    Raises:
        ValueError: If the start or the rule names an unknown frame, two objects may overlap,
            or one may stand in a robot or is out of reach.
    """
    props: dict[str, Prop] = {}
    for item in task.objects:
        try:
            props[item.name] = make_prop(item.prop)
        except ValueError as err:
            raise ValueError(f"task {task.id}, object {item.name!r}: {err}") from err
    frames = {name: prop.landmarks for name, prop in props.items()}
    for name in (*task.success.frames, *([task.start.on] if task.start.on else [])):
        try:
            get_frame(frames, name)
        except ValueError as err:
            raise ValueError(f"task {task.id}: {err}") from err
    boxes = {item.name: _bound(item, props[item.name]) for item in task.objects}
    for (one, first), (other, second) in combinations(boxes.items(), 2):
        if (first[0] < second[1]).all() and (second[0] < first[1]).all():
            raise ValueError(
                f"task {task.id}: objects {one!r} and {other!r} overlap, or may where they are "
                "drawn"
            )
    for side, (x, y, z, _) in (("left", task.left_base), ("right", task.right_base)):
        low, high = (x - BODY, y - BODY, 0.0), (x + BODY, y + BODY, z + BODY_HEIGHT)
        for name, box in boxes.items():
            if (box[0] < high).all() and (low < box[1]).all():
                raise ValueError(
                    f"task {task.id}: object {name!r} stands in the base of the {side} robot at "
                    f"({x:g}, {y:g}), or may where it is drawn"
                )
    for item in task.objects:
        _check_reach(task, item, props[item.name])


def _bound(item: SceneObject, prop: Prop) -> np.ndarray:
    """Corners of the box that holds an object in all its drawn poses [m], shape (2, 3)."""
    low, high = prop.extent
    c, s = np.cos(item.yaw), np.sin(item.yaw)
    corners = np.array([[x, y] for x in (low[0], high[0]) for y in (low[1], high[1])])
    turned = corners @ np.array([[c, s], [-s, c]])
    low = np.array([*turned.min(axis=0), low[2]]) + item.position
    high = np.array([*turned.max(axis=0), high[2]]) + item.position
    low[:2] += (item.x_range[0], item.y_range[0])
    high[:2] += (item.x_range[1], item.y_range[1])
    return np.stack([low, high])


def _check_reach(task: Task, item: SceneObject, prop: Prop) -> None:
    c, s = np.cos(item.yaw), np.sin(item.yaw)
    x, y, z = prop.landmarks["target"]
    target = np.add(item.position, (c * x - s * y, s * x + c * y, z))
    bases = np.array([task.left_base[:3], task.right_base[:3]])
    for dx in item.x_range:
        for dy in item.y_range:
            away = float(np.linalg.norm(bases - (target + np.array([dx, dy, 0.0])), axis=1).min())
            if away > REACH:
                raise ValueError(
                    f"task {task.id}: the target of object {item.name!r} must be within {REACH} m "
                    f"of a robot's base; it may be {away:.2f} m away"
                )
