"""Sizes of the network: what a checkpoint stores to build it again."""

import dataclasses
import difflib
import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated

from annotated_types import Interval, Len

from dgl_files.fields import STRICT, check_fields, decode_json, from_plain

__all__ = [
    "PRESETS",
    "GamLevelConfig",
    "NetworkConfig",
    "YawConfig",
    "check_category",
    "get_network_config",
]

Width = Annotated[int, Interval(ge=1, le=8192)]
Widths = Annotated[tuple[Width, ...], Len(1, 16)]
MAX_ACTIVATIONS = 2**26
"""Most values [float32] of one layer's output for one cloud: 256 MiB."""
_NAME = re.compile(r"\w[\w.-]*")


def _check_activations(name: str, count: int) -> None:
    if count > MAX_ACTIVATIONS:
        raise ValueError(f"{name} must be at most {MAX_ACTIVATIONS}; got {count}")


@dataclass(frozen=True, kw_only=True)
class GamLevelConfig:
    """One set-abstraction level: groups of points, one feature for each group."""

    __pydantic_config__ = STRICT

    centres: Annotated[int, Interval(ge=0, le=2**14)]
    """Centres, chosen by farthest-point sampling. 0: one group of all points, around the origin."""
    radius: Annotated[float, Interval(ge=0.0, le=1000.0)]
    """Radius of a group, in the normalised frame. Not used where `centres` is 0."""
    neighbours: Annotated[int, Interval(ge=0, le=4096)]
    """Largest number of points in a group. Not used where `centres` is 0."""
    widths: Widths
    """Widths of the layers that each point of a group passes."""

    def __post_init__(self) -> None:
        check_fields(self)
        _check_activations(
            "centres x neighbours x the widest layer",
            self.centres * self.neighbours * max(self.widths),
        )
        if self.centres and (self.radius <= 0 or self.neighbours < 1):
            raise ValueError(
                f"radius and neighbours must be positive; got {self.radius} and {self.neighbours}"
            )


@dataclass(frozen=True, kw_only=True)
class YawConfig:
    """The network that finds how a garment is turned about the vertical."""

    __pydantic_config__ = STRICT

    bins: Annotated[int, Interval(ge=8, le=4096)] = 60
    """Angles that are told apart, evenly around the circle."""
    rings: Annotated[int, Interval(ge=2, le=1024)] = 10
    """Distances from the centre that are told apart."""
    radius: Annotated[float, Interval(ge=1e-3, le=1000.0)] = 1.25
    """Outermost ring, in the normalised frame."""
    width: Annotated[int, Interval(ge=4, le=4096)] = 48
    """Channels of the layers, a multiple of 4."""

    def __post_init__(self) -> None:
        check_fields(self)
        if self.width % 4:
            raise ValueError(f"width must be a multiple of 4; got {self.width}")
        _check_activations("rings x bins", self.rings * self.bins)
        _check_activations("bins x width", self.bins * self.width)


@dataclass(frozen=True, kw_only=True)
class NetworkConfig:
    """The network that gives every point of a cloud a feature."""

    __pydantic_config__ = STRICT

    levels: Annotated[tuple[GamLevelConfig, ...], Len(1, 8)]
    """Set-abstraction levels, fine to coarse."""
    up: Annotated[tuple[Widths, ...], Len(1, 8)]
    """Widths of the layers on the way back, coarse to fine, one entry for each level."""
    attention_blocks: Annotated[int, Interval(ge=0, le=64)]
    """Self-attention blocks among the centres of the coarsest level."""
    attention_heads: Annotated[int, Interval(ge=1, le=1024)]
    """Heads of each of them."""
    head_width: Width
    """Width of the hidden layer before the features."""
    features: Width
    """Length of a point's feature."""
    categories: Annotated[tuple[Annotated[str, Len(1, 100)], ...], Len(0, 1000)] = ()
    """Categories of garments that it is for. More than one: each has a learned embedding."""
    yaw: YawConfig = YawConfig()
    """The network that turns clouds into the garment's own frame first."""

    def __post_init__(self) -> None:
        check_fields(self)
        if len(self.up) != len(self.levels):
            raise ValueError(
                f"up must have one entry for each level; got {len(self.up)} for {len(self.levels)}"
            )
        if self.levels[0].centres == 0:
            raise ValueError("centres of the first level must be at least 1; got 0")
        for finer, coarser in zip(self.levels, self.levels[1:], strict=False):
            if finer.centres == 0 or coarser.centres > finer.centres:
                raise ValueError(
                    f"centres must fall from level to level; got {finer.centres}, {coarser.centres}"
                )
        width = self.levels[-1].widths[-1]
        if self.attention_blocks and width % self.attention_heads:
            raise ValueError(f"attention_heads must divide {width}; got {self.attention_heads}")
        if self.attention_blocks:
            _check_activations(
                "attention_heads x the square of the last level's centres",
                self.attention_heads * self.levels[-1].centres ** 2,
            )
        if len(set(self.categories)) != len(self.categories):
            raise ValueError(f"categories must differ; got {self.categories}")
        for name in self.categories:
            check_category(name)

    def to_json(self) -> str:
        """Write as JSON, as checkpoints store it."""
        return json.dumps(dataclasses.asdict(self))

    @classmethod
    def from_json(cls, text: str) -> "NetworkConfig":
        """Read what `to_json` wrote.

        Raises:
            ValueError: If it is no JSON object, or a field is missing, unknown or of a wrong type.
        """
        return from_plain(cls, decode_json(text))


def check_category(name: str) -> None:
    """Refuse names of categories that are no names of files: runs and weights are named by them."""
    if not _NAME.fullmatch(name):
        raise ValueError(
            "a category must be letters, digits, '_', '-' and '.', such as Tops_LongSleeve; got "
            f"{name!r}"
        )


PRESETS: Mapping[str, NetworkConfig] = {
    "small": NetworkConfig(
        levels=(
            GamLevelConfig(centres=384, radius=0.2, neighbours=16, widths=(32, 64)),
            GamLevelConfig(centres=96, radius=0.4, neighbours=24, widths=(96, 128)),
            GamLevelConfig(centres=32, radius=0.8, neighbours=16, widths=(128, 128)),
        ),
        up=((128,), (128,), (128,)),
        attention_blocks=2,
        attention_heads=4,
        head_width=128,
        features=128,
    ),
    # Source: DexGarmentLab's code, PointNet++ with single-scale grouping; no dropout, layer norm
    # for batch norm.
    "paper": NetworkConfig(
        levels=(
            GamLevelConfig(centres=512, radius=0.2, neighbours=32, widths=(64, 64, 128)),
            GamLevelConfig(centres=128, radius=0.4, neighbours=64, widths=(128, 128, 256)),
            GamLevelConfig(centres=0, radius=0.0, neighbours=0, widths=(256, 512, 1024)),
        ),
        up=((256, 256), (256, 128), (128, 128, 128)),
        attention_blocks=0,
        attention_heads=1,
        head_width=128,
        features=512,
    ),
}
"""Networks by name: "small" is for CPUs, "paper" has the sizes of DexGarmentLab's."""


def get_network_config(name: str) -> NetworkConfig:
    """Return a preset.

    Raises:
        ValueError: If there is none of that name.
    """
    if name not in PRESETS:
        near = difflib.get_close_matches(name, PRESETS, n=1)
        hint = f"; did you mean {near[0]!r}?" if near else ""
        raise ValueError(f"network must be one of {sorted(PRESETS)}; got {name!r}{hint}")
    return PRESETS[name]
