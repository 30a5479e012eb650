"""The folder of generated robot files, and the error when it cannot be written."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from dgl_tasks.errors import RobotFilesError


def find_robot_directory() -> Path:
    """Give the folder of robot files, in `$XDG_CACHE_HOME` or else in `~/.cache`."""
    base = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    return Path(base) / "dexgarmentlab" / "robots"


DEFAULT_ROBOT_DIRECTORY = find_robot_directory()
"""Folder of generated robot files, by `XDG_CACHE_HOME` at the time of import."""


@contextmanager
def writing_robot_files(directory: Path | str) -> Iterator[None]:
    """Name the folder, and how to choose another, where the block cannot write its robot files.

    Raises:
        RobotFilesError: If the block raises an `OSError`, whose `errno` and `filename` it keeps.
    """
    try:
        yield
    except OSError as err:
        is_default = Path(directory) == DEFAULT_ROBOT_DIRECTORY
        way_on = "set XDG_CACHE_HOME" if is_default else "set the directory of robot files"
        told = RobotFilesError(
            f"robot files must be written to {directory}, which failed: {err.strerror or err}; "
            f"{way_on} to a folder that can be written"
        )
        told.errno, told.filename = err.errno, err.filename
        raise told from err
