"""The tasks by id; to add one, write its declaration in a file here and list it."""

import difflib

from dgl_tasks.declaration import Task
from dgl_tasks.errors import UnknownTaskError
from dgl_tasks.tasks import (
    fling_dress,
    fling_tops,
    fling_trousers,
    fold_dress,
    fold_tops,
    fold_trousers,
)

_MODULES = (fold_tops, fold_dress, fold_trousers, fling_tops, fling_dress, fling_trousers)
_TASKS: dict[str, Task] = {module.TASK.id: module.TASK for module in _MODULES}


def task_ids() -> tuple[str, ...]:
    """Ids of all tasks, such as "FoldTops-v1"."""
    return tuple(_TASKS)


def get_task(task_id: str) -> Task:
    """Return the declaration of a task.

    Raises:
        UnknownTaskError: Naming the closest id and all valid ones.
    """
    if task_id not in _TASKS:
        close = difflib.get_close_matches(task_id, _TASKS, n=1, cutoff=0.0)
        raise UnknownTaskError(
            f"unknown task {task_id!r}; did you mean {close[0]!r}? Tasks: {', '.join(_TASKS)}"
        )
    return _TASKS[task_id]
