"""Ranges of the data, and what maps them to [-1, 1]. They are stored with each policy."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor, nn

from dgl_sadp.config import PolicyConfig

__all__ = ["Normalizer", "Range", "RangeScaler"]

CONSTANT = 1e-4
"""A channel that spans less [rad, m] is constant: scaling would amplify its noise."""

_ISOTROPIC = frozenset({"garment_point_cloud", "object_point_cloud"})


@dataclass(frozen=True)
class Range:
    """Smallest and largest value of each channel."""

    low: np.ndarray
    """Shape (C,), float64."""
    high: np.ndarray
    """Shape (C,), float64."""

    def __post_init__(self) -> None:
        if self.low.ndim != 1 or self.low.shape != self.high.shape:
            raise ValueError(
                f"low and high must have one shape (C,); got {self.low.shape}, {self.high.shape}"
            )
        if not (np.isfinite(self.low).all() and np.isfinite(self.high).all()):
            raise ValueError("low and high must be finite; got NaN or infinity")
        if (self.low > self.high).any():
            raise ValueError("low must not exceed high")

    @classmethod
    def of(cls, values: np.ndarray) -> "Range":
        """Return the range of values, shape (..., C), over all but the last dimension."""
        axes = tuple(range(values.ndim - 1))
        return cls(
            values.min(axis=axes).astype(np.float64), values.max(axis=axes).astype(np.float64)
        )

    def join(self, other: "Range") -> "Range":
        """Return the range that covers both."""
        return Range(np.minimum(self.low, other.low), np.maximum(self.high, other.high))


class RangeScaler(nn.Module):
    """Maps ranges to [-1, 1], and back. Constant channels become 0, and 0 becomes their constant.

    Its buffers are saved with the policy. EMA leaves them alone: they are not learned.
    """

    centre: Tensor
    half_width: Tensor

    def __init__(self, channels: int) -> None:
        """Set up as the identity."""
        super().__init__()
        self.register_buffer("centre", torch.zeros(channels))
        self.register_buffer("half_width", torch.ones(channels))

    def fit(self, found: Range, *, is_isotropic: bool = False) -> None:
        """Take over a range; further channels of it are left out.

        Args:
            found: Range of the data.
            is_isotropic: Whether all channels are scaled alike, by the widest, so that a shape
                stays the same.
        """
        channels = len(self.centre)
        if len(found.low) < channels:
            raise ValueError(f"the range must have {channels} channels; got {len(found.low)}")
        low, high = found.low[:channels], found.high[:channels]
        half = (high - low) / 2
        if is_isotropic:
            half = np.full(channels, half.max())
        self.centre.copy_(torch.from_numpy((low + high) / 2))
        self.half_width.copy_(torch.from_numpy(np.where(2 * half < CONSTANT, 0.0, half)))

    def normalize(self, values: Tensor) -> Tensor:
        """Map values, shape (..., C)."""
        # A constant is divided by 1 and multiplied by 0: no branch, and no division by 0.
        is_varying = self.half_width > 0
        return (values - self.centre) / torch.where(is_varying, self.half_width, 1.0) * is_varying

    def unnormalize(self, values: Tensor) -> Tensor:
        """Map normalised values, shape (..., C), back."""
        return values * self.half_width + self.centre


class Normalizer(nn.ModuleDict):
    """A scaler for each array that a policy sees or commands, by its key in episode files.

    * `action` and `joint_state` [rad], and `env_point_cloud`: every channel by its own range, as
      published. Actions of `relative_joints` are relative to where the stage began.
    * `garment_point_cloud` and `object_point_cloud` [m], world frame: centred, and scaled alike
      along x, y and z, so that all clouds of the data lie within [-1, 1]. It is the same for every
      cloud, so that position and size are still seen. (The original left metres, under radii made
      for unit clouds.)
    """

    def __init__(self, config: PolicyConfig) -> None:
        """Set up as identities for what a policy sees."""
        scalers = {
            "action": RangeScaler(config.joints),
            "joint_state": RangeScaler(config.joints),
        }
        if config.environment is not None:
            scalers["env_point_cloud"] = RangeScaler(6 if config.environment.use_color else 3)
        if config.garment is not None:
            scalers["garment_point_cloud"] = RangeScaler(3)
        if config.object is not None:
            scalers["object_point_cloud"] = RangeScaler(3)
        super().__init__(scalers)

    def fit(self, ranges: Mapping[str, Range]) -> None:
        """Take over the ranges of the data, by key; others than needed are left out.

        Raises:
            ValueError: If one is missing or too short.
        """
        missing = sorted(set(self) - set(ranges))
        if missing:
            raise ValueError(f"ranges must have {sorted(self)}; missing {missing}")
        for key, scaler in self.items():
            assert isinstance(scaler, RangeScaler)
            scaler.fit(ranges[key], is_isotropic=key in _ISOTROPIC)

    def of(self, key: str) -> RangeScaler:
        """Return the scaler of an array."""
        scaler = self[key]
        assert isinstance(scaler, RangeScaler)
        return scaler
