"""A worker: a process that builds its environment once and makes many attempts."""

from __future__ import annotations

import dataclasses
import gc
import logging
import multiprocessing
import os
import signal
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection
from pathlib import Path

from dgl_collect.attempts import AttemptRunner, load_factory
from dgl_collect.processes import end_with_parent
from dgl_collect.results import AttemptResult

logger = logging.getLogger(__name__)

TERMINATE_SECONDS = 2.0
"""How long a worker may take to end after a polite signal [s]."""
CLOSE_SECONDS = 30.0
"""How long a worker may take to release its environment [s]."""


@dataclass(frozen=True, kw_only=True)
class Job:
    """One attempt to make."""

    index: int
    seed: int
    episode_id: str
    out_dir: Path


@dataclass(frozen=True, kw_only=True)
class WorkerConfig:
    """What a worker needs to build its environment."""

    task: str
    attempt_factory: str
    options: Mapping[str, object]
    log_path: Path
    """Receives everything that the worker prints, tracebacks included."""
    has_episodes: bool
    """Whether a success must leave an episode file."""
    environment: Mapping[str, str]
    """Environment variables that must be set before the worker's first import."""


@dataclass(frozen=True)
class Ready:
    """The worker has built its environment."""


@dataclass(frozen=True)
class StartFailed:
    """The worker could not build its environment."""

    reason: str


class Worker:
    """The parent's side of a worker process."""

    def __init__(self, number: int, config: WorkerConfig) -> None:
        self.number = number
        self.log_path = config.log_path
        self.is_ready = False
        self.job: Job | None = None
        self.busy_since = time.monotonic()  # [s]; it begins with building its environment
        context = multiprocessing.get_context("spawn")
        self.connection, child_end = context.Pipe()
        self._process = context.Process(
            target=_work, args=(config, child_end), name=f"dgl-worker-{number}", daemon=True
        )
        with _variables(config.environment), _interrupts_blocked():
            self._process.start()
        child_end.close()  # so that the worker's death is seen as the end of the pipe

    def assign(self, job: Job) -> None:
        """Hand over an attempt; a worker that has died meanwhile is noticed when it is read from."""
        job.out_dir.mkdir(parents=True)
        self.job, self.busy_since = job, time.monotonic()
        try:
            self.connection.send(job)
        except OSError:
            logger.warning("worker %d died before attempt %d", self.number, job.index)

    def describe_exit(self) -> str:
        """Wait for the end of the process and say how it ended."""
        self._process.join(TERMINATE_SECONDS)
        code = self._process.exitcode
        if code is None:
            return "lost its connection"
        if code < 0:
            return f"killed by {signal.Signals(-code).name}"
        return f"exit status {code}"

    def stop(self) -> None:
        """Let an idle worker release its environment and end."""
        try:
            self.connection.send(None)
            self._process.join(CLOSE_SECONDS)
        except OSError:
            pass  # it has ended already
        self.kill()

    def terminate(self) -> None:
        """Ask the process to end at once; `kill` waits for it."""
        self._process.terminate()

    def kill(self) -> None:
        """End the process and wait until it has ended."""
        if self._process.is_alive():
            self._process.terminate()
            self._process.join(TERMINATE_SECONDS)
        if self._process.is_alive():
            self._process.kill()
        self._process.join()
        self.connection.close()


@contextmanager
def _variables(values: Mapping[str, str]) -> Iterator[None]:
    """Set environment variables for the process that is started inside, and for nothing else."""
    before = {name: os.environ.get(name) for name in values}
    os.environ.update(values)
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


def _work(config: WorkerConfig, connection: Connection) -> None:
    """Run a worker process until it is told to stop."""
    _print_to(config.log_path)
    end_with_parent()
    runner = None
    try:
        with _kept_for_good():
            factory = load_factory(config.attempt_factory)
        runner = factory(config.task, config.options)
    except Exception as err:
        logger.exception("the environment cannot be built")
        connection.send(StartFailed(f"{type(err).__name__}: {err}"))
        return
    connection.send(Ready())
    while (job := connection.recv()) is not None:
        if runner is None:
            runner = factory(config.task, config.options)
        logger.info("attempt %d, seed %d", job.index, job.seed)
        started = time.monotonic()
        try:
            result = _attempt(runner, job, has_episodes=config.has_episodes)
        except Exception as err:
            logger.exception("attempt %d raised", job.index)
            result = AttemptResult(
                index=job.index,
                seed=job.seed,
                success=False,
                reason=f"exception: {type(err).__name__}",
                detail=str(err),
            )
            _close(runner)
            runner = None  # its state is unknown: the next attempt gets a new environment
        connection.send(dataclasses.replace(result, seconds=time.monotonic() - started))
    if runner is not None:
        _close(runner)


def _attempt(runner: AttemptRunner, job: Job, *, has_episodes: bool) -> AttemptResult:
    """Make one attempt and check that its outcome is what was asked for."""
    result = runner.run(
        attempt_index=job.index, seed=job.seed, out_dir=job.out_dir, episode_id=job.episode_id
    )
    if (result.index, result.seed) != (job.index, job.seed):
        raise ValueError(
            f"result must be of attempt {job.index}, seed {job.seed}; "
            f"got {result.index}, seed {result.seed}"
        )
    if has_episodes and result.success and "episode" not in result.files:
        raise ValueError(f"a success must have an episode file; got {sorted(result.files)}")
    for kind, name in result.files.items():
        path = job.out_dir / name
        if path.parent != job.out_dir or path.stem != job.episode_id:
            raise ValueError(f"{kind} file must be {job.episode_id}.* in its folder; got {name!r}")
        if not path.is_file():
            raise ValueError(f"{kind} file must exist; {name!r} does not")
    return result


def _close(runner: AttemptRunner) -> None:
    try:
        runner.close()
    except Exception:  # the worker is done with it either way
        logger.exception("the environment cannot be closed")


@contextmanager
def _kept_for_good() -> Iterator[None]:
    """Spare the garbage collector what is made inside, and all there is already.

    Modules hold a million objects that live as long as the process. Walking through them takes 1 s while they are
    imported, and 0.2 s every time ManiSkill collects garbage.
    """
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        gc.enable()


def _print_to(path: Path) -> None:
    """Send standard output and error of this process, native libraries included, to a log."""
    descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND)
    sys.stdout.flush()
    sys.stderr.flush()
    os.dup2(descriptor, 1)
    os.dup2(descriptor, 2)
    os.close(descriptor)
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(levelname)s %(message)s")
