"""Seeds and random numbers of a training, independent of how batches are divided."""

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
import torch
from torch import Tensor

__all__ = ["ORDER", "STEP", "VALIDATION", "Draws", "Share", "draw_seed"]

# What numbers are drawn for; part of each seed.
ORDER, STEP, VALIDATION = 1, 2, 3


def draw_seed(seed: int, purpose: int, number: int) -> int:
    """Return a seed for one thing that is drawn, unlike those of all others."""
    return int(np.random.SeedSequence([seed, purpose, number]).generate_state(1, np.uint64)[0] >> 1)


@dataclass(frozen=True, kw_only=True)
class Share:
    """Rows of a batch that one process computes: `start` up to `stop` of `total`."""

    start: int
    stop: int
    total: int
    weight: float
    """By which its mean counts, so that the mean over the processes is the mean over all rows."""

    @classmethod
    def of(cls, total: int, process: int = 0, processes: int = 1) -> "Share":
        """Return the share of a process.

        Args:
            total: Rows of the batch, at least 1. An epoch's last batch may have fewer rows than
                there are processes: those that are left without compute one that counts for
                nothing.
            process: Number of the process, from 0.
            processes: How many there are.
        """
        start, stop = (total * number // processes for number in (process, process + 1))
        weight = (stop - start) * processes / total
        return cls(start=start, stop=max(stop, start + 1), total=total, weight=weight)

    def multiply(self, by: int) -> "Share":
        """Return the share where each row becomes several."""
        return dataclasses.replace(
            self, start=self.start * by, stop=self.stop * by, total=self.total * by
        )

    def divide(self, by: int) -> "Share":
        """Return the share where several rows become one: the reverse of `multiply`."""
        return dataclasses.replace(
            self, start=self.start // by, stop=self.stop // by, total=self.total // by
        )


class Draws:
    """Random numbers for the samples of a batch, on the generator's device.

    They are drawn for all rows of the batch, of which those of the share are returned: what a
    sample gets follows from the seed and from its place in the batch, and not from how many
    processes divide it.
    """

    def __init__(self, generator: torch.Generator, share: Share | None = None) -> None:
        """Draw from a generator; `share` is given where a batch is a part of another."""
        self._generator = generator
        self._share = share

    def permutation(self, size: int) -> Tensor:
        """Draw an order, the same for all samples, shape (size,), int64."""
        return torch.randperm(size, generator=self._generator, device=self._generator.device)

    def uniform(self, shape: tuple[int, ...]) -> Tensor:
        """Draw from [0, 1), shape (B, ...)."""
        return self._draw(torch.rand, shape)

    def normal(self, shape: tuple[int, ...]) -> Tensor:
        """Draw from the standard normal distribution, shape (B, ...)."""
        return self._draw(torch.randn, shape)

    def integers(self, below: int, shape: tuple[int, ...]) -> Tensor:
        """Draw from 0 ... below - 1, shape (B, ...), int64."""
        return self._draw(partial(torch.randint, below), shape)

    def _draw(self, function: Callable[..., Tensor], shape: tuple[int, ...]) -> Tensor:
        options = {"generator": self._generator, "device": self._generator.device}
        share = self._share
        if share is None:
            return function(shape, **options)
        if shape[0] != share.stop - share.start:
            raise ValueError(
                f"the batch must have its share of {share.stop - share.start} rows; got {shape[0]}"
            )
        return function((share.total, *shape[1:]), **options)[share.start : share.stop]
