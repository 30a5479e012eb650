"""Workers as processes of this machine."""

import logging
import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from multiprocessing import connection, resource_tracker
from multiprocessing.connection import Connection
from pathlib import Path

from dgl_collect.errors import WorkerError
from dgl_collect.workers.engine import Answer, Lost, Worker
from dgl_collect.workers.inside import ENVIRONMENT, Workbench, print_to
from dgl_collect.workers.jobs import Job, Work

logger = logging.getLogger(__name__)

TERMINATE_SECONDS = 2.0
"""Time for a worker to end after SIGTERM, before SIGKILL [s]."""
CLOSE_SECONDS = 30.0
"""Time for a worker to release its job runner [s]."""
UNGUARDED = 78
"""Exit status of a worker that imports an unguarded script, which would start workers itself."""


class LocalWorker(Worker):
    """A worker process, as the run sees it."""

    def __init__(self, number: int, work: Work, log_path: Path) -> None:
        super().__init__(number)
        context = multiprocessing.get_context("spawn")
        self.connection, child_end = context.Pipe()
        self._process = context.Process(
            target=_work, args=(work, log_path, child_end), name=f"dgl-worker-{number}", daemon=True
        )
        with _inheritance():
            self._process.start()
        self.since = time.monotonic()
        child_end.close()  # the pipe then ends when the worker dies
        self._is_released = False

    def _send(self, job: Job, out_dir: Path) -> None:
        try:
            self.connection.send((job, out_dir))
        except OSError:
            logger.warning("worker %d died before %s", self.number, job.name)

    def receive(self) -> Answer:
        """Receive one answer; `Lost` if the process has died."""
        try:
            return self.connection.recv()
        except (EOFError, OSError):
            self._process.join(TERMINATE_SECONDS)
        code = self._process.exitcode
        if code == UNGUARDED:
            return WorkerError(
                "workers import the script that starts them: put its calls under "
                "`if __name__ == '__main__':`"
            )
        if code is None:
            return Lost(how="lost its connection")
        return Lost(
            how=f"killed by {signal.Signals(-code).name}" if code < 0 else f"exit status {code}"
        )

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


class LocalEngine:
    """Starts processes of this machine."""

    def start(self, number: int, work: Work, log_path: Path) -> LocalWorker:
        """Start a process."""
        return LocalWorker(number, work, log_path)

    def hear(self, workers: Sequence[Worker], seconds: float) -> list[tuple[Worker, Answer]]:
        """Wait for answers."""
        by_connection = {w.connection: w for w in workers if isinstance(w, LocalWorker)}
        ready = connection.wait(list(by_connection), seconds)
        return [(worker, worker.receive()) for end, worker in by_connection.items() if end in ready]

    def close(self) -> None:
        """Do nothing: every worker has ended."""


def end_unguarded_import() -> None:
    """End this process if it is a worker that imports an unguarded script; call before a run.

    `LocalWorker.receive` tells the user to guard the script.
    """
    # Set while a spawned process imports the main module; multiprocessing itself checks it too.
    if getattr(multiprocessing.current_process(), "_inheriting", False):
        os._exit(UNGUARDED)


def _work(work: Work, log_path: Path, channel: Connection) -> None:
    """Run a worker process until it is told to stop."""
    print_to(log_path)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    bench = Workbench(work)
    answer = bench.build()
    channel.send(answer)
    while not isinstance(answer, Exception) and (task := channel.recv()) is not None:
        answer = bench.do(*task)
        channel.send(answer)
    bench.close()


def _end_with_parent() -> None:
    """End this process when its parent has ended, for any reason."""
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)


@contextmanager
def _inheritance() -> Iterator[None]:
    """Set `ENVIRONMENT` and block Ctrl-C for the process that is started inside only.

    The parent handles Ctrl-C. The mask is inherited, so that it holds from the first moment of the
    child.
    """
    resource_tracker.ensure_running()  # would be started with the worker, and lift the mask
    variables = {name: os.environ.get(name) for name in ENVIRONMENT}
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    os.environ.update(ENVIRONMENT)
    try:
        yield
    finally:
        for name, value in variables.items():
            del os.environ[name]
            if value is not None:
                os.environ[name] = value
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
