"""Distribution of jobs to workers, with repetition and limits."""

import logging
import shutil
import signal
import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import KW_ONLY, dataclass, field, replace
from pathlib import Path
from typing import Annotated

from annotated_types import Ge, Gt

from dgl_collect.errors import MachineError, WorkerError
from dgl_collect.files import describe_full_disk
from dgl_collect.results import package_versions
from dgl_collect.workers.engine import Answer, Engine, Lost, Machine, Ready, Worker, Workers
from dgl_collect.workers.jobs import Failure, Job, JobOutcome, Work
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


@dataclass(eq=False)
class Dispatcher:
    """Distributes the jobs of one run to workers."""

    jobs: Iterable[Job]
    _: KW_ONLY
    work: Work
    """Construction of the workers' job runners."""
    workers: Workers
    """Number and engine."""
    folder: Path
    """Folder of the run. Jobs write below `.staging`, workers print into `logs`."""
    stop: threading.Event
    """Ends the run when set, as interrupts do."""
    limits: Limits = field(default_factory=Limits)
    """Limits of time and failures."""
    on_change: Callable[[], None] = lambda: None
    """Called when a worker is ready."""
    machines: set[Machine] = field(default_factory=set, init=False)
    """Machines of the workers."""

    def __post_init__(self) -> None:
        self._left = deque(self.jobs)
        self._running: list[Worker] = []
        self._losses: Counter[tuple[str, str]] = Counter()  # by name and cause
        self._ends: dict[str, str] = {}  # of workers since the last result, by job or start
        self._versions = package_versions()

    @property
    def workers_ready(self) -> int:
        """Workers that have built their job runner."""
        return sum(worker.is_ready for worker in self._running)

    @property
    def workers_waiting(self) -> int:
        """Workers that wait for a processor of the cluster."""
        return sum(worker.since is None for worker in self._running)

    def add(self, jobs: Iterable[Job]) -> None:
        """Add jobs, before or while others are done."""
        self._left.extend(jobs)

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
        shutil.rmtree(self.folder / STAGING, ignore_errors=True)  # of a run that was killed
        if not self._left:
            return
        (self.folder / "logs").mkdir(exist_ok=True)
        engine = _start_engine(self.workers)
        try:
            for outcome in self._run(engine):
                yield outcome
                shutil.rmtree(outcome.folder, ignore_errors=True)
            if not self.stop.is_set():
                for worker in self._running:
                    if worker.is_ready:
                        worker.release()
        finally:
            for worker in self._running:
                worker.kill()
            self._running.clear()
            engine.close()
            shutil.rmtree(self.folder / STAGING, ignore_errors=True)

    def _run(self, engine: Engine) -> Generator[JobOutcome, None, None]:
        self.on_change()
        while not self.stop.is_set() and (self._left or any(w.job for w in self._running)):
            self._start_missing(engine)
            for worker in self._running:
                if worker.is_ready and worker.job is None and self._left:
                    job = self._left.popleft()
                    folder = self._get_folder(job)
                    shutil.rmtree(folder, ignore_errors=True)  # of a worker that was lost
                    folder.mkdir(parents=True)
                    worker.assign(job, folder)
            for worker, answer in engine.hear(self._running, POLL_SECONDS):
                if self.stop.is_set() and isinstance(answer, Lost):
                    return  # the same signal has ended the worker: that is no crash
                if outcome := self._take(engine, worker, answer):
                    yield outcome
            for worker in list(self._running):
                late = self._find_late(worker)
                if late and (outcome := self._end(engine, worker, late)):
                    yield outcome
            if len(self._ends) >= self.limits.crashes_in_a_row:
                raise WorkerError(
                    f"{len(self._ends)} workers in a row ended early, the last with: "
                    f"{list(self._ends.values())[-1]}"
                )

    def _start_missing(self, engine: Engine) -> None:
        """Start workers for the jobs that are left."""
        idle = sum(worker.job is None for worker in self._running)
        free = [
            number
            for number in range(self.workers.count)
            if all(worker.number != number for worker in self._running)
        ]
        for number in free[: max(0, len(self._left) - idle)]:
            self._start(engine, number)

    def _start(self, engine: Engine, number: int) -> None:
        self._running.append(engine.start(number, self.work, self.folder / _get_log(number)))

    def _get_folder(self, job: Job) -> Path:
        return self.folder / STAGING / job.name

    def _take(self, engine: Engine, worker: Worker, answer: Answer) -> JobOutcome | None:
        """Handle an answer; return the outcome of a job, if it is one."""
        match answer:
            case Ready(machine=machine, versions=versions):
                self._check_versions(machine, versions)
                worker.is_ready = True
                self.machines.add(machine)
                self.on_change()
                return None
            case JobOutcome(job=job):
                self._ends.clear()
                worker.job = None
                return replace(answer, folder=self._get_folder(job))
            case Lost():
                return self._end(engine, worker, answer)
            case WorkerError():
                log = self.folder / _get_log(worker.number)
                raise WorkerError(f"{answer} (see {log})" if log.is_file() else str(answer))
        raise answer

    def _check_versions(self, machine: Machine, versions: Mapping[str, str]) -> None:
        """Compare a worker's packages with this process's: other versions give other files."""
        told = ", ".join(
            f"{name} {versions.get(name, 'missing')} (here {self._versions.get(name, 'missing')})"
            for name in sorted(set(versions) | set(self._versions))
            if versions.get(name) != self._versions.get(name)
        )
        if told:
            raise WorkerError(
                f"{machine.host} has other packages: {told}; install the same on every node"
            )

    def _find_late(self, worker: Worker) -> Lost | None:
        """Check if a worker takes too long."""
        if worker.since is None or (worker.is_ready and worker.job is None):
            return None
        what, limit = "building", self.limits.build_seconds
        if worker.is_ready:
            what, limit = "the job", self.limits.job_seconds
        if time.monotonic() - worker.since <= limit:
            return None
        return Lost(how=f"{what} took longer than {limit:g} s", cause="time")

    def _end(self, engine: Engine, worker: Worker, lost: Lost) -> JobOutcome | None:
        """Replace a worker; its job is repeated, or has failed: then return its outcome."""
        worker.kill()
        self._running.remove(worker)
        if fault := describe_full_disk(self.folder):
            raise MachineError(fault)  # libraries crash when they cannot write
        logger.info("worker %d: %s", worker.number, lost.how)
        job, log = worker.job, _get_log(worker.number)
        if lost.cause != "machine":
            name = f"start {len(self._ends)}" if job is None else job.name
            self._ends.pop(name, None)  # the last one stands at the end
            self._ends[name] = f"{_REASONS[lost.cause]}, {lost.how} (see {self.folder / log})"
        failure = None if job is None else self._find_failure(job, lost, log)
        if job is not None and failure is None:
            self._left.append(job)
        if job is None or failure is None:
            return None
        seconds = time.monotonic() - (worker.since or 0.0)
        folder = self._get_folder(job)
        return JobOutcome(job=job, result=None, failure=failure, seconds=seconds, folder=folder)

    def _find_failure(self, job: Job, lost: Lost, log: str) -> Failure | None:
        """Count the loss of a job's worker; return the job's failure if that was too often."""
        self._losses[job.name, lost.cause] += 1
        times = self._losses[job.name, lost.cause]
        if lost.cause == "machine":
            if times >= self.limits.machines:
                raise WorkerError(f"{job.name}: its machine was lost {times} times")
            return None
        detail = f"{lost.how} (see {log})"
        if lost.cause == "crash":
            if times < self.limits.crashes:
                return None
            detail = f"{lost.how}, {times} {'time' if times == 1 else 'times'} (see {log})"
        return Failure(reason=_REASONS[lost.cause], detail=detail)


_REASONS = {"crash": "worker crashed", "time": "time limit"}


def _get_log(number: int) -> str:
    return f"logs/worker-{number}.log"


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


@contextmanager
def stop_signals() -> Iterator[threading.Event]:
    """Turn interrupts into an event, so that none falls between a job's files and its line.

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
