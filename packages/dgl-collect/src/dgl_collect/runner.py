"""Collection: many attempts at a task, by one or more workers."""

import json
import time
from collections.abc import Callable, Mapping
from contextlib import closing, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from annotated_types import Ge

from dgl_collect.attempt_jobs import make_job, read_outcome
from dgl_collect.errors import MachineError
from dgl_collect.options import RecordOptions, RunOptions
from dgl_collect.results import AttemptResult, Summary, package_versions
from dgl_collect.run_folder import RunRecord, opened_run
from dgl_collect.workers import (
    Dispatcher,
    Limits,
    Work,
    Workers,
    check_workers,
    end_unguarded_import,
    stop_signals,
)
from dgl_files.fields import check_fields
from dgl_tasks import load_task
from dgl_tasks.declaration import Task


@dataclass(frozen=True, kw_only=True)
class CollectConfig:
    """A run to make.

    Raises:
        ValueError: If a field is of another type or out of range, or the options are not
            JSON-ready.
    """

    task: str
    """Environment id, such as `FoldTops-v1`, or a task of your own; see `dgl_tasks.load_task`."""
    episodes: Annotated[int, Ge(1)]
    """Attempts to make; how many of them succeed is a result."""
    out: Path
    """Output folder; empty or missing, unless `resume`."""
    seed: Annotated[int, Ge(0)] = 0
    """Seed of the run; every attempt's seed follows from it and the attempt's
    number."""
    workers: Workers = field(default_factory=Workers)
    """Number and place of the workers. The results do not depend on it."""
    resume: bool = False
    """Continue the run in `out`; only missing attempts are made."""
    attempt_factory: str = "dgl_collect.attempt:make_attempt_runner"
    """`module:name` of a callable, called in each worker with `task` and `options`. It returns a
    `JobRunner` that makes an `AttemptResult` of each `AttemptRequest`."""
    options: RunOptions | Mapping[str, object] = field(default_factory=RecordOptions)
    """Options of the attempts; a mapping, JSON-ready, for attempt factories that take one."""
    has_episodes: bool = True
    """A success must leave an episode file; evaluations leave none."""
    limits: Limits = field(default_factory=Limits)
    """Limits of time and of repeated faults."""
    command: str = ""
    """Command line, recorded in `run.json`."""

    def __post_init__(self) -> None:
        check_fields(self)
        try:
            json.dumps(self._plain_options, allow_nan=False)
        except (TypeError, ValueError) as err:
            raise ValueError(f"options must be JSON-ready; {err}") from err

    def make_record(self, task: Task) -> RunRecord:
        """Make the content of `run.json`."""
        from dgl_collect.demonstration import compute_own_checksums  # it takes a second to import

        named = self.options.demonstration if isinstance(self.options, RunOptions) else None
        return RunRecord(
            run_format=1,
            task=task.id,
            seed=self.seed,
            attempt_factory=self.attempt_factory,
            options=json.loads(json.dumps(self._plain_options)),
            versions=package_versions(),
            commands=(self.command,),
            **compute_own_checksums(task, named),
        )

    @property
    def _plain_options(self) -> dict[str, object]:
        options = self.options
        return options.to_plain() if isinstance(options, RunOptions) else dict(options)


@dataclass(frozen=True, kw_only=True)
class Progress:
    """Progress of a run."""

    requested: int
    """Attempts asked for."""
    resumed: int
    """Attempts made by an earlier run."""
    results: tuple[AttemptResult, ...]
    """Results so far, in the order of their arrival."""
    seconds: float
    """Wall-clock time of this run [s]."""
    workers_ready: int
    """Workers with a built environment."""
    workers_waiting: int
    """Workers that wait for a place in the cluster."""


def collect(
    config: CollectConfig,
    *,
    on_progress: Callable[[Progress], None] | None = None,
) -> Summary:
    """Make the attempts of a run that are missing.

    Every finished attempt is on disk before the next progress report. Failed attempts, exceptions
    and attempts that crash each time are results with a reason. An attempt that was lost with its
    worker or machine is made again. In the main thread, an interrupt (SIGINT, SIGTERM, SIGHUP) ends
    the workers and returns a summary with `status` `interrupted`; finished attempts are kept.

    Args:
        config: The run.
        on_progress: Called at the start, when a worker changes, and after every attempt.

    Returns:
        The summary, as in `summary.json`.

    Raises:
        UnknownTaskError: If the task is not known.
        OutputFolderError: If the output folder cannot be used.
        EngineError: If there is no Ray cluster at the address, or Ray is not installed.
        WorkerError: If an environment cannot be built, workers keep dying, or their cluster is
            gone.
        MachineError: If a disk is full or fails. The summary is written if there is room.
    """
    end_unguarded_import()
    task = load_task(config.task)
    check_workers(config.workers)
    record = config.make_record(task)
    began = time.monotonic()
    with opened_run(config.out, record, resume=config.resume) as folder, stop_signals() as stop:
        resumed = len(folder.results)
        done = {result.index for result in folder.results}

        def report() -> None:
            folder.add_machines(dispatcher.machines)
            if on_progress is not None:
                on_progress(
                    Progress(
                        requested=config.episodes,
                        resumed=resumed,
                        results=tuple(folder.results),
                        seconds=time.monotonic() - began,
                        workers_ready=dispatcher.workers_ready,
                        workers_waiting=dispatcher.workers_waiting,
                    )
                )

        dispatcher = Dispatcher(
            (
                make_job(task.id, config.seed, index)
                for index in range(config.episodes)
                if index not in done
            ),
            work=Work(
                factory=config.attempt_factory,
                arguments={"task": locate_task(config.task), "options": config.options},
            ),
            workers=config.workers,
            folder=config.out,
            stop=stop,
            limits=config.limits,
            on_change=report,
        )
        try:
            with closing(dispatcher.run()) as outcomes:
                for outcome in outcomes:
                    result = read_outcome(outcome, has_episodes=config.has_episodes)
                    folder.commit(result, outcome.folder)
                    report()
        except BaseException:
            with suppress(OSError, MachineError):  # a full disk does not hide the error
                folder.write_summary(requested=config.episodes, status="failed")
            raise
        status = "interrupted" if stop.is_set() else "complete"
        return folder.write_summary(requested=config.episodes, status=status)


def locate_task(source: str) -> str:
    """Make the path of a task file absolute, since workers run in another folder."""
    return str(Path(source).absolute()) if source.endswith(".py") else source
