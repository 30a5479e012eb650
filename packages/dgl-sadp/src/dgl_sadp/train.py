"""Training: a run is a folder with its configuration, its log, the state to go on from, and the policy."""

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import torch

from dgl_sadp._train_data import TrainData
from dgl_sadp._train_run import CONFIG_FILE, POLICY_FILE, Progress, TrainRun
from dgl_sadp.config import PolicyConfig
from dgl_sadp.errors import CheckpointError, CorruptEpisodeError
from dgl_sadp.train_config import TrainConfig
from dgl_sadp.validation import Validation

__all__ = ["Progress", "TrainResult", "train_policy"]


@dataclass(frozen=True, kw_only=True)
class TrainResult:
    """What a training came to."""

    policy: Path
    """The policy's file."""
    steps: int
    """Steps done, over all resumptions."""
    loss: float
    """Mean loss of the last whole epoch; NaN if none was finished."""
    validation: Validation | None
    """The last validation."""
    episodes: int
    """Episodes trained on."""
    validation_episodes: int
    """Episodes validated on."""
    windows: int
    """Windows in an epoch."""
    refused: tuple[CorruptEpisodeError, ...]
    """What is wrong with the files that were left out."""


def train_policy(
    directory: str | Path,
    out: str | Path,
    policy: PolicyConfig,
    config: TrainConfig,
    *,
    stage: int,
    is_resumed: bool = False,
    device: str = "cpu",
    workers: int = 0,
    keep_bytes: int = 2**30,
    on_progress: Callable[[Progress], None] | None = None,
    stop_after: int | None = None,
) -> TrainResult:
    """Train a policy for one stage.

    Files that are damaged or hold values that are not finite are left out, logged and listed in the result.

    Ctrl-C ends the step in progress, saves, and raises `KeyboardInterrupt`; a second one stops at once.

    Args:
        directory: Folder of episode files.
        out: Folder of the run; made if missing. It holds `policy.safetensors` (the averaged weights), `state.safetensors`,
            `config.json`, `logs` for TensorBoard and the policies kept on the way.
        policy: What is trained.
        config: How it is trained.
        stage: Number of the stage, from 1.
        is_resumed: Whether to go on with the run in `out`. It ends as it would have without the interruption, bitwise on a
            CPU with the same number of threads.
        device: "cpu" or "cuda".
        workers: Processes that read episodes beside this one.
        keep_bytes: Memory for frames of episodes, in all processes [byte]; what does not fit is read each time.
        on_progress: Called after each step.
        stop_after: Save and stop after this step, as an interruption would.

    Raises:
        ValueError: If an argument is out of range, or the episodes do not fit the policy.
        FileNotFoundError: If the folder holds no episode.
        FileExistsError: If `out` holds a run and `is_resumed` is false.
        CheckpointError: If there is nothing to resume, or it was begun with something else.
        TrainingDivergedError: If the loss is not finite.
    """
    out = Path(out)
    if device not in ("cpu", "cuda"):
        raise ValueError(f"device must be 'cpu' or 'cuda'; got {device!r}")
    if device == "cuda" and not torch.cuda.is_available():
        raise ValueError("device 'cuda': torch finds no CUDA device here")
    if workers < 0:
        raise ValueError(f"workers must be at least 0; got {workers}")
    if (out / CONFIG_FILE).exists() != is_resumed:
        if is_resumed:
            raise CheckpointError(f"{out} holds no run to resume")
        raise FileExistsError(f"{out} holds a run already; resume it or choose another folder")
    data = TrainData.open(
        directory, policy, config, stage, keep_bytes=keep_bytes // max(1, workers)
    )
    with _own_accelerator():
        run = TrainRun(out, policy, config, data, device=device, workers=workers)
        run.begin(is_resumed=is_resumed)
        run.train(on_progress, stop_after)
        return _describe(run)


def _describe(run: TrainRun) -> TrainResult:
    """Say what a training came to."""
    held_out = run.data.validation
    return TrainResult(
        policy=run.out / POLICY_FILE,
        steps=run.state.step,
        loss=run.state.last.get("loss", math.nan),
        validation=run.validation,
        episodes=len(run.data.train.episodes),
        validation_episodes=0 if held_out is None else len(held_out.episodes),
        windows=len(run.data.train),
        refused=run.data.refused,
    )


@contextmanager
def _own_accelerator() -> Iterator[None]:
    """Forget accelerate's settings afterwards, which are global, unless the caller had made some before.

    Else one process could not train with two precisions, or on two devices, one after the other.
    """
    from accelerate.state import AcceleratorState

    is_ours = not AcceleratorState._shared_state  # noqa: SLF001 - there is no public way to ask
    try:
        yield
    finally:
        if is_ours:
            AcceleratorState._reset_state(reset_partial_state=True)  # noqa: SLF001 - nor to reset
