"""The garment of an episode: any that a task can judge."""

from pathlib import Path

from dgl_assets import Garment
from dgl_assets.garments.catalogue import Split, garment_ids
from dgl_assets.importing import AnyGarment, ImportedGarment, find_garment
from dgl_tasks.declaration import Task

__all__ = ["find_task_garment", "list_task_garments", "name_garment"]


def list_task_garments(task: Task, split: Split) -> tuple[str, ...]:
    """List the ids of the catalogue's garments that episodes of a task draw from."""
    return garment_ids(task.category, split, measures=task.measures)


def find_task_garment(source: str | Path | AnyGarment, task: Task) -> AnyGarment:
    """Make or load a garment, and check that a task is about it and can judge it.

    Args:
        source: A catalogue id, the folder of an imported garment, or a garment.
        task: The task.

    Raises:
        ValueError: If the garment is of another category, or lacks places that the rule judges by.
        AssetError: If there is no such garment, or its files are broken.
    """
    garment = source if isinstance(source, (Garment, ImportedGarment)) else find_garment(source)
    if garment.category != task.category:
        raise ValueError(
            f"garment must be of category {task.category}; got {garment.name}, a {garment.category}"
        )
    rule = task.success
    unknown = sorted({*rule.landmarks, *rule.marks} - set(garment.landmarks))
    if unknown:
        is_own = isinstance(garment, ImportedGarment)
        hint = " (dgl_collect.own_garment.prepare_garment finds them)" if is_own else ""
        raise ValueError(
            f"task {task.id}: the rule judges by {unknown}; {garment.name} has "
            f"{sorted(garment.landmarks)}{hint}"
        )
    return garment


def name_garment(source: str | Path | AnyGarment) -> str:
    """Name a garment so that it is found again: its id, or its folder."""
    return source.name if isinstance(source, (Garment, ImportedGarment)) else str(source)
