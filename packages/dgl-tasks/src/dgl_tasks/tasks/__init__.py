"""The tasks by id: those of this package, and those from files, modules and installed packages.

To add a task here, write its declaration in a file of this folder. A task from outside is a Python
file or module with a declaration named `TASK`; an installed package offers one by an entry point of
the group "dgl_tasks.tasks", named like the task's id.
"""

import hashlib
import importlib
import importlib.util
import pkgutil
import sys
from collections.abc import Callable
from importlib.metadata import entry_points
from pathlib import Path
from types import ModuleType

import gymnasium
from gymnasium.envs.registration import WrapperSpec

from dgl_files.fields import show
from dgl_tasks.declaration import Task
from dgl_tasks.errors import DeclarationError, UnknownTaskError

__all__ = [
    "find_declaration",
    "find_demonstration",
    "get_task",
    "load_task",
    "register_task",
    "task_ids",
]

GROUP = "dgl_tasks.tasks"
"""Group of the entry points of installed packages."""


def task_ids() -> tuple[str, ...]:
    """Ids of all known tasks, such as "FoldTops-v1"; those of installed packages last."""
    return (*_TASKS, *(name for name in _find_installed() if name not in _TASKS))


def get_task(task_id: str) -> Task:
    """Return the declaration of a task.

    Raises:
        UnknownTaskError: Naming the closest id and all valid ones.
        DeclarationError: If an installed package declares it wrongly.
    """
    if not isinstance(task_id, str):
        raise ValueError(
            f"a task must be an id, such as {next(iter(_TASKS))!r}, or a declaration (`Task`); "
            f"got {show(task_id)}"
        )
    if task_id not in _TASKS:
        if task_id not in _find_installed():
            raise UnknownTaskError(task_id, task_ids())
        (entry,) = (e for e in entry_points(group=GROUP) if e.name == task_id)
        task = _load_module(entry.module, show(f"entry point {task_id}"))
        if task.id != task_id:
            raise DeclarationError(
                f"the entry point {task_id!r} must have the task's id as its name; "
                f"{entry.module} declares {task.id!r}"
            )
    return _TASKS[task_id]


def load_task(source: str) -> Task:
    """Find a task, and make its id known to `get_task` and `gymnasium.make` in this process.

    Args:
        source: A known id, a Python file such as "path/to/fold_scarf.py", or a module such as
            "package.fold_scarf"; file and module declare `TASK`.

    Raises:
        UnknownTaskError: If there is nothing of that name.
        DeclarationError: If the file or module declares no task, or one whose id is taken.
    """
    if not isinstance(source, str) or source in task_ids():
        return get_task(source)
    if source.endswith(".py"):
        return _load_file(Path(source))
    parts = source.split(".")
    if all(part.isidentifier() for part in parts) and _has_module(source):
        return _load_module(source, source)
    raise UnknownTaskError(source, task_ids())


def find_declaration(task_id: str) -> Path | None:
    """Give the Python file that declares a task from outside; None for a task of this package."""
    return _FILES.get(task_id)


def find_demonstration(task_id: str) -> Path | None:
    """Give the demonstration of a task from outside: beside its declaration, with the same stem.

    Returns:
        The path, whether or not the file exists; None for a task of this package.
    """
    declaration = find_declaration(task_id)
    return None if declaration is None else declaration.with_suffix(".json")


def register_task(task: Task, *, file: Path | None = None) -> None:
    """Make a task's id known to `get_task` and `gymnasium.make` in this process.

    Args:
        task: The declaration; it replaces an earlier one of the same id that came from outside.
        file: The Python file that declares it.

    Raises:
        DeclarationError: If the id is that of a task of this package, or cannot be an id.
    """
    if not isinstance(task, Task):
        raise DeclarationError(f"TASK must be a `Task`; got {show(task)}")
    if task.id in _BUILT_IN:
        raise DeclarationError(f"the id {task.id!r} is that of a task of dgl_tasks; choose another")
    _register(task.id)
    _TASKS[task.id] = task
    _FILES.pop(task.id, None)
    if file is not None:
        _FILES[task.id] = file


def _register(task_id: str) -> None:
    if task_id in gymnasium.registry:
        return
    try:
        gymnasium.register(
            id=task_id,
            entry_point="dgl_tasks.env:GarmentEnv",
            kwargs={"task": task_id},
            disable_env_checker=True,  # it expects NumPy where ManiSkill gives torch
            additional_wrappers=(
                WrapperSpec("BatchedTimeLimit", "dgl_tasks.time_limit:BatchedTimeLimit", {}),
            ),
        )
    except gymnasium.error.Error as err:
        raise DeclarationError(
            f"the id {task_id!r} must be a name and a version, such as FoldScarf-v1"
        ) from err


def _find_built_in() -> dict[str, Task]:
    found: dict[str, Task] = {}
    for name in sorted(m.name for m in pkgutil.iter_modules(__path__)):
        try:
            task = importlib.import_module(f"{__name__}.{name}").TASK
        except Exception as err:
            raise DeclarationError(f"{name}.py: {type(err).__name__}: {err}") from err
        if task.id in found:
            raise DeclarationError(f"{name}.py: another file declares {task.id!r}, too")
        found[task.id] = task
    return found


def _find_installed() -> tuple[str, ...]:
    return tuple(entry_points(group=GROUP).names)


def _has_module(name: str) -> bool:
    try:
        return importlib.util.find_spec(name) is not None
    except (ImportError, ValueError):
        return False


def _load_module(name: str, source: str) -> Task:
    return _take_task(lambda: importlib.import_module(name), source)


def _load_file(path: Path) -> Task:
    """Run a file as a module of its own; its name follows from the path, for pickles."""
    path = path.expanduser().resolve()
    if not path.is_file():
        raise DeclarationError(f"the file of a task must exist; there is no {path}")
    name = f"dgl_task_{hashlib.sha256(str(path).encode()).hexdigest()[:12]}"

    def run() -> ModuleType:
        spec = importlib.util.spec_from_file_location(name, path)
        assert spec is not None
        assert spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        sys.modules[name] = module
        spec.loader.exec_module(module)
        return module

    return _take_task(run, path.name)


def _take_task(run: Callable[[], ModuleType], source: str) -> Task:
    try:
        module = run()
        task = module.TASK
    except (Exception, SystemExit) as err:
        what = str(err).partition("\n")[0]
        raise DeclarationError(f"{source}: {type(err).__name__}: {what}") from err
    try:
        register_task(task, file=Path(module.__file__) if module.__file__ else None)
    except DeclarationError as err:
        raise DeclarationError(f"{source}: {err}") from err
    return task


_TASKS = _find_built_in()
_BUILT_IN = frozenset(_TASKS)
_FILES: dict[str, Path] = {}

for _id in task_ids():
    _register(_id)
