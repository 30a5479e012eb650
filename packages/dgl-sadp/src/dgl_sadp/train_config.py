"""Settings of a training."""

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Literal, get_args

from annotated_types import Interval

from dgl_files.fields import STRICT, check_fields
from dgl_sadp._clouds import Augmentation
from dgl_sadp.config import Method, PolicySize

__all__ = ["TrainConfig", "get_train_config"]

Positive = Annotated[int, Interval(ge=1, le=10**9)]
NotNegative = Annotated[int, Interval(ge=0, le=10**9)]
Seed = Annotated[int, Interval(ge=0, le=2**63 - 1)]


@dataclass(frozen=True, kw_only=True)
class TrainConfig:
    """Settings of a training. Source of optimizer and EMA: DexGarmentLab's code."""

    __pydantic_config__ = STRICT

    epochs: Positive
    """Passes over all windows."""
    batch: Positive
    """Windows in a batch."""
    group: Positive = 1
    """Windows, a divisor of `batch`, that are drawn from one stage of one episode at a time: its
    garment is encoded once for all of them."""
    learning_rate: float = 1e-4
    """Largest learning rate, of AdamW. Source: paper."""
    muon_learning_rate: float | None = None
    """Largest learning rate of Muon, which then trains the matrices in a quarter of AdamW's steps;
    None for AdamW alone, as published. Source: Jordan et al., "Muon: an optimizer for hidden
    layers", 2024."""
    warmup_steps: NotNegative = 500
    """Batches of warm-up, at most a tenth of all; a cosine to zero follows. Source: paper."""
    betas: tuple[float, float] = (0.95, 0.999)
    """Decay of AdamW's moments."""
    weight_decay: float = 1e-6
    """Weight decay of AdamW."""
    ema_power: float = 0.75
    """Power p of the weights' average, which keeps 1 - (1 + step)^-p of itself."""
    ema_decay: float = 0.9999
    """Largest share of the average that a step keeps."""
    validation_share: float = 0.02
    """Share of whole episodes for validation, at least one; 0 for none. Source: paper."""
    split_seed: Seed = 0
    """Seed of the choice of validation episodes."""
    validate_every: Positive = 25
    """Epochs between validations; there is one after the last."""
    validation_windows: Positive = 256
    """Most windows of a validation, evenly spread."""
    save_every: Positive = 1
    """Epochs between states to go on from."""
    keep_every: NotNegative = 0
    """Epochs between policies that are kept besides the last; 0 for none."""
    precision: Literal["no", "bf16"] = "no"
    """Mixed precision; "no" is float32."""
    augmentation: Augmentation | None = field(default_factory=Augmentation)
    """Augmentation of clouds; None for none."""
    with_approach: bool = False
    """Learn the approach to the grasp points, too."""
    seed: Seed = 42
    """Seed of weights and of all random draws."""

    def __post_init__(self) -> None:
        check_fields(self)
        if self.batch % self.group:
            raise ValueError(f"group must divide batch = {self.batch}; got {self.group}")
        for name in ("learning_rate", "muon_learning_rate"):
            value = getattr(self, name)
            if value is not None and not value > 0:
                raise ValueError(f"{name} must be positive; got {value}")
        for name in ("validation_share", "ema_decay"):
            if not 0.0 <= getattr(self, name) < 1.0:
                raise ValueError(f"{name} must lie in [0, 1); got {getattr(self, name)}")


# Source: DexGarmentLab's code; the batch of SADP: paper.
_PAPER: Mapping[str, TrainConfig] = {
    "sadp": TrainConfig(epochs=3000, batch=200, validate_every=25, save_every=10, keep_every=100),
    "sadp-g": TrainConfig(epochs=3000, batch=200, validate_every=25, save_every=10, keep_every=100),
    "dp3": TrainConfig(epochs=10_000, batch=256, validate_every=50, save_every=10, keep_every=500),
    "dp": TrainConfig(epochs=500, batch=32, validate_every=2, save_every=1, keep_every=50),
}
# A twentieth of the weights learns at a larger rate, in far fewer passes.
_SMALL = TrainConfig(
    epochs=60,
    batch=64,
    group=4,
    learning_rate=1e-3,
    muon_learning_rate=0.02,
    warmup_steps=100,
    validation_share=0.05,
    validate_every=5,
)


def get_train_config(method: str, size: str = "small") -> TrainConfig:
    """Return a preset, for the policy's preset of the same name; see `get_policy_config`.

    Raises:
        ValueError: If there is no such policy or preset.
    """
    if method not in get_args(Method):
        raise ValueError(f"method must be one of {list(get_args(Method))}; got {method!r}")
    if size not in get_args(PolicySize):
        raise ValueError(f"size must be one of {list(get_args(PolicySize))}; got {size!r}")
    if size == "paper":
        return _PAPER[method]
    # The average of few steps must forget sooner than that of 10,000s.
    return dataclasses.replace(_SMALL, ema_decay=0.995)
