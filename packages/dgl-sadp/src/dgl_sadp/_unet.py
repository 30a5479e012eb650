"""A one-dimensional U-Net over action chunks, conditioned by scale and bias (FiLM).

Source of the structure: Chi et al., "Diffusion Policy", 2023, section on the CNN-based policy;
Perez et al., "FiLM", 2018.
"""

import math
from itertools import pairwise

import torch
from torch import Tensor, nn
from torch.nn import functional

from dgl_sadp.config import UNetConfig

__all__ = ["ConditionalUNet"]


class ConditionalUNet(nn.Module):
    """Predicts, of noisy actions, the clean ones (or the noise).

    Each level has two residual blocks. Between levels the chunk is halved on the way down and
    doubled on the way up, where the features of the same level of the way down are added as
    channels. What was observed stays the same while a chunk is denoised, so its part in every
    block's scale and bias is computed once, by `project`.
    """

    def __init__(self, config: UNetConfig, *, actions: int, condition: int) -> None:
        """Set up for actions of length `actions` under conditions of length `condition`."""
        super().__init__()
        embedding = config.step_embedding
        self.embed_step = nn.Sequential(
            _SinusoidalEmbedding(embedding),
            nn.Linear(embedding, 4 * embedding),
            nn.Mish(),
            nn.Linear(4 * embedding, embedding),
        )
        widths = (actions, *config.widths)
        blocks: list[_ResidualBlock] = []

        def block(in_channels: int, out_channels: int) -> _ResidualBlock:
            blocks.append(_ResidualBlock(in_channels, out_channels, config.kernel, config.groups))
            return blocks[-1]

        self.down = nn.ModuleList()
        for level, (before, after) in enumerate(pairwise(widths)):
            is_last = level == len(config.widths) - 1
            halve = nn.Identity() if is_last else nn.Conv1d(after, after, 3, stride=2, padding=1)
            self.down.append(nn.ModuleList([block(before, after), block(after, after), halve]))
        deepest = widths[-1]
        self.middle = nn.ModuleList([block(deepest, deepest), block(deepest, deepest)])
        self.up = nn.ModuleList()
        for below, above in zip(reversed(widths[2:]), reversed(widths[1:-1]), strict=True):
            double = nn.ConvTranspose1d(above, above, 4, stride=2, padding=1)
            self.up.append(nn.ModuleList([block(2 * below, above), block(above, above), double]))
        first = widths[1]
        self.out = nn.Sequential(
            _ConvBlock(first, first, config.kernel, config.groups), nn.Conv1d(first, actions, 1)
        )
        # Scales and biases of all blocks, linear in (step, condition), as one product each.
        self.film_sizes = [2 * each.channels for each in blocks]
        self.film_step = nn.Sequential(nn.Mish(), nn.Linear(embedding, sum(self.film_sizes)))
        squeezed = [] if config.film is None else [nn.Linear(condition, config.film)]
        self.film_condition = nn.Sequential(
            *squeezed,
            nn.Mish(),
            nn.Linear(config.film or condition, sum(self.film_sizes), bias=False),
        )

    def project(self, condition: Tensor) -> Tensor:
        """Compute the condition's part of all scales and biases, shape (B, F)."""
        return self.film_condition(condition)

    def forward(self, noisy: Tensor, step: Tensor, projected: Tensor) -> Tensor:
        """Predict.

        Args:
            noisy: Noisy normalised actions, shape (B, T, D).
            step: Level of noise of each chunk, shape (B,), int64.
            projected: What `project` made of the condition, shape (B, F).

        Returns:
            Shape (B, T, D).
        """
        film = self.film_step(self.embed_step(step)) + projected
        films = iter(film.unsqueeze(2).split(self.film_sizes, dim=1))  # each (B, 2 C, 1)
        x = noisy.mT  # (B, D, T): convolutions run over time
        kept: list[Tensor] = []
        for first, second, halve in self.down:  # type: ignore[misc] - a list of three modules
            x = second(first(x, next(films)), next(films))
            kept.append(x)
            x = halve(x)
        for module in self.middle:
            x = module(x, next(films))
        for first, second, double in self.up:  # type: ignore[misc]
            x = torch.cat([x, kept.pop()], dim=1)
            x = double(second(first(x, next(films)), next(films)))
        return self.out(x).mT


class _TimeConv(nn.Linear):
    """Convolution over time that keeps its length, as one product with a matrix of shape (C', C K).

    For chunks of a few frames this takes a third of the time of PyTorch's convolution on a CPU, and
    Muon trains matrices.
    """

    def __init__(self, in_channels: int, out_channels: int, kernel: int) -> None:
        super().__init__(in_channels * kernel, out_channels)
        self.kernel = kernel

    def forward(self, input: Tensor) -> Tensor:
        batch, _, length = input.shape
        padded = functional.pad(input, (self.kernel // 2, self.kernel // 2))
        windows = padded.unfold(2, self.kernel, 1).transpose(1, 2)  # (B, T, C, K)
        return super().forward(windows.reshape(batch * length, -1)).view(batch, length, -1).mT


class _ConvBlock(nn.Sequential):
    """Convolution over time, group norm, Mish."""

    def __init__(self, in_channels: int, out_channels: int, kernel: int, groups: int) -> None:
        super().__init__(
            _TimeConv(in_channels, out_channels, kernel),
            nn.GroupNorm(groups, out_channels),
            nn.Mish(),
        )


class _ResidualBlock(nn.Module):
    """Two convolutions; between them every channel is scaled and shifted."""

    def __init__(self, in_channels: int, out_channels: int, kernel: int, groups: int) -> None:
        super().__init__()
        self.channels = out_channels
        self.first = _ConvBlock(in_channels, out_channels, kernel, groups)
        self.second = _ConvBlock(out_channels, out_channels, kernel, groups)
        self.skip = (
            nn.Identity()
            if in_channels == out_channels
            else nn.Conv1d(in_channels, out_channels, 1)
        )

    def forward(self, x: Tensor, film: Tensor) -> Tensor:
        """Map features, shape (B, C, T), under scale and bias, shape (B, 2 C', 1)."""
        scale, bias = film.chunk(2, dim=1)
        return self.second(self.first(x) * scale + bias) + self.skip(x)


class _SinusoidalEmbedding(nn.Module):
    """Sines and cosines of the step, at frequencies from 1 down to 1e-4 per step."""

    frequencies: Tensor

    def __init__(self, features: int) -> None:
        super().__init__()
        half = features // 2
        exponents = torch.arange(half) * (-math.log(1e4) / (half - 1))
        self.register_buffer("frequencies", torch.exp(exponents), persistent=False)

    def forward(self, step: Tensor) -> Tensor:
        angles = step[:, None] * self.frequencies
        return torch.cat([angles.sin(), angles.cos()], dim=1)
