"""The inside of a worker, on either engine."""

import gc
import logging
import os
import pkgutil
import platform
import re
import socket
import sys
import time
from collections.abc import Callable
from functools import cache
from pathlib import Path

from dgl_collect.errors import MachineError, WorkerError
from dgl_collect.files import describe_disk_fault
from dgl_collect.results import package_versions
from dgl_collect.workers.engine import Answer, Lost, Machine, Ready
from dgl_collect.workers.jobs import Failure, Job, JobOutcome, JobRunner, Work

logger = logging.getLogger(__name__)

ENVIRONMENT = {"OMP_NUM_THREADS": "1"}
"""Set before a worker's first import. One thread in each worker keeps sums in the same order, and
results equal for any number of workers."""


class Workbench:
    """Builds a job runner and does jobs with it."""

    def __init__(self, work: Work) -> None:
        self._work = work
        self._factory: Callable[..., JobRunner] | None = None
        self._runner: JobRunner | None = None

    def build(self) -> Answer:
        """Make the job runner."""
        try:
            # Modules hold a million objects that live as long as the process. The garbage collector
            # would walk through them for 1 s during imports, and 0.2 s at each later collection.
            gc.disable()
            try:
                factory = self._factory = pkgutil.resolve_name(self._work.factory)
            finally:
                gc.freeze()
                gc.enable()
            self._runner = factory(**self._work.arguments)
        except Exception as err:
            logger.exception("the job runner cannot be built")
            if fault := describe_disk_fault(err):
                return MachineError(f"{fault}, on {socket.gethostname()}")
            return WorkerError(f"the environment cannot be built: {type(err).__name__}: {err}")
        return Ready(machine=describe_machine(), versions=package_versions())

    def do(self, job: Job, out_dir: Path) -> Answer:
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
                return MachineError(f"{fault}, at work in {out_dir} on {socket.gethostname()}")
            if getattr(err, "ends_run", False):
                return WorkerError(f"{job.name}: {err}")
            self.close()  # its state is unknown: the next job gets a new one
            failure = Failure(reason=f"exception: {type(err).__name__}", detail=str(err))
        seconds = time.monotonic() - started
        return JobOutcome(job=job, result=result, failure=failure, seconds=seconds, folder=out_dir)

    def close(self) -> None:
        """Release the job runner."""
        runner, self._runner = self._runner, None
        try:
            if runner is not None:
                runner.close()
        except Exception:  # the worker is done with it either way
            logger.exception("the job runner cannot be closed")


@cache
def describe_machine() -> Machine:
    """Describe the machine of this process."""
    from dgl_physics.launcher import find_vector_obstacle

    path = Path("/proc/cpuinfo")
    text = path.read_text(encoding="utf-8", errors="replace") if path.is_file() else ""
    models = re.findall(r"^model name\s*: *(.*?) *$", text, re.MULTILINE)
    return Machine(
        host=socket.gethostname(),
        cpu=models[0] if models else platform.processor() or os.uname().machine,
        cpu_code="warp" if find_vector_obstacle() else "vector",
    )


def print_to(path: Path) -> None:
    """Send standard output and error of this process, native libraries included, to a log."""
    descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND)
    sys.stdout.flush()
    sys.stderr.flush()
    os.dup2(descriptor, 1)
    os.dup2(descriptor, 2)
    os.close(descriptor)
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(levelname)s %(message)s")
