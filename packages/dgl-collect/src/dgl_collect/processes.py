"""Processes that work on a folder together: one run at a time, ended by the one that started them."""

from __future__ import annotations

import fcntl
import logging
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from itertools import islice
from pathlib import Path
from typing import TypeVar

from dgl_collect.errors import OutputFolderError, WorkerError

__all__ = ["check_continued", "end_with_parent", "locked_folder", "prepare_worker", "run_each"]

T = TypeVar("T")


@contextmanager
def locked_folder(folder: Path) -> Iterator[None]:
    """Keep other runs from writing to the folder, which is made if it is missing.

    Raises:
        OutputFolderError: If another run is writing to it.
    """
    folder.mkdir(parents=True, exist_ok=True)
    lock = os.open(folder, os.O_RDONLY)
    try:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as err:
            raise OutputFolderError(f"another run is writing to {folder}") from err
        yield
    finally:
        os.close(lock)  # which gives up the lock


def check_continued(
    folder: Path, found: Mapping[str, object], identity: Mapping[str, object]
) -> None:
    """Check that a folder's run is the one that is to be continued.

    Args:
        folder: Of the run.
        found: What its file says of the run that is there.
        identity: What must be equal.

    Raises:
        OutputFolderError: If something is not.
    """
    for key, value in identity.items():
        if found.get(key) != value:
            raise OutputFolderError(
                f"cannot resume {folder}: its {key} is {found.get(key)!r}, this run's is {value!r}; "
                "choose another --out"
            )


def run_each(calls: Iterable[Callable[[], T]], workers: int) -> Generator[T, None, None]:
    """Make calls in processes of their own, and give what they return as they end.

    Closing the generator ends the processes, each after the call that it has in hand.

    Args:
        calls: They and what they return have to be picklable. They are taken as they are needed.
        workers: Processes.

    Raises:
        WorkerError: If a process died.
    """
    # A fresh process inherits no locks of threads that the caller may run.
    pool = ProcessPoolExecutor(
        max_workers=workers,
        mp_context=multiprocessing.get_context("spawn"),
        initializer=prepare_worker,
    )
    waiting = iter(calls)
    pending: set[Future[T]] = set()
    try:
        while True:
            room = 2 * workers - len(pending)  # one in hand and one waiting
            pending |= {pool.submit(call) for call in islice(waiting, room)}
            if not pending:
                return
            finished, pending = wait(pending, return_when=FIRST_COMPLETED)
            for future in finished:
                yield future.result()
    except BrokenProcessPool as err:
        raise WorkerError(
            "a worker process died, out of memory or killed; finished garments are kept, and --resume continues"
        ) from err
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def prepare_worker() -> None:
    """Make a process that was started for work end with the one that started it, and only by it."""
    import warp

    # Ctrl-C reaches every process of a terminal; the one that started the workers ends them.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # Warp greets on standard output, which is for results.
    warp.config.log_level = logging.WARNING
    end_with_parent()


def end_with_parent() -> None:
    """End this process when the one that started it is gone, however that ended."""
    parent = multiprocessing.parent_process()
    assert parent is not None

    def watch() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
