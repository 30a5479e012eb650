"""Workers as processes of this machine."""

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
from dgl_collect.workers.jobs import Job, Lost, Message, RunEnded, Work

logger = logging.getLogger(__name__)

ENVIRONMENT = {"OMP_NUM_THREADS": "1"}
"""Set before a worker's first import. One thread in each worker keeps sums in the same order, and
results equal for any number of workers."""
TERMINATE_SECONDS = 2.0
"""Time for a worker to end after SIGTERM, before SIGKILL [s]."""
UNGUARDED = 78
"""Exit status of a worker that imports an unguarded script, which would start workers itself."""
CLOSE_SECONDS = 30.0
"""Time for a worker to release its job runner [s]."""


class LocalWorker:
    """A worker process, as the run sees it."""

    def __init__(self, number: int, work: Work, log_path: Path) -> None:
        self.number = number
        self.is_started = True
        context = multiprocessing.get_context("spawn")
        self.connection, child_end = context.Pipe()
        self._process = context.Process(
            target=_work, args=(work, log_path, child_end), name=f"dgl-worker-{number}", daemon=True
        )
        with _variables(), _interrupts_blocked():
            self._process.start()
        child_end.close()  # the pipe then ends when the worker dies
        self._is_released = False

    def assign(self, job: Job, out_dir: Path) -> None:
        """Hand over a job."""
        try:
            self.connection.send((job, out_dir))
        except OSError:
            logger.warning("worker %d died before %s", self.number, job.name)

    def receive(self) -> Message:
        """Receive one message; `Lost` if the process has died."""
        try:
            return self.connection.recv()
        except (EOFError, OSError):
            how = self._describe_exit()
            if self._process.exitcode == UNGUARDED:
                return RunEnded(
                    reason="workers import the script that starts them: put its calls under "
                    "`if __name__ == '__main__':`"
                )
            return Lost(how=how)

    def release(self) -> None:
        """Let an idle worker end."""
        try:
            self.connection.send(None)
            self._is_released = True
        except OSError:
            pass  # it has ended already

    def kill(self) -> None:
        """End the process: SIGTERM first, then SIGKILL."""
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
        """Wait for the end of the process, and describe it."""
        self._process.join(TERMINATE_SECONDS)
        code = self._process.exitcode
        if code is None:
            return "lost its connection"
        if code < 0:
            return f"killed by {signal.Signals(-code).name}"
        return f"exit status {code}"


class LocalEngine:
    """Starts processes of this machine."""

    def start(self, number: int, work: Work, log_path: Path) -> LocalWorker:
        """Start a process."""
        return LocalWorker(number, work, log_path)

    def hear(self, workers: Sequence[Worker], seconds: float) -> list[tuple[Worker, Message]]:
        """Wait for messages."""
        by_connection = {w.connection: w for w in workers if isinstance(w, LocalWorker)}
        ready = connection.wait(list(by_connection), seconds)
        heard = [w for end, w in by_connection.items() if end in ready]
        return [(worker, worker.receive()) for worker in heard]

    def close(self) -> None:
        """Do nothing: every worker has ended."""


def end_unguarded_import() -> None:
    """End this process if it is a worker that imports an unguarded script; call before a run.

    `LocalWorker.receive` tells the user to guard the script.
    """
    # Set while a spawned process imports the main module; multiprocessing itself checks it too.
    if getattr(multiprocessing.current_process(), "_inheriting", False):
        os._exit(UNGUARDED)


def end_with_parent() -> None:
    """End this process when its parent has ended, for any reason."""
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
    if isinstance(message, RunEnded):
        return
    while (task := channel.recv()) is not None:
        job, out_dir = task
        channel.send(bench.do(job, out_dir))
    bench.close()


@contextmanager
def _variables() -> Iterator[None]:
    """Set environment variables for the process that is started inside only."""
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
    """Block Ctrl-C in the process that is started inside; the parent handles it.

    The mask is inherited, so that it holds from the first moment of the child.
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
