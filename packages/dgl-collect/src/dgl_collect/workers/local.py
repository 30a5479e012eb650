"""Workers that are processes of this machine."""

from __future__ import annotations

import logging
import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from multiprocessing import connection, resource_tracker
from multiprocessing.connection import Connection
from pathlib import Path

from dgl_collect.workers.engine import Worker
from dgl_collect.workers.inside import Workbench
from dgl_collect.workers.jobs import Job, Lost, Message, StartFailed, Work

logger = logging.getLogger(__name__)

ENVIRONMENT = {"OMP_NUM_THREADS": "1"}
"""Set before a worker's first import. Workers are the parallelism: one thread in each keeps sums in the same order, and
so results equal, whatever the number of workers."""
TERMINATE_SECONDS = 2.0
"""How long a worker may take to end after a polite signal [s]."""
UNGUARDED = 78
"""Exit status of a process that was started by a worker's import of the script that starts workers."""
CLOSE_SECONDS = 30.0
"""How long a worker may take to release its job runner [s]."""


class LocalWorker:
    """The run's side of a worker process."""

    def __init__(self, number: int, work: Work, log_path: Path) -> None:
        self.number = number
        self.has_place = True
        context = multiprocessing.get_context("spawn")
        self.connection, child_end = context.Pipe()
        self._process = context.Process(
            target=_work, args=(work, log_path, child_end), name=f"dgl-worker-{number}", daemon=True
        )
        with _variables(), _interrupts_blocked():
            self._process.start()
        child_end.close()  # so that the worker's death is seen as the end of the pipe
        self._is_released = False

    def assign(self, job: Job, out_dir: Path) -> None:
        """Hand over a job; see `Worker`."""
        try:
            self.connection.send((job, out_dir))
        except OSError:
            logger.warning("worker %d died before %s", self.number, job.name)

    def receive(self) -> Message:
        """Take one message, or notice that the process has died."""
        try:
            return self.connection.recv()
        except (EOFError, OSError):
            how = self._describe_exit()
            if self._process.exitcode == UNGUARDED:
                return StartFailed(
                    reason="workers import the script that starts them: put its calls under "
                    "`if __name__ == '__main__':`"
                )
            return Lost(how=how)

    def release(self) -> None:
        """Let an idle worker end; see `Worker`."""
        try:
            self.connection.send(None)
            self._is_released = True
        except OSError:
            pass  # it has ended already

    def kill(self) -> None:
        """End the process; see `Worker`."""
        if self._is_released:
            self._process.join(CLOSE_SECONDS)
        if self._process.is_alive():
            self._process.terminate()
            self._process.join(TERMINATE_SECONDS)
        if self._process.is_alive():
            self._process.kill()
        self._process.join()
        self.connection.close()

    def _describe_exit(self) -> str:
        """Wait for the end of the process and say how it ended."""
        self._process.join(TERMINATE_SECONDS)
        code = self._process.exitcode
        if code is None:
            return "lost its connection"
        if code < 0:
            return f"killed by {signal.Signals(-code).name}"
        return f"exit status {code}"


class LocalEngine:
    """Starts processes of this machine; see `Engine`."""

    def start(self, number: int, work: Work, log_path: Path) -> LocalWorker:
        """Start a process; see `Engine`."""
        return LocalWorker(number, work, log_path)

    def hear(self, workers: Sequence[Worker], seconds: float) -> list[tuple[Worker, Message]]:
        """Wait for messages; see `Engine`."""
        by_connection = {w.connection: w for w in workers if isinstance(w, LocalWorker)}
        ready = connection.wait(list(by_connection), seconds)
        heard = [by_connection[end] for end in ready]  # pyright: ignore[reportArgumentType] - these are connections
        return [(worker, worker.receive()) for worker in heard]

    def close(self) -> None:
        """Nothing is left to end."""


def end_unguarded_import() -> None:
    """End this process if it is a worker that is importing the script that has started it, and would start more.

    To be called before a run begins. `LocalWorker` tells what is to be done.
    """
    # Set while the modules of a spawned process are prepared; multiprocessing itself looks at it for the same reason.
    if getattr(multiprocessing.current_process(), "_inheriting", False):
        os._exit(UNGUARDED)


def end_with_parent() -> None:
    """End this process when the one that started it is gone, however that ended."""
    parent = multiprocessing.parent_process()
    assert parent is not None

    def watch() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def _work(work: Work, log_path: Path, channel: Connection) -> None:
    """Run a worker process until it is told to stop."""
    print_to(log_path)
    end_with_parent()
    bench = Workbench(work)
    message = bench.build()
    channel.send(message)
    if isinstance(message, StartFailed):
        return
    while (task := channel.recv()) is not None:
        job, out_dir = task
        channel.send(bench.do(job, out_dir))
    bench.close()


@contextmanager
def _variables() -> Iterator[None]:
    """Set environment variables for the process that is started inside, and for nothing else."""
    before = {name: os.environ.get(name) for name in ENVIRONMENT}
    os.environ.update(ENVIRONMENT)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


@contextmanager
def _interrupts_blocked() -> Iterator[None]:
    """Start a process that never sees Ctrl-C: the parent decides what it means.

    The mask is inherited, so that not even the first moments of the child are exposed.
    """
    resource_tracker.ensure_running()  # would be started with the worker, and lift the mask
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def print_to(path: Path) -> None:
    """Send standard output and error of this process, native libraries included, to a log."""
    descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND)
    sys.stdout.flush()
    sys.stderr.flush()
    os.dup2(descriptor, 1)
    os.dup2(descriptor, 2)
    os.close(descriptor)
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(levelname)s %(message)s")
