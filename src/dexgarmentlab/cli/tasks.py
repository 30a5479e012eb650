"""Verb `dgl tasks`."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from dexgarmentlab.cli import EXIT_OK, console

if TYPE_CHECKING:
    from dgl_tasks.declaration import Task

__all__ = ["Options", "describe_task", "run"]

SPLITS = ("train", "test")


@dataclass(frozen=True, kw_only=True)
class Options:
    """Show the tasks: category, stages, success rule, garments and where the robots stand.

    Example: dgl tasks --json
    """

    json: bool = False
    """Write the result as JSON."""


def run(options: Options) -> int:
    """Write every task with what its declaration says."""
    from dgl_tasks import get_task, task_ids

    tasks = [describe_task(get_task(task_id)) for task_id in task_ids()]
    if options.json:
        console.out_json({"tasks": tasks})
    else:
        console.out("\n\n".join("\n".join(_lines(task)) for task in tasks))
    return EXIT_OK


def describe_task(task: "Task") -> dict[str, Any]:
    """Put what a user wants to know of a task into plain values; lengths [m], angles [rad]."""
    from dgl_assets import garment_ids
    from dgl_collect.demonstration import load_demonstration

    return {
        "id": task.id,
        "title": task.title,
        "description": task.description,
        "category": task.category,
        "garments": {split: len(garment_ids(task.category, split)) for split in SPLITS},
        "objects": [item.name for item in task.objects],
        "stages": [
            {
                "name": stage.name,
                "grasp": {
                    side: list(grasp.points or ("where its shape says",))
                    for side, grasp in stage.grasp.items()
                },
                "orientation": stage.approach.orientation,
                "learned": stage.is_learned,
            }
            for stage in load_demonstration(task.id).stages
        ],
        "success": task.success_text,
        "garment_position": {"x": list(task.start.x_range), "y": list(task.start.y_range)},
        "robot_bases": {"left": list(task.left_base), "right": list(task.right_base)},
    }


def _lines(task: dict[str, Any]) -> list[str]:
    garments = ", ".join(f"{count:,} for {split}ing" for split, count in task["garments"].items())
    stages = [
        f"{number}. {stage['name']}: "
        + ", ".join(f"{side} hand at {' / '.join(names)}" for side, names in stage["grasp"].items())
        for number, stage in enumerate(task["stages"], start=1)
    ]
    bases = [
        f"{side} ({x:g}, {y:g}, {z:g}) m, yaw {yaw:g} rad"
        for side, (x, y, z, yaw) in task["robot_bases"].items()
    ]
    place = ", ".join(
        f"{axis} {low:g} to {high:g} m" for axis, (low, high) in task["garment_position"].items()
    )
    rows = [
        ("garments", f"{task['category']}, {garments}"),
        ("position", place),
        *((("objects", ", ".join(task["objects"])),) if task["objects"] else ()),
        ("stages", stages[0]),
        *(("", stage) for stage in stages[1:]),
        ("success", task["success"]),
        ("robots", "; ".join(bases)),
    ]
    return [
        f"{task['id']}  {task['title']}",
        f"  {task['description']}",
        *(f"  {name:<8}  {text}" for name, text in rows),
    ]
