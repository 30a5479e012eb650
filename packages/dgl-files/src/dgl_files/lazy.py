"""Public names of a package that are imported when they are first used."""

import re
from collections.abc import Callable
from importlib import import_module
from pathlib import Path

_EXPORT = re.compile(r"^    from (\S+) import (\w+) as \2$", re.MULTILINE)


def export_lazily(package: str, file: str) -> tuple[list[str], Callable[[str], object]]:
    """Make `__all__` and `__getattr__` of a package, so that options load without what they run.

    Args:
        package: Name of the package.
        file: Its `__init__.py`. Under `if TYPE_CHECKING:`, each export is one line such as
            `from a.b import name as name`, which type checkers and this function read.

    Returns:
        The names, and a function that imports one.
    """
    modules = {name: module for module, name in _EXPORT.findall(Path(file).read_text("utf-8"))}

    def get(name: str) -> object:
        if name not in modules:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        return getattr(import_module(modules[name]), name)

    return list(modules), get
