"""Processes that work on a folder together: one run at a time, ended by the one that started them."""

import fcntl
import logging
import multiprocessing
import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import warp

__all__ = ["locked_folder", "prepare_worker"]


@contextmanager
def locked_folder(folder: Path) -> Iterator[None]:
    """Keep other runs from writing to the folder, which is made if it is missing.

    Raises:
        ValueError: If another run is writing to it.
    """
    folder.mkdir(parents=True, exist_ok=True)
    lock = os.open(folder, os.O_RDONLY)
    try:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as err:
            raise ValueError(f"another run is writing to {folder}") from err
        yield
    finally:
        os.close(lock)  # which gives up the lock


def prepare_worker() -> None:
    """Make a process that was started for work end with the one that started it, and only by it."""
    # Ctrl-C reaches every process of a terminal; the one that started the workers ends them.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # Warp greets on standard output, which is for results.
    warp.config.log_level = logging.WARNING
    parent = multiprocessing.parent_process()
    assert parent is not None

    def watch() -> None:
        parent.join()
        os._exit(1)  # a parent that was killed cannot end its workers

    threading.Thread(target=watch, daemon=True).start()
