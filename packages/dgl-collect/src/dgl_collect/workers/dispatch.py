"""The jobs of a run: who does which, what is done again, and when to give up."""

from __future__ import annotations

import logging
import shutil
import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Generator, Iterable
from dataclasses import dataclass
from pathlib import Path

from dgl_collect.errors import MachineError, WorkerError
from dgl_collect.files import describe_full_disk
from dgl_collect.results import package_versions
from dgl_collect.workers.engine import Engine, Worker, Workers
from dgl_collect.workers.jobs import (
    Done,
    Failure,
    Job,
    Lost,
    Machine,
    MachineFault,
    Message,
    Placed,
    Raised,
    Ready,
    StartFailed,
    Work,
)
from dgl_collect.workers.local import LocalEngine

logger = logging.getLogger(__name__)

POLL_SECONDS = 0.2
"""How often time limits and interrupts are looked at [s]."""
STAGING = ".staging"
"""Folder, in that of a run, in which jobs write."""


@dataclass(frozen=True, kw_only=True)
class Limits:
    """How long things may take, and how often they may go wrong.

    Raises:
        ValueError: If a value is out of its range.
    """

    job_seconds: float = 1800.0
    """Longest time of a job [s]; a worker that takes longer is ended, and the job has failed."""
    build_seconds: float = 900.0
    """Longest time of building a job runner, compiling of kernels included [s]."""
    crashes: int = 5
    """A job that ends its worker is done again; after so many times it has failed."""
    machines: int = 10
    """A job whose machine is lost is done again; after so many times the run gives up."""
    crashes_in_a_row: int = 5
    """After so many different jobs or starts that have ended their worker, without a finished job between them, the run
    gives up."""

    def __post_init__(self) -> None:
        for name in ("crashes", "machines", "crashes_in_a_row"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name} must be at least 1; got {getattr(self, name)}")
        for name in ("job_seconds", "build_seconds"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} must be positive; got {getattr(self, name)}")


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What has become of a job."""

    job: Job
    result: object
    """What the job runner gave; None where it failed."""
    failure: Failure | None
    """Why there is no result; None where there is one."""
    seconds: float
    """Wall-clock time of the job on its worker [s]."""
    folder: Path
    """With the job's files. It is removed when the next outcome is asked for."""


class _Post:
    """A worker, and what it is at."""

    def __init__(self, worker: Worker) -> None:
        self.worker = worker
        self.log = f"logs/worker-{worker.number}.log"
        self.host = ""
        self.is_ready = False
        self.job: Job | None = None
        self.since = time.monotonic()  # [s]; when it got its place, or its job


class Dispatcher:
    """Gives the jobs of one run to workers."""

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
            jobs: What is to be done.
            work: How workers make their job runner.
            workers: How many, and where.
            folder: Of the run. Jobs write below `.staging` in it, workers print into `logs`.
            stop: Ends the run, as interrupts do.
            limits: The usual ones when None.
            on_change: Called when there is news of workers.
        """
        self.machines: set[Machine] = set()
        """What the workers run on."""
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
        self._in_a_row: list[str] = []  # what has ended a worker since the last finished job
        self._last_end = ""  # how the last of them ended
        self._versions = package_versions()

    @property
    def workers_ready(self) -> int:
        """Workers that have built their job runner."""
        return sum(post.is_ready for post in self._posts)

    @property
    def workers_waiting(self) -> int:
        """Workers that the cluster has no place for yet."""
        return sum(not post.worker.has_place for post in self._posts)

    def run(self) -> Generator[Outcome, None, None]:
        """Do the jobs.

        Yields:
            Outcomes as they come. Closing the generator ends the workers at once, whatever they are doing.

        Raises:
            EngineError: If there is no cluster at the address, or Ray is not installed.
            WorkerError: If a job runner cannot be built, workers keep dying, or their cluster is gone.
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
            yield from self._run(engine)
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

    def _run(self, engine: Engine) -> Generator[Outcome, None, None]:
        self._on_change()
        while not self._stop.is_set() and (self._left or any(post.job for post in self._posts)):
            for post in self._posts:
                if post.is_ready and post.job is None and self._left:
                    post.job, post.since = self._left.popleft(), time.monotonic()
                    post.worker.assign(post.job, self._staging(post.job))
            heard = engine.hear([post.worker for post in self._posts], POLL_SECONDS)
            by_worker = {post.worker: post for post in self._posts}
            for worker, message in heard:
                if self._stop.is_set() and isinstance(message, Lost):
                    return  # the same signal has ended the worker: that is no crash
                yield from self._given(self._take(engine, by_worker[worker], message))
            for post in list(self._posts):
                yield from self._given(self._end_if_late(engine, post))
            if len(set(self._in_a_row)) >= self._limits.crashes_in_a_row:
                raise WorkerError(
                    f"{len(self._in_a_row)} workers in a row ended early, the last with: {self._last_end}"
                )

    def _given(self, outcome: Outcome | None) -> Generator[Outcome, None, None]:
        """Yield an outcome, if there is one, and remove its folder."""
        if outcome is None:
            return
        yield outcome
        shutil.rmtree(outcome.folder, ignore_errors=True)

    def _start(self, engine: Engine, number: int) -> None:
        log_path = self._folder / "logs" / f"worker-{number}.log"
        self._posts.append(_Post(engine.start(number, self._work, log_path)))

    def _staging(self, job: Job) -> Path:
        """Give an empty folder for a job."""
        folder = self._folder / STAGING / job.name
        shutil.rmtree(folder, ignore_errors=True)  # of a worker that was lost
        folder.mkdir(parents=True)
        return folder

    def _take(self, engine: Engine, post: _Post, message: Message) -> Outcome | None:
        """Take a message."""
        match message:
            case Placed(host=host):
                post.host, post.since = host, time.monotonic()
                self._on_change()
            case Ready(machine=machine, versions=versions):
                self._check_versions(machine, versions)
                post.is_ready = True
                self.machines.add(machine)
                self._on_change()
            case StartFailed(reason=reason):
                log = self._folder / post.log
                where = f" (see {log})" if log.is_file() else ""
                raise WorkerError(f"the environment cannot be built: {reason}{where}")
            case MachineFault(reason=reason):
                where = f"on {post.host}" if post.host else f"at work in {self._folder}"
                raise MachineError(f"{reason}, {where}")
            case Lost(how=how, with_machine=with_machine):
                return self._lose(engine, post, how, with_machine=with_machine)
            case Done(result=result, seconds=seconds) if post.job is not None:
                return self._finish(post, result, None, seconds)
            case Raised(failure=failure, seconds=seconds) if post.job is not None:
                return self._finish(post, None, failure, seconds)
            case _:
                raise WorkerError(f"worker {post.worker.number} sent {message!r}")
        return None

    def _finish(
        self, post: _Post, result: object, failure: Failure | None, seconds: float
    ) -> Outcome:
        assert post.job is not None
        job, post.job = post.job, None
        self._in_a_row.clear()
        folder = self._folder / STAGING / job.name
        return Outcome(job=job, result=result, failure=failure, seconds=seconds, folder=folder)

    def _check_versions(self, machine: Machine, versions: object) -> None:
        """Compare a worker's packages with this process's: other versions give other files."""
        if versions != self._versions:
            assert isinstance(versions, dict)
            names = sorted(set(versions) | set(self._versions))
            other = [name for name in names if versions.get(name) != self._versions.get(name)]
            told = ", ".join(
                f"{name} {versions.get(name, 'missing')} (here {self._versions.get(name, 'missing')})"
                for name in other
            )
            raise WorkerError(
                f"{machine.host} has other packages: {told}; install the same on every node"
            )

    def _lose(self, engine: Engine, post: _Post, how: str, *, with_machine: bool) -> Outcome | None:
        """Note that a worker is gone: its job is done again, or has failed after too many times."""
        post.worker.kill()
        if fault := describe_full_disk(self._folder):
            raise MachineError(fault)  # libraries crash when they cannot write
        logger.info("worker %d: %s", post.worker.number, how)
        job, outcome = post.job, None
        if with_machine and job is not None:
            self._machine_losses[job.name] += 1
            if self._machine_losses[job.name] >= self._limits.machines:
                raise WorkerError(f"{job.name}: its machine was lost {self._limits.machines} times")
            self._left.append(job)
        elif job is not None:
            self._crashes[job.name] += 1
            self._in_a_row.append(job.name)
            times = self._crashes[job.name]
            if times >= self._limits.crashes:
                detail = f"{how}, {times} {'time' if times == 1 else 'times'} (see {post.log})"
                outcome = self._fail(post, "worker crashed", detail)
            else:
                self._left.append(job)
        elif not with_machine:
            self._in_a_row.append(f"start {len(self._in_a_row)}")
        self._replace(engine, post, f"worker crashed, {how} (see {self._folder / post.log})")
        return outcome

    def _end_if_late(self, engine: Engine, post: _Post) -> Outcome | None:
        """End a worker that takes too long."""
        if not post.worker.has_place or (post.is_ready and post.job is None):
            return None
        what, limit = "building", self._limits.build_seconds
        if post.is_ready:
            what, limit = "the job", self._limits.job_seconds
        if time.monotonic() - post.since <= limit:
            return None
        post.worker.kill()
        detail = f"{what} took longer than {limit:g} s (see {post.log})"
        outcome = None
        if post.job is not None:
            self._in_a_row.append(post.job.name)
            outcome = self._fail(post, "time limit", detail)
        else:
            self._in_a_row.append(f"start {len(self._in_a_row)}")
        self._replace(engine, post, f"time limit, {detail}")
        return outcome

    def _fail(self, post: _Post, reason: str, detail: str) -> Outcome:
        """Give the outcome of a job that has ended its worker."""
        assert post.job is not None
        return Outcome(
            job=post.job,
            result=None,
            failure=Failure(reason=reason, detail=detail),
            seconds=time.monotonic() - post.since,
            folder=self._folder / STAGING / post.job.name,
        )

    def _replace(self, engine: Engine, post: _Post, end: str) -> None:
        """Start another worker in the place of one that has ended."""
        self._last_end = end
        self._posts.remove(post)
        if self._left:
            self._start(engine, post.worker.number)


def check_workers(workers: Workers) -> None:
    """See whether the engine of a run can be started, before anything is written.

    Raises:
        EngineError: If Ray is not installed, or nothing answers at the cluster's address.
    """
    if workers.engine == "ray":
        from dgl_collect.workers.ray_cluster import check_reachable

        check_reachable(workers.address)


def _start_engine(workers: Workers) -> Engine:
    """Start the engine of a run.

    Raises:
        EngineError: If there is no cluster at the address, or Ray is not installed.
    """
    if workers.engine == "ray":
        from dgl_collect.workers.ray_cluster import RayEngine  # Ray is an extra

        return RayEngine(workers)
    return LocalEngine()
