"""The tasks by id; to add one, write its declaration in a file here."""

import difflib
import importlib
import pkgutil

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
        raise UnknownTaskError(
            f"a task must be an id, such as {next(iter(_TASKS))!r}, or a declaration (`Task`); got {task_id!r}"
        )
    if task_id not in _TASKS:
        close = difflib.get_close_matches(task_id, _TASKS, n=1, cutoff=0.0)
        raise UnknownTaskError(
            f"unknown task {task_id!r}; did you mean {close[0]!r}? Tasks: {', '.join(_TASKS)}"
        )
    return _TASKS[task_id]
