"""Distribution of jobs to workers, with repetition and limits."""

from __future__ import annotations

import logging
import shutil
import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Generator, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from annotated_types import Ge, Gt

from dgl_collect.errors import MachineError, WorkerError
from dgl_collect.files import describe_full_disk
from dgl_collect.results import package_versions
from dgl_collect.workers.engine import Engine, Worker, Workers
from dgl_collect.workers.jobs import (
    Failure,
    Finished,
    Job,
    Lost,
    Machine,
    MachineFault,
    Message,
    Ready,
    RunEnded,
    Started,
    Work,
)
from dgl_collect.workers.local import LocalEngine
from dgl_files.fields import check_fields

logger = logging.getLogger(__name__)

POLL_SECONDS = 0.2
"""Period of checks for time limits and interrupts [s]."""
STAGING = ".staging"
"""Subfolder of the run in which jobs write."""


@dataclass(frozen=True, kw_only=True)
class Limits:
    """Limits of time and of failures.

    Raises:
        ValueError: If a value is out of its range.
    """

    job_seconds: Annotated[float, Gt(0)] = 1800.0
    """Time limit of a job [s]; beyond it the worker is ended and the job has failed."""
    build_seconds: Annotated[float, Gt(0)] = 900.0
    """Time limit of building a job runner, kernel compilation included [s]."""
    crashes: Annotated[int, Ge(1)] = 5
    """Crashes of a job, each of which ends its worker, after which it has failed."""
    machines: Annotated[int, Ge(1)] = 10
    """Losses of a job's machine after which the run gives up."""
    crashes_in_a_row: Annotated[int, Ge(1)] = 5
    """Crashes in a row, of different jobs or starts, after which the run gives up."""

    def __post_init__(self) -> None:
        check_fields(self)


@dataclass(frozen=True, kw_only=True)
class JobOutcome:
    """Outcome of a job."""

    job: Job
    result: object
    """Returned by the job runner; None after a failure."""
    failure: Failure | None
    seconds: float
    """Wall-clock time of the job on its worker [s]."""
    folder: Path
    """Folder of the job's files. It is removed when the next outcome is asked for."""


class _Post:
    """A worker and its state."""

    def __init__(self, worker: Worker) -> None:
        self.worker = worker
        self.log = f"logs/worker-{worker.number}.log"
        self.host = ""
        self.is_ready = False
        self.job: Job | None = None
        self.since = time.monotonic()  # [s]; when it was started, or got its job


class Dispatcher:
    """Distributes the jobs of one run to workers."""

    def __init__(
        self,
        jobs: Iterable[Job],
        *,
        work: Work,
        workers: Workers,
        folder: Path,
        stop: threading.Event,
        limits: Limits | None = None,
        on_change: Callable[[], None] = lambda: None,
    ) -> None:
        """Prepare a run; nothing is started yet.

        Args:
            jobs: The jobs.
            work: Construction of the workers' job runners.
            workers: Number and engine.
            folder: Folder of the run. Jobs write below `.staging`, workers print into `logs`.
            stop: Ends the run when set, as interrupts do.
            limits: Limits of time and failures; the defaults when None.
            on_change: Called when the state of a worker changes.
        """
        self.machines: set[Machine] = set()
        """Machines of the workers."""
        self._left = deque(jobs)
        self._work = work
        self._workers = workers
        self._folder = folder
        self._stop = stop
        self._limits = limits or Limits()
        self._on_change = on_change
        self._posts: list[_Post] = []
        self._crashes: Counter[str] = Counter()  # of jobs, by name
        self._machine_losses: Counter[str] = Counter()  # likewise
        self._in_a_row: list[str] = []  # jobs and starts that ended a worker since the last result
        self._last_end = ""  # of the last of them
        self._versions = package_versions()

    @property
    def workers_ready(self) -> int:
        """Workers that have built their job runner."""
        return sum(post.is_ready for post in self._posts)

    @property
    def workers_waiting(self) -> int:
        """Workers that wait for a processor of the cluster."""
        return sum(not post.worker.is_started for post in self._posts)

    def run(self) -> Generator[JobOutcome, None, None]:
        """Do the jobs.

        Yields:
            Outcomes as they come. Closing the generator ends the workers at once.

        Raises:
            EngineError: If there is no cluster at the address, or Ray is not installed.
            WorkerError: If a job runner cannot be built, workers keep dying, or the cluster is
                gone.
            MachineError: If a disk is full, or fails.
        """
        shutil.rmtree(self._folder / STAGING, ignore_errors=True)  # of a run that was killed
        if not self._left:
            return
        (self._folder / "logs").mkdir(exist_ok=True)
        engine = _start_engine(self._workers)
        try:
            for number in range(min(self._workers.count, len(self._left))):
                self._start(engine, number)
            for outcome in self._run(engine):
                yield outcome
                shutil.rmtree(outcome.folder, ignore_errors=True)
            if not self._stop.is_set():
                for post in self._posts:
                    if post.is_ready:
                        post.worker.release()
        finally:
            for post in self._posts:
                post.worker.kill()
            self._posts.clear()
            engine.close()
            shutil.rmtree(self._folder / STAGING, ignore_errors=True)

    def _run(self, engine: Engine) -> Generator[JobOutcome, None, None]:
        self._on_change()
        while not self._stop.is_set() and (self._left or any(post.job for post in self._posts)):
            for post in self._posts:
                if post.is_ready and post.job is None and self._left:
                    post.job, post.since = self._left.popleft(), time.monotonic()
                    folder = self._folder / STAGING / post.job.name
                    shutil.rmtree(folder, ignore_errors=True)  # of a worker that was lost
                    folder.mkdir(parents=True)
                    post.worker.assign(post.job, folder)
            heard = engine.hear([post.worker for post in self._posts], POLL_SECONDS)
            by_worker = {post.worker: post for post in self._posts}
            for worker, message in heard:
                if self._stop.is_set() and isinstance(message, Lost):
                    return  # the same signal has ended the worker: that is no crash
                if outcome := self._take(engine, by_worker[worker], message):
                    yield outcome
            for post in list(self._posts):
                if outcome := self._end_if_late(engine, post):
                    yield outcome
            if len(set(self._in_a_row)) >= self._limits.crashes_in_a_row:
                raise WorkerError(
                    f"{len(self._in_a_row)} workers in a row ended early, the last with: "
                    f"{self._last_end}"
                )

    def _start(self, engine: Engine, number: int) -> None:
        log_path = self._folder / "logs" / f"worker-{number}.log"
        self._posts.append(_Post(engine.start(number, self._work, log_path)))

    def _take(self, engine: Engine, post: _Post, message: Message) -> JobOutcome | None:
        """Handle a message; return the outcome of a job, if it brings one."""
        match message:
            case Started(host=host):
                post.host, post.since = host, time.monotonic()
                self._on_change()
            case Ready(machine=machine, versions=versions):
                self._check_versions(machine, versions)
                post.is_ready = True
                self.machines.add(machine)
                self._on_change()
            case RunEnded(reason=reason):
                log = self._folder / post.log
                where = f" (see {log})" if log.is_file() else ""
                raise WorkerError(f"{reason}{where}")
            case MachineFault(reason=reason):
                where = f"on {post.host}" if post.host else f"at work in {self._folder}"
                raise MachineError(f"{reason}, {where}")
            case Lost(how=how, with_machine=with_machine):
                return self._lose(engine, post, how, with_machine=with_machine)
            case Finished() if post.job is not None:
                self._in_a_row.clear()
                outcome = self._make_outcome(post, message)
                post.job = None
                return outcome
            case _:
                raise WorkerError(f"worker {post.worker.number} sent {message!r}")
        return None

    def _check_versions(self, machine: Machine, versions: object) -> None:
        """Compare a worker's packages with this process's: other versions give other files."""
        if versions == self._versions:
            return
        assert isinstance(versions, dict)
        told = ", ".join(
            f"{name} {versions.get(name, 'missing')} (here {self._versions.get(name, 'missing')})"
            for name in sorted(set(versions) | set(self._versions))
            if versions.get(name) != self._versions.get(name)
        )
        raise WorkerError(
            f"{machine.host} has other packages: {told}; install the same on every node"
        )

    def _lose(
        self, engine: Engine, post: _Post, how: str, *, with_machine: bool
    ) -> JobOutcome | None:
        """Replace a lost worker; its job is repeated, or fails after too many crashes."""
        post.worker.kill()
        if fault := describe_full_disk(self._folder):
            raise MachineError(fault)  # libraries crash when they cannot write
        logger.info("worker %d: %s", post.worker.number, how)
        job, failure = post.job, None
        if with_machine and job is not None:
            self._machine_losses[job.name] += 1
            if self._machine_losses[job.name] >= self._limits.machines:
                raise WorkerError(f"{job.name}: its machine was lost {self._limits.machines} times")
        elif job is not None:
            self._crashes[job.name] += 1
            times = self._crashes[job.name]
            if times >= self._limits.crashes:
                detail = f"{how}, {times} {'time' if times == 1 else 'times'} (see {post.log})"
                failure = Failure(reason="worker crashed", detail=detail)
        if job is not None and failure is None:
            self._left.append(job)
        end = f"worker crashed, {how} (see {self._folder / post.log})"
        return self._replace(engine, post, end, failure, counts=not with_machine)

    def _end_if_late(self, engine: Engine, post: _Post) -> JobOutcome | None:
        """End a worker that takes too long."""
        if not post.worker.is_started or (post.is_ready and post.job is None):
            return None
        what, limit = "building", self._limits.build_seconds
        if post.is_ready:
            what, limit = "the job", self._limits.job_seconds
        if time.monotonic() - post.since <= limit:
            return None
        post.worker.kill()
        detail = f"{what} took longer than {limit:g} s (see {post.log})"
        failure = Failure(reason="time limit", detail=detail)
        return self._replace(engine, post, f"time limit, {detail}", failure, counts=True)

    def _replace(
        self, engine: Engine, post: _Post, end: str, failure: Failure | None, *, counts: bool
    ) -> JobOutcome | None:
        """Replace a worker that has ended; return the outcome if its job has failed."""
        self._last_end = end
        if counts:
            name = f"start {len(self._in_a_row)}" if post.job is None else post.job.name
            self._in_a_row.append(name)
        self._posts.remove(post)
        if self._left:
            self._start(engine, post.worker.number)
        if failure is None or post.job is None:
            return None
        seconds = time.monotonic() - post.since
        return self._make_outcome(post, Finished(result=None, failure=failure, seconds=seconds))

    def _make_outcome(self, post: _Post, end: Finished) -> JobOutcome:
        assert post.job is not None
        folder = self._folder / STAGING / post.job.name
        return JobOutcome(
            job=post.job, result=end.result, failure=end.failure, seconds=end.seconds, folder=folder
        )


def check_workers(workers: Workers) -> None:
    """Check that the engine of a run can be started, before anything is written.

    Raises:
        EngineError: If Ray is not installed, or nothing answers at the cluster's address.
    """
    if workers.engine == "ray":
        from dgl_collect.workers.ray_cluster import check_reachable

        check_reachable(workers.address)


def _start_engine(workers: Workers) -> Engine:
    if workers.engine == "ray":
        from dgl_collect.workers.ray_cluster import RayEngine  # Ray is an extra

        return RayEngine(workers)
    return LocalEngine()
