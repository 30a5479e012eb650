"""Training: a run is a folder with configuration, log, state and result."""

import dataclasses
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Literal

import torch

from dgl_sadp._train_data import TrainData
from dgl_sadp._train_processes import run_in_processes
from dgl_sadp._train_result import TrainProgress, TrainResult
from dgl_sadp._train_run import CONFIG_FILE, TrainJob, run_job
from dgl_sadp._train_state import hold_interrupts
from dgl_sadp.config import PolicyConfig
from dgl_sadp.errors import CheckpointError
from dgl_sadp.train_config import TrainConfig

__all__ = ["TrainProgress", "TrainResult", "train_policy"]


def train_policy(
    directory: str | Path,
    out: str | Path,
    policy: PolicyConfig,
    config: TrainConfig,
    *,
    is_resumed: bool = False,
    device: str = "cpu",
    devices: int | Literal["auto"] = 1,
    workers: int = 0,
    keep_bytes: int = 2**30,
    on_progress: Callable[[TrainProgress], None] | None = None,
    stop_after: int | None = None,
) -> TrainResult:
    """Train a policy for all stages of a task.

    Damaged episodes, episodes with values that are not finite, and copies of other episodes are
    left out, logged and listed in the result.

    Several devices have a process each, with the same weights and a share of each batch. Random
    numbers depend on the window's place in the batch, so gradients are those of one device but for
    rounding. A script that trains on several devices needs `if __name__ == "__main__":`, because
    the processes import it. Under `torchrun` or `accelerate launch` each process calls this
    function with their number as `devices`; only the first one reports progress and writes.

    Ctrl-C finishes the present step or the next, saves, and raises `KeyboardInterrupt`; a second
    Ctrl-C stops at once.

    Args:
        directory: Folder of episode files.
        out: Folder of the run; made if missing. It holds `policy.safetensors` (averaged weights),
            `state.safetensors`, `config.json`, `logs` for TensorBoard, and kept policies.
        policy: Configuration of the policy; its `stages` become those of the episodes.
        config: Settings of the training.
        is_resumed: Continue the run in `out`. It ends as without the interruption, bitwise on a
            CPU with the same numbers of devices and threads.
        device: "cpu" or "cuda".
        devices: Number of devices, which must divide the batch; "auto" for all CUDA devices. On
            the CPU, number of processes, which share torch's threads.
        workers: Reading processes for each training process.
        keep_bytes: Memory for episodes, in all processes [byte]; other episodes are read again
            each time.
        on_progress: Called after each step.
        stop_after: Save and stop after this step, as an interruption would.

    Raises:
        ValueError: If an argument is out of range, or the episodes do not fit the policy.
        FileNotFoundError: If the folder holds no episode.
        FileExistsError: If `out` holds a run and `is_resumed` is false.
        EpisodeAccessError: If an episode is locked or may not be read.
        CheckpointError: If there is no run to resume, or it was begun with other settings.
        TrainingDivergedError: If the loss is not finite.
        TrainingProcessError: If a process ends without a message.
    """
    out = Path(out)
    count = _count_devices(device, devices)
    if config.batch % (count * config.group):
        raise ValueError(
            f"batch must be a multiple of the {count} devices x group = {config.group}; "
            f"got {config.batch}"
        )
    if workers < 0:
        raise ValueError(f"workers must be at least 0; got {workers}")
    if (out / CONFIG_FILE).exists() != is_resumed:
        if is_resumed:
            raise CheckpointError(f"{out} holds no run to resume")
        raise FileExistsError(f"{out} holds a run already; resume it or choose another folder")
    readers = count * max(1, workers)
    data = TrainData.open(directory, policy, config, keep_bytes=keep_bytes // readers)
    job = TrainJob(
        out=out,
        policy=dataclasses.replace(policy, stages=data.train.stages),
        config=config,
        data=data,
        device=device,
        devices=count,
        workers=workers,
        is_resumed=is_resumed,
        stop_after=stop_after,
    )
    is_launched = "LOCAL_RANK" in os.environ  # Then this is one of the processes already.
    if count > 1 and not is_launched:
        result = run_in_processes(job, on_progress)
    else:
        with hold_interrupts(is_repeated=is_launched) as interrupts, _own_accelerator():
            result = run_job(job, on_progress, lambda: interrupts.is_asked)
    if result is None:
        raise KeyboardInterrupt
    return result


def _count_devices(device: str, devices: int | str) -> int:
    """Return on how many devices to train, if there are as many."""
    if device not in ("cpu", "cuda"):
        raise ValueError(f"device must be 'cpu' or 'cuda'; got {device!r}")
    if device == "cuda" and not torch.cuda.is_available():
        raise ValueError("device 'cuda': torch finds no CUDA device here")
    if devices == "auto":
        if device == "cpu":
            raise ValueError("devices 'auto' is for 'cuda'; on the CPU give a number of processes")
        return torch.cuda.device_count()
    if not isinstance(devices, int) or devices < 1:
        raise ValueError(f"devices must be at least 1, or 'auto'; got {devices!r}")
    if device == "cuda" and devices > torch.cuda.device_count():
        raise ValueError(
            f"devices must be at most the {torch.cuda.device_count()} CUDA device(s) here; got "
            f"{devices}"
        )
    return devices


@contextmanager
def _own_accelerator() -> Iterator[None]:
    """Reset accelerate's global settings afterwards, unless the caller had made some.

    Else one process could not train with two precisions, or on two devices, one after the other.
    """
    from accelerate.state import AcceleratorState

    is_ours = not AcceleratorState._shared_state  # noqa: SLF001 - there is no public way to ask
    try:
        yield
    finally:
        if is_ours:
            AcceleratorState._reset_state(reset_partial_state=True)  # noqa: SLF001 - nor to reset
