"""Progress and result of a training."""

from dataclasses import dataclass
from pathlib import Path

from dgl_sadp.errors import DamagedEpisodeError
from dgl_sadp.validation import Validation

__all__ = ["TrainProgress", "TrainResult"]


@dataclass(frozen=True, kw_only=True)
class TrainProgress:
    """Progress after a step."""

    step: int
    """Steps done."""
    steps: int
    """Steps to do in all."""
    epoch: int
    """Number of the present epoch, from 1."""
    epochs: int
    """Epochs in all."""
    loss: float
    """Loss of the last batch."""
    seconds_left: float
    """Time that the rest will take [s], from the mean of this run's steps."""
    validation: Validation | None
    """The last validation."""


@dataclass(frozen=True, kw_only=True)
class TrainResult:
    """Result of a training."""

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
    refused: tuple[DamagedEpisodeError, ...]
    """Errors of the files that were left out."""
