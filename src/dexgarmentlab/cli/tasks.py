"""Verb `dgl tasks`."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from math import degrees
from typing import TYPE_CHECKING, Annotated, Any

import tyro  # noqa: TID253 - marks the positional argument; the command line imports it anyway

from dexgarmentlab.cli import EXIT_OK, console
from dexgarmentlab.cli.flags import find_task

if TYPE_CHECKING:
    from dgl_tasks.declaration import Task

__all__ = ["TasksOptions", "describe_task", "run"]

SPLITS = ("train", "test")


@dataclass(frozen=True, kw_only=True)
class TasksOptions:
    """Show the tasks: category, stages, success rule, garments and where the robots stand.

    Example: dgl tasks --json
    """

    sources: Annotated[tuple[str, ...], tyro.conf.Positional, tyro.conf.arg(metavar="TASK")] = ()
    """Ids, or files or modules of your own that declare a task; all known tasks when not given."""
    json: bool = False
    """Write the result as JSON."""


def run(options: TasksOptions) -> int:
    """Write every task with what its declaration says."""
    from dgl_tasks import task_ids

    tasks = [describe_task(find_task(source)) for source in options.sources or task_ids()]
    if options.json:
        console.out_json({"tasks": tasks})
    else:
        console.out("\n\n".join("\n".join(_lines(task)) for task in tasks))
    return EXIT_OK


def describe_task(task: "Task") -> dict[str, Any]:
    """Put what a user wants to know of a task into plain values; lengths [m], angles [rad]."""
    from dgl_assets.props import make_prop
    from dgl_collect import DemonstrationError
    from dgl_collect.demonstration import load_demonstration
    from dgl_tasks.task_garment import list_task_garments

    stages, lacks = (), None
    try:
        stages = load_demonstration(task).stages
    except DemonstrationError as err:  # of a task that is being added
        lacks = str(err)
    return {
        "id": task.id,
        "title": task.title,
        "description": task.description,
        "category": task.category,
        "garments": {split: len(list_task_garments(task, split)) for split in SPLITS},
        "objects": [
            {
                "name": item.name,
                "kind": make_prop(item.props[0]).kind,
                "variants": len(item.props),
                "x": [item.position[0] + dx for dx in item.x_range],
                "y": [item.position[1] + dy for dy in item.y_range],
                "yaw": [item.yaw + turn for turn in item.yaw_range],
            }
            for item in task.objects
        ],
        "stages": [
            {
                "name": stage.name,
                "grasp": {side: list(grasp.points) for side, grasp in stage.grasp.items()},
                "orientation": _tell(stage.approach.orientation),
                "learned": stage.is_learned,
            }
            for stage in stages
        ],
        "lacks": lacks,
        "success": task.success_text,
        "garment_position": {
            "x": list(task.start.x_range),
            "y": list(task.start.y_range),
            "on": task.start.on,
        },
        "robot_bases": {"left": list(task.left_base), "right": list(task.right_base)},
    }


def _tell(orientation: object) -> object:
    return orientation if isinstance(orientation, str) else asdict(orientation)  # pyright: ignore[reportArgumentType]


def _lines(task: dict[str, Any]) -> list[str]:
    garments = ", ".join(f"{count:,} for {split}ing" for split, count in task["garments"].items())
    stages = [
        f"{number}. {stage['name']}: "
        + ", ".join(
            f"{side} hand at {' / '.join(names) or 'a place that the shape tells'}"
            for side, names in stage["grasp"].items()
        )
        for number, stage in enumerate(task["stages"], start=1)
    ]
    bases = [
        f"{side} ({x:g}, {y:g}, {z:g}) m, yaw {yaw:g} rad"
        for side, (x, y, z, yaw) in task["robot_bases"].items()
    ]
    start = task["garment_position"]
    place = _place(start) if start["on"] is None else f"on {start['on']}"
    objects = [
        f"{item['name']} ({item['kind']}{_of(item['variants'])}), {_place(item)}"
        for item in task["objects"]
    ]
    rows = [
        ("garments", f"{task['category']}, {garments}"),
        ("position", place),
        *_label("objects", objects),
        *_label("stages", stages or [task["lacks"]]),
        ("success", task["success"]),
        ("robots", "; ".join(bases)),
    ]
    return [
        f"{task['id']}  {task['title']}",
        f"  {task['description']}",
        *(f"  {name:<8}  {text}" for name, text in rows),
    ]


def _place(item: dict[str, Any]) -> str:
    """Describe the ranges of a place, and of a turn that is drawn."""
    place = [f"{axis} {item[axis][0]:g} to {item[axis][1]:g} m" for axis in ("x", "y")]
    low, high = (round(degrees(turn), 1) for turn in item.get("yaw", (0.0, 0.0)))
    return ", ".join([*place, *([f"yaw {low:g} to {high:g} degrees"] if low < high else [])])


def _of(variants: int) -> str:
    return f", one of {variants}" if variants > 1 else ""


def _label(label: str, texts: Sequence[str]) -> list[tuple[str, str]]:
    """Give rows of texts, of which the first has a label."""
    return [(label if k == 0 else "", text) for k, text in enumerate(texts)]
