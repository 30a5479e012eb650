"""The inside of a worker, on either engine."""

from __future__ import annotations

import gc
import logging
import time
from collections.abc import Callable
from pathlib import Path

from dgl_collect.files import describe_disk_fault
from dgl_collect.results import package_versions
from dgl_collect.workers.jobs import (
    Failure,
    Finished,
    Job,
    JobRunner,
    Lost,
    MachineFault,
    Ready,
    RunEnded,
    Work,
    describe_machine,
    load_callable,
)

logger = logging.getLogger(__name__)


class Workbench:
    """Builds a job runner and does jobs with it."""

    def __init__(self, work: Work) -> None:
        self._work = work
        self._factory: Callable[..., JobRunner] | None = None
        self._runner: JobRunner | None = None

    def build(self) -> Ready | RunEnded | MachineFault:
        """Make the job runner."""
        try:
            # Modules hold a million objects that live as long as the process. The garbage collector
            # would walk through them for 1 s during imports, and 0.2 s at each later collection.
            gc.disable()
            try:
                self._factory = load_callable(self._work.factory)
            finally:
                gc.freeze()
                gc.enable()
            self._runner = self._factory(**self._work.arguments)
        except Exception as err:
            logger.exception("the job runner cannot be built")
            if fault := describe_disk_fault(err):
                return MachineFault(reason=fault)
            return RunEnded(reason=f"the environment cannot be built: {type(err).__name__}: {err}")
        return Ready(machine=describe_machine(), versions=package_versions())

    def do(self, job: Job, out_dir: Path) -> Finished | RunEnded | MachineFault | Lost:
        """Do a job; return `Lost` if this process cannot do another one."""
        logger.info("%s", job.name)
        started = time.monotonic()
        result, failure = None, None
        try:
            if self._runner is None:
                assert self._factory is not None
                self._runner = self._factory(**self._work.arguments)
            out_dir.mkdir(parents=True, exist_ok=True)
            result = self._runner.run(job.request, out_dir)
        except Exception as err:
            logger.exception("%s raised", job.name)
            if isinstance(err, MemoryError):
                return Lost(how="out of memory")
            if fault := describe_disk_fault(err):
                return MachineFault(reason=fault)
            if getattr(err, "ends_run", False):
                return RunEnded(reason=f"{job.name}: {err}")
            self.close()  # its state is unknown: the next job gets a new one
            failure = Failure(reason=f"exception: {type(err).__name__}", detail=str(err))
        return Finished(result=result, failure=failure, seconds=time.monotonic() - started)

    def close(self) -> None:
        """Release the job runner."""
        runner, self._runner = self._runner, None
        try:
            if runner is not None:
                runner.close()
        except Exception:  # the worker is done with it either way
            logger.exception("the job runner cannot be closed")
