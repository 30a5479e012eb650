"""The tasks by id; to add one, write its declaration in a file here."""

import difflib
import importlib
import pkgutil

from dgl_tasks.declaration import Task
from dgl_tasks.errors import UnknownTaskError


def _find_tasks() -> dict[str, Task]:
    names = sorted(m.name for m in pkgutil.iter_modules(__path__) if not m.name.startswith("_"))
    tasks = [importlib.import_module(f"{__name__}.{name}").TASK for name in names]
    return {task.id: task for task in tasks}


_TASKS = _find_tasks()


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
