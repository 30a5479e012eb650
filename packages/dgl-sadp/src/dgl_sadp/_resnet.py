"""A residual network of 18 layers over pictures, with group norms, which EMA copies as they are.

Source: He et al., "Deep Residual Learning", 2016; group norm of channels / 16 groups:
DexGarmentLab's code.
"""

import torch
from torch import Tensor, nn
from torch.nn import functional

from dgl_sadp.config import ImageConfig

__all__ = ["ImageNet18"]

# Mean and standard deviation of red, green and blue in ImageNet, by which pictures are customarily
# normalised.
_MEAN = (0.485, 0.456, 0.406)
_STD = (0.229, 0.224, 0.225)


class ImageNet18(nn.Module):
    """One feature of a picture."""

    mean: Tensor
    std: Tensor

    def __init__(self, config: ImageConfig) -> None:
        super().__init__()
        self.size = (config.height, config.width)
        first = config.widths[0]
        self.stem = nn.Sequential(
            nn.Conv2d(3, first, 7, stride=2, padding=3, bias=False),
            _norm(first),
            nn.ReLU(),
            nn.MaxPool2d(3, stride=2, padding=1),
        )
        blocks: list[nn.Module] = []
        before = first
        for stage, width in enumerate(config.widths):
            blocks += [_Block(before, width, stride=1 if stage == 0 else 2), _Block(width, width)]
            before = width
        self.blocks = nn.Sequential(*blocks)
        self.register_buffer("mean", torch.tensor(_MEAN).reshape(3, 1, 1), persistent=False)
        self.register_buffer("std", torch.tensor(_STD).reshape(3, 1, 1), persistent=False)

    def forward(self, images: Tensor) -> Tensor:
        """Map pictures, shape (B, H, W, 3), uint8, to features, shape (B, widths[-1])."""
        x = (self._scale(images) - self.mean) / self.std
        return self.blocks(self.stem(x)).mean(dim=(2, 3))

    @torch.no_grad()
    def _scale(self, images: Tensor) -> Tensor:
        """Return pictures in [0, 1] of the network's size, shape (B, 3, height, width)."""
        scaled: list[Tensor] = []
        for part in images.split(
            32
        ):  # Whole batches of large pictures as floats would fill the memory.
            x = part.movedim(3, 1).to(self.mean.dtype) / 255.0
            if x.shape[2:] != self.size:
                # Averages of areas: nothing of the picture is skipped.
                x = functional.interpolate(x, size=self.size, mode="area")
            scaled.append(x)
        return torch.cat(scaled)


class _Block(nn.Module):
    """Two convolutions added to their input."""

    def __init__(self, in_channels: int, out_channels: int, stride: int = 1) -> None:
        super().__init__()
        self.layers = nn.Sequential(
            nn.Conv2d(in_channels, out_channels, 3, stride=stride, padding=1, bias=False),
            _norm(out_channels),
            nn.ReLU(),
            nn.Conv2d(out_channels, out_channels, 3, padding=1, bias=False),
            _norm(out_channels),
        )
        self.skip: nn.Module = nn.Identity()
        if stride != 1 or in_channels != out_channels:
            self.skip = nn.Sequential(
                nn.Conv2d(in_channels, out_channels, 1, stride=stride, bias=False),
                _norm(out_channels),
            )

    def forward(self, x: Tensor) -> Tensor:
        return torch.relu(self.layers(x) + self.skip(x))


def _norm(channels: int) -> nn.GroupNorm:
    return nn.GroupNorm(channels // 16, channels)
