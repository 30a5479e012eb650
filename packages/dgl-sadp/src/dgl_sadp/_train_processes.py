"""Training on several devices: a process for each, started and ended by the one that is asked to train."""

import multiprocessing
import os
import signal
import threading
import traceback
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import timedelta
from multiprocessing import connection
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnProcess
from multiprocessing.synchronize import Event
from pathlib import Path
from tempfile import TemporaryDirectory

import torch
from torch import distributed

from dgl_sadp._train_result import Progress, TrainResult
from dgl_sadp._train_run import TrainJob, run_job
from dgl_sadp._train_state import hold_interrupts
from dgl_sadp.errors import TrainingProcessError

__all__ = ["run_in_processes"]

# The others wait while the first one validates and saves. One that ends is noticed at once, without this.
PATIENCE = timedelta(hours=2)


@dataclass(frozen=True, kw_only=True)
class _Failure:
    """What the process of a device raised."""

    number: int
    error: Exception
    traceback: str


def run_in_processes(
    job: TrainJob, on_progress: Callable[[Progress], None] | None
) -> TrainResult | None:
    """Do a job in a process for each device; return None if it was interrupted, and everything saved.

    The processes hear of an interruption by this one alone, so that all of them stop after the same step.

    Raises:
        TrainingProcessError: If one of them ends without having said why.
        Exception: What one of them raised.
    """
    stop = multiprocessing.get_context("spawn").Event()
    results: dict[Connection, TrainResult | None] = {}
    with hold_interrupts() as interrupts, _started(job, stop) as processes:
        while len(results) < len(processes):
            running = [pipe for pipe in processes if pipe not in results]
            for pipe in connection.wait(running, timeout=0.2):
                assert isinstance(pipe, Connection)
                told = _receive(pipe, processes)
                if not isinstance(told, Progress):
                    results[pipe] = told
                elif on_progress is not None:
                    on_progress(told)
            if interrupts.is_asked:
                stop.set()
        return results[next(iter(processes))]


@contextmanager
def _started(job: TrainJob, stop: Event) -> Iterator[dict[Connection, SpawnProcess]]:
    """Start the processes, which meet in a folder, and end those that are left; yield them by what they tell."""
    context = multiprocessing.get_context("spawn")
    threads = max(1, torch.get_num_threads() // job.devices)
    processes: dict[Connection, SpawnProcess] = {}
    with TemporaryDirectory(prefix="dgl_sadp-") as meeting:
        try:
            for number in range(job.devices):
                ours, theirs = context.Pipe(duplex=False)
                process = context.Process(
                    target=_run_one, args=(job, number, Path(meeting), threads, theirs, stop)
                )
                with _interrupts_held_back():
                    process.start()
                theirs.close()
                processes[ours] = process
            yield processes
        except BaseException:
            for process in processes.values():
                process.kill()
            raise
        finally:
            for process in processes.values():
                process.join()


@contextmanager
def _interrupts_held_back() -> Iterator[None]:
    """Start processes that Ctrl-C, which reaches every process of a terminal, never reaches: they inherit the mask."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _receive(
    pipe: Connection, processes: dict[Connection, SpawnProcess]
) -> Progress | TrainResult | None:
    """Return what a process tells; raise what it raised, or that one has ended."""
    failure = None
    try:
        told = pipe.recv()
        if not isinstance(told, _Failure):
            return told
        failure = told
    except EOFError:
        processes[pipe].join()
    # Those that fail stay. One that is gone is the cause, and that it no longer answers what the others raise.
    connection.wait([process.sentinel for process in processes.values()], timeout=1.0)
    for number, process in enumerate(processes.values()):
        if process.exitcode not in (None, 0):
            raise TrainingProcessError(
                f"the process of device {number} ended unexpectedly (exit status {process.exitcode}; "
                "-9 is often a lack of memory); resume to go on from the last state"
            )
    assert failure is not None
    raise failure.error from RuntimeError(f"on device {failure.number}:\n{failure.traceback}")


def _run_one(
    job: TrainJob, number: int, meeting: Path, threads: int, pipe: Connection, stop: Event
) -> None:
    """Be the process of a device; tell progress, and at last the result or what went wrong."""
    _end_with_parent()
    torch.set_num_threads(threads)
    # accelerate learns by these that there are others, and which of them this is.
    os.environ.update(
        RANK=str(number),
        LOCAL_RANK=str(number),
        WORLD_SIZE=str(job.devices),
        LOCAL_WORLD_SIZE=str(job.devices),
        OMP_NUM_THREADS=str(threads),
    )
    # Of DP's convolutions, whose pictures come with their channels last.
    warnings.filterwarnings("ignore", "Grad strides do not match bucket view strides")
    try:
        distributed.init_process_group(
            "nccl" if job.device == "cuda" else "gloo",
            init_method=(meeting / "processes").as_uri(),
            rank=number,
            world_size=job.devices,
            timeout=PATIENCE,
        )
        result = run_job(job, pipe.send if number == 0 else None, stop.is_set)
        distributed.destroy_process_group()
    except Exception as error:
        pipe.send(_Failure(number=number, error=error, traceback=traceback.format_exc()))
        threading.Event().wait()  # Until it is ended: the others would fail at once, with less to say.
    else:
        pipe.send(result)


def _end_with_parent() -> None:
    """End this process when its parent is gone, however that ended."""
    parent = multiprocessing.parent_process()
    assert parent is not None

    def watch() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
