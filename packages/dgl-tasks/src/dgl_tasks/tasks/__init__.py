"""The tasks by id; to add one, write its declaration in a file here."""

import importlib
import pkgutil

from dgl_files.fields import show
from dgl_tasks.declaration import Task
from dgl_tasks.errors import DeclarationError, UnknownTaskError


def _find_tasks() -> dict[str, Task]:
    found: dict[str, Task] = {}
    for name in sorted(m.name for m in pkgutil.iter_modules(__path__)):
        if name.startswith("_"):
            continue
        try:
            task = importlib.import_module(f"{__name__}.{name}").TASK
        except Exception as err:
            raise DeclarationError(f"{name}.py: {type(err).__name__}: {err}") from err
        if task.id in found:
            raise DeclarationError(f"{name}.py: another file declares {task.id!r}, too")
        found[task.id] = task
    return found


_TASKS = _find_tasks()


def task_ids() -> tuple[str, ...]:
    """Ids of all tasks, such as "FoldTops-v1"."""
    return tuple(_TASKS)


def get_task(task_id: str) -> Task:
    """Return the declaration of a task.

    Raises:
        UnknownTaskError: Naming the closest id and all valid ones.
    """
    if not isinstance(task_id, str):
        raise ValueError(
            f"a task must be an id, such as {next(iter(_TASKS))!r}, or a declaration (`Task`); "
            f"got {show(task_id)}"
        )
    if task_id not in _TASKS:
        raise UnknownTaskError(task_id, task_ids())
    return _TASKS[task_id]
