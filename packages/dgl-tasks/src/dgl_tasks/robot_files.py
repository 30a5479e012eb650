"""The folder of generated robot files, and the error when it cannot be written."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from dgl_tasks.errors import RobotFilesError

CACHE = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "dexgarmentlab"
"""Folder of files that are made once, by `XDG_CACHE_HOME` at the time of import."""
ROBOT_DIRECTORY = CACHE / "robots"
"""Folder of generated robot files."""


@contextmanager
def writing_robot_files() -> Iterator[None]:
    """Name the folder, and how to choose another, where the block cannot write its robot files.

    Raises:
        RobotFilesError: If the block raises an `OSError`, whose `errno` and `filename` it keeps.
    """
    try:
        yield
    except OSError as err:
        told = RobotFilesError(
            f"robot files must be written to {ROBOT_DIRECTORY}, which failed: "
            f"{err.strerror or err}; set XDG_CACHE_HOME to a folder that can be written"
        )
        told.errno, told.filename = err.errno, err.filename
        raise told from err
