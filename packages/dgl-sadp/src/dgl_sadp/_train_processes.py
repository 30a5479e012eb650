"""Training on several devices of one machine: `torch.multiprocessing` runs a process for each."""

import os
import signal
import warnings
from collections.abc import Callable
from queue import Empty
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import torch
from torch import distributed, multiprocessing
from torch.multiprocessing.spawn import ProcessException, ProcessRaisedException

from dgl_sadp._train_result import Progress, TrainResult
from dgl_sadp._train_run import PATIENCE, TrainJob, run_job
from dgl_sadp._train_state import hold_interrupts
from dgl_sadp.errors import TrainingProcessError

if TYPE_CHECKING:
    from multiprocessing.queues import Queue, SimpleQueue

__all__ = ["run_in_processes"]


def run_in_processes(
    job: TrainJob, on_progress: Callable[[Progress], None] | None
) -> TrainResult | None:
    """Do a job in a process for each device; return None if it was interrupted, and everything saved.

    Raises:
        TrainingProcessError: If one of them ends without having said why.
        Exception: What one of them raised.
    """
    context = multiprocessing.get_context("spawn")
    told, ends = context.Queue(), context.SimpleQueue()
    with hold_interrupts() as interrupts, TemporaryDirectory(prefix="dgl_sadp-") as meeting:
        args = (job, f"file://{meeting}/processes", torch.get_num_threads(), told, ends)
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})  # Theirs, until they heed it.
        try:
            processes = multiprocessing.start_processes(_run_one, args, job.devices, join=False)
        finally:
            signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
        try:
            while not (processes.join(0) and told.empty()):
                for process in processes.processes if interrupts.is_asked else ():
                    if process.is_alive():
                        os.kill(process.pid, signal.SIGINT)
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
            raise TrainingProcessError(
                f"{str(error).strip().splitlines()[-1]} (SIGKILL is often a lack of memory); "
                "resume to go on from the last state"
            ) from error
        finally:
            for process in processes.processes:
                process.kill()
                process.join()


def _run_one(
    rank: int,
    job: TrainJob,
    meeting: str,
    threads: int,
    told: "Queue[Progress]",
    ends: "SimpleQueue[TrainResult | Exception | None]",
) -> None:
    """Be the process of a device; tell progress and the result if it is the first, and what goes wrong."""
    torch.set_num_threads(max(1, threads // job.devices))
    # accelerate learns by these that there are others, and which of them this is.
    os.environ.update(
        RANK=str(rank),
        LOCAL_RANK=str(rank),
        WORLD_SIZE=str(job.devices),
        LOCAL_WORLD_SIZE=str(job.devices),
        OMP_NUM_THREADS=str(torch.get_num_threads()),
    )
    # Of DP's convolutions, whose pictures come with their channels last.
    warnings.filterwarnings("ignore", "Grad strides do not match bucket view strides")
    asked: list[int] = []
    signal.signal(signal.SIGINT, lambda number, _: asked.append(number))
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    try:
        distributed.init_process_group(
            "nccl" if job.device == "cuda" else "gloo",
            init_method=meeting,
            rank=rank,
            world_size=job.devices,
            timeout=PATIENCE,
        )
        result = run_job(job, told.put if rank == 0 else None, lambda: bool(asked))
        if rank == 0:
            ends.put(result)
        distributed.destroy_process_group()
    except Exception as error:
        ends.put(error)
        raise
    finally:
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # Nothing is left to save.
