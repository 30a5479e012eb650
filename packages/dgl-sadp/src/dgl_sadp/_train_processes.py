"""Training on several devices of one machine: `torch.multiprocessing` runs a process for each."""

import multiprocessing
import os
import signal
import warnings
from collections.abc import Callable
from queue import Empty
from tempfile import TemporaryDirectory
from typing import Any

import torch
from torch import distributed
from torch.multiprocessing.spawn import ProcessException, ProcessRaisedException, start_processes

from dgl_sadp._train_result import TrainProgress, TrainResult
from dgl_sadp._train_run import PATIENCE, TrainJob, run_job
from dgl_sadp._train_state import hold_interrupts
from dgl_sadp.errors import TrainingProcessError

__all__ = ["run_in_processes"]


def run_in_processes(
    job: TrainJob, on_progress: Callable[[TrainProgress], None] | None
) -> TrainResult | None:
    """Run a job in one process per device; return None if it was interrupted."""
    context = multiprocessing.get_context("spawn")
    told, ends, stop = context.Queue(), context.SimpleQueue(), context.Event()
    with hold_interrupts() as interrupts, TemporaryDirectory(prefix="dgl_sadp-") as meeting:
        threads = max(1, torch.get_num_threads() // job.devices)
        args = (job, f"file://{meeting}/processes", threads, told, ends, stop, os.getpid())
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})  # They inherit it.
        try:
            spawned: Any = start_processes(_run_one, args, job.devices, join=False)
        finally:
            signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
        try:
            while not (spawned.join(0) and told.empty()):
                if interrupts.is_asked:
                    stop.set()
                try:
                    progress = told.get(timeout=0.2)
                except Empty:
                    continue
                if on_progress is not None:
                    on_progress(progress)
            return ends.get()
        except ProcessException as error:
            end = None if ends.empty() else ends.get()
            # Where one was killed, it is of the others, which say that it no longer answers.
            if isinstance(error, ProcessRaisedException) and isinstance(end, Exception):
                raise end from error
            reason = str(error).strip().splitlines()[-1]
            raise TrainingProcessError(
                f"{reason} (SIGKILL is often a lack of memory); resume to go on from the last state"
            ) from error
        finally:
            for process in spawned.processes:
                process.kill()
                process.join()


def _run_one(
    rank: int,
    job: TrainJob,
    meeting: str,
    threads: int,
    told: Any,
    ends: Any,
    stop: Any,
    parent: int,
) -> None:
    """Be the process of a device, until it is done, told to stop, or without a parent."""
    torch.set_num_threads(threads)
    # accelerate learns by these that there are others, and which of them this is.
    os.environ.update(RANK=str(rank), LOCAL_RANK=str(rank), OMP_NUM_THREADS=str(threads))
    os.environ.update(WORLD_SIZE=str(job.devices), LOCAL_WORLD_SIZE=str(job.devices))
    # Of DP's convolutions, whose pictures come with their channels last.
    warnings.filterwarnings("ignore", "Grad strides do not match bucket view strides")
    try:
        backend = "nccl" if job.device == "cuda" else "gloo"
        distributed.init_process_group(backend, meeting, PATIENCE, job.devices, rank)
        tell = told.put if rank == 0 else None
        result = run_job(job, tell, lambda: stop.is_set() or os.getppid() != parent)
        if rank == 0:
            ends.put(result)
        distributed.destroy_process_group()
    except Exception as error:
        ends.put(error)
        raise
