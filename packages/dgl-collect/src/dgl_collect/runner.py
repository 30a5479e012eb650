"""Collection: many attempts at a task, by one or more worker processes."""

from __future__ import annotations

import json
import logging
import signal
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from multiprocessing import connection
from pathlib import Path

import numpy as np

from dgl_collect.errors import UnknownTaskError, WorkerError
from dgl_collect.results import AttemptResult, Summary
from dgl_collect.run_folder import RunFolder
from dgl_collect.worker import Job, Ready, StartFailed, Worker, WorkerConfig

logger = logging.getLogger(__name__)

POLL_SECONDS = 0.2
"""How often time limits and interrupts are looked at [s]."""


@dataclass(frozen=True, kw_only=True)
class CollectConfig:
    """What to collect.

    Raises:
        ValueError: If a number is out of its range or the options are not JSON-ready.
    """

    task: str
    """Environment id, such as `FoldTops-v1`."""
    episodes: int
    """Attempts to make, at least 1; how many of them succeed is a result."""
    out: Path
    """Output folder; empty or missing, unless `resume`."""
    seed: int = 0
    """Seed of the run, at least 0; every attempt's seed follows from it and the attempt's number."""
    workers: int = 1
    """Processes, at least 1. The results do not depend on it."""
    resume: bool = False
    """Continue the run in `out`: attempts that it has are not made again."""
    attempt_factory: str = "dgl_collect.attempt:make_attempt_runner"
    """`module:name` of what builds an `AttemptRunner` in each worker."""
    options: Mapping[str, object] = field(default_factory=dict)
    """Options of the attempt factory, JSON-ready."""
    has_episodes: bool = True
    """Whether a success must leave an episode file; evaluations leave none."""
    attempt_seconds: float = 1800.0
    """Longest time of an attempt [s]; a worker that takes longer is ended."""
    build_seconds: float = 900.0
    """Longest time of building an environment, compiling of kernels included [s]."""
    crashes_in_a_row: int = 5
    """After so many crashes without a finished attempt between them the run gives up."""
    command: str = ""
    """The command line, to be remembered in `run.json`."""

    def __post_init__(self) -> None:
        for name, least in (("episodes", 1), ("workers", 1), ("seed", 0), ("crashes_in_a_row", 1)):
            if getattr(self, name) < least:
                raise ValueError(f"{name} must be at least {least}; got {getattr(self, name)}")
        for name in ("attempt_seconds", "build_seconds"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} must be positive; got {getattr(self, name)}")
        try:
            json.dumps(dict(self.options), allow_nan=False)
        except (TypeError, ValueError) as err:
            raise ValueError(f"options must be JSON-ready; {err}") from err

    @property
    def identity(self) -> dict[str, object]:
        """What must be equal for a run to be continued."""
        return {
            "task": self.task,
            "seed": self.seed,
            "attempt_factory": self.attempt_factory,
            "options": json.loads(json.dumps(dict(self.options))),
        }


@dataclass(frozen=True, kw_only=True)
class Progress:
    """How far a run is."""

    requested: int
    """Attempts asked for."""
    resumed: int
    """Attempts that an earlier run has made."""
    results: tuple[AttemptResult, ...]
    """Results so far, earlier ones first, in the order in which they came."""
    seconds: float
    """Wall-clock time of this run [s]."""
    workers_ready: int
    """Workers that have built their environment."""


def make_attempt_seed(seed: int, index: int) -> int:
    """Derive an attempt's own seed from the run's seed and the attempt's number.

    Args:
        seed: Seed of the run, at least 0.
        index: Number of the attempt, from 0.

    Returns:
        A seed in [0, 2**32).
    """
    return int(np.random.SeedSequence(seed, spawn_key=(index,)).generate_state(1, np.uint32)[0])


def make_episode_id(task: str, seed: int, index: int) -> str:
    """Name an episode so that episodes of several runs can share a folder."""
    return f"{task}-s{seed}-{index:05d}"


def check_task(task: str, known_tasks: Sequence[str]) -> None:
    """Check a task's name.

    Raises:
        UnknownTaskError: If it is not known; the message names the closest.
    """
    if task not in known_tasks:
        raise UnknownTaskError(task, known_tasks)


def collect(
    config: CollectConfig,
    *,
    known_tasks: Sequence[str],
    on_progress: Callable[[Progress], None] | None = None,
) -> Summary:
    """Make attempts at a task until as many as asked for are there.

    Every finished attempt is on disk before the next progress report. Failed attempts, exceptions and
    crashes of a worker are results with a reason. In the main thread, an interrupt (SIGINT, SIGTERM,
    SIGHUP) ends the workers, keeps every finished attempt, and returns a summary whose `status` is
    `interrupted`.

    Args:
        config: What to collect.
        known_tasks: Names that `config.task` may be.
        on_progress: Called at the start, when a worker is ready and after every attempt.

    Returns:
        The summary, which `summary.json` holds too.

    Raises:
        UnknownTaskError: If the task is not known.
        OutputFolderError: If the output folder cannot be used.
        WorkerError: If an environment cannot be built, or workers keep dying. The summary is written.
    """
    check_task(config.task, known_tasks)
    folder = RunFolder(
        config.out, identity=config.identity, resume=config.resume, command=config.command
    )
    with folder, _stop_signals() as stop:
        run = _Run(config, folder, stop, on_progress)
        try:
            run.make_attempts()
        except BaseException:
            run.end_workers()
            folder.write_summary(requested=config.episodes, status="failed")
            raise
        if stop.is_set():
            run.end_workers()
            return folder.write_summary(requested=config.episodes, status="interrupted")
        run.stop_workers()
        return folder.write_summary(requested=config.episodes, status="complete")


class _Run:
    """One call of `collect`: the attempts that are left, and the workers that make them."""

    def __init__(
        self,
        config: CollectConfig,
        folder: RunFolder,
        stop: threading.Event,
        on_progress: Callable[[Progress], None] | None,
    ) -> None:
        self._config = config
        self._folder = folder
        self._stop = stop
        self._on_progress = on_progress
        done = {result.index for result in folder.results}
        self._left = deque(index for index in range(config.episodes) if index not in done)
        self._resumed = len(folder.results)
        self._workers: list[Worker] = []
        self._crashes = 0  # since the last finished attempt
        self._started = time.monotonic()

    def make_attempts(self) -> None:
        """Make the attempts that are left, or as many as there are before the run is to stop."""
        for number in range(min(self._config.workers, len(self._left))):
            self._workers.append(Worker(number, self._worker_config(number)))
        self._report()
        while not self._stop.is_set() and (
            self._left or any(worker.job for worker in self._workers)
        ):
            for worker in self._workers:
                if worker.is_ready and worker.job is None and self._left:
                    worker.assign(self._job(self._left.popleft()))
            by_connection = {worker.connection: worker for worker in self._workers}
            for ready in connection.wait(list(by_connection), POLL_SECONDS):
                self._receive(by_connection[ready])  # type: ignore[index] - these are connections
            self._end_late_workers()

    def stop_workers(self) -> None:
        """Let idle workers release their environments and end."""
        for worker in self._workers:
            worker.stop()

    def end_workers(self) -> None:
        """End every worker at once, whatever it is doing."""
        for worker in self._workers:
            worker.terminate()
        for worker in self._workers:
            worker.kill()

    def _worker_config(self, number: int) -> WorkerConfig:
        # Workers are the parallelism. One thread in each keeps sums in the same order, and so results
        # equal, whatever the number of workers.
        environment = {"OMP_NUM_THREADS": "1"}
        return WorkerConfig(
            task=self._config.task,
            attempt_factory=self._config.attempt_factory,
            options=self._config.options,
            log_path=self._folder.log_path(number),
            has_episodes=self._config.has_episodes,
            environment=environment,
        )

    def _job(self, index: int) -> Job:
        episode_id = make_episode_id(self._config.task, self._config.seed, index)
        return Job(
            index=index,
            seed=make_attempt_seed(self._config.seed, index),
            episode_id=episode_id,
            out_dir=self._folder.staging(episode_id),
        )

    def _receive(self, worker: Worker) -> None:
        """Take one message, or notice that the worker has died."""
        try:
            message = worker.connection.recv()
        except (EOFError, OSError):
            exit_description = worker.describe_exit()
            if not self._stop.is_set():  # else the same signal has ended the worker: no crash
                self._replace(worker, "worker crashed", exit_description)
            return
        match message:
            case Ready():
                worker.is_ready = True
                self._report()
            case StartFailed(reason):
                raise WorkerError(
                    f"the environment cannot be built: {reason} (see {worker.log_path})"
                )
            case AttemptResult() if worker.job is not None:
                self._crashes = 0
                job, worker.job = worker.job, None
                self._commit(message, job)
            case _:
                raise WorkerError(f"worker {worker.number} sent {message!r}")

    def _end_late_workers(self) -> None:
        for worker in list(self._workers):
            if worker.is_ready and worker.job is None:
                continue
            what, limit = "building", self._config.build_seconds
            if worker.is_ready:
                what, limit = "attempt", self._config.attempt_seconds
            if time.monotonic() - worker.busy_since > limit:
                self._replace(worker, "time limit", f"{what} took longer than {limit:g} s")

    def _replace(self, worker: Worker, reason: str, detail: str) -> None:
        """Record what a dead or late worker was doing, and start another in its place."""
        worker.kill()
        self._crashes += 1
        detail = f"{detail} (see {worker.log_path.relative_to(self._folder.path)})"
        logger.info("worker %d: %s, %s", worker.number, reason, detail)
        if worker.job is not None:
            job = worker.job
            result = AttemptResult(
                index=job.index,
                seed=job.seed,
                success=False,
                reason=reason,
                detail=detail,
                seconds=time.monotonic() - worker.busy_since,
            )
            self._commit(result, job)
        self._workers.remove(worker)
        if self._crashes >= self._config.crashes_in_a_row:
            raise WorkerError(
                f"{self._crashes} workers in a row ended early, the last with: {reason}, {detail}"
            )
        if self._left:
            self._workers.append(Worker(worker.number, self._worker_config(worker.number)))

    def _commit(self, result: AttemptResult, job: Job) -> None:
        self._folder.commit(result, job.out_dir)
        self._report()

    def _report(self) -> None:
        if self._on_progress is None:
            return
        self._on_progress(
            Progress(
                requested=self._config.episodes,
                resumed=self._resumed,
                results=tuple(self._folder.results),
                seconds=time.monotonic() - self._started,
                workers_ready=sum(worker.is_ready for worker in self._workers),
            )
        )


@contextmanager
def _stop_signals() -> Iterator[threading.Event]:
    """Turn interrupts into an event, so that none can fall between an attempt's files and its line.

    Only the main thread may handle signals; elsewhere the event is never set. A signal that is
    ignored, as under nohup, stays ignored.
    """
    stop = threading.Event()
    before = {}
    if threading.current_thread() is threading.main_thread():
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            if signal.getsignal(number) is not signal.SIG_IGN:
                before[number] = signal.signal(number, lambda *_: stop.set())
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
