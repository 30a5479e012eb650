"""Sizes of the network: what a checkpoint stores to build it again."""

import dataclasses
import difflib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

__all__ = ["PRESETS", "LevelConfig", "NetworkConfig", "YawConfig", "get_network_config"]


@dataclass(frozen=True, kw_only=True)
class LevelConfig:
    """One set-abstraction level: points are grouped around centres, and each group becomes one feature."""

    centres: int
    """Centres, chosen by farthest-point sampling. 0: one group of all points, around the origin."""
    radius: float
    """Radius of a group, in the normalised frame. Not used where `centres` is 0."""
    neighbours: int
    """Largest number of points in a group. Not used where `centres` is 0."""
    widths: tuple[int, ...]
    """Widths of the layers that each point of a group passes."""

    def __post_init__(self) -> None:
        if self.centres < 0 or not self.widths or min(self.widths) < 1:
            raise ValueError(
                f"centres must be >= 0 and widths positive; got {self.centres} and {self.widths}"
            )
        if self.centres and (self.radius <= 0 or self.neighbours < 1):
            raise ValueError(
                f"radius and neighbours must be positive; got {self.radius} and {self.neighbours}"
            )


@dataclass(frozen=True, kw_only=True)
class YawConfig:
    """The network that finds how a garment is turned about the vertical."""

    bins: int = 60
    """Angles that are told apart, evenly around the circle."""
    rings: int = 10
    """Distances from the centre that are told apart."""
    radius: float = 1.25
    """Outermost ring, in the normalised frame."""
    width: int = 48
    """Channels of the layers."""

    def __post_init__(self) -> None:
        if self.bins < 8 or self.rings < 2 or self.width < 1 or self.radius <= 0:
            raise ValueError(
                "bins must be >= 8, rings >= 2, width and radius positive; got "
                f"{self.bins}, {self.rings}, {self.width}, {self.radius}"
            )


@dataclass(frozen=True, kw_only=True)
class NetworkConfig:
    """The network that gives every point of a cloud a feature."""

    levels: tuple[LevelConfig, ...]
    """Set-abstraction levels, fine to coarse."""
    up: tuple[tuple[int, ...], ...]
    """Widths of the layers on the way back, coarse to fine, one entry for each level."""
    attention_blocks: int
    """Self-attention blocks among the centres of the coarsest level."""
    attention_heads: int
    """Heads of each of them."""
    head_width: int
    """Width of the hidden layer before the features."""
    features: int
    """Length of a point's feature."""
    categories: tuple[str, ...] = ()
    """Categories of garments that it is for. More than one: each has a learned embedding."""
    yaw: YawConfig = YawConfig()
    """The network that turns clouds into the garment's own frame first."""

    def __post_init__(self) -> None:
        if len(self.up) != len(self.levels) or not self.levels:
            raise ValueError(
                f"up must have one entry for each level; got {len(self.up)} for {len(self.levels)}"
            )
        for finer, coarser in zip(self.levels, self.levels[1:], strict=False):
            if finer.centres == 0 or coarser.centres > finer.centres:
                raise ValueError(
                    f"centres must fall from level to level; got {finer.centres}, {coarser.centres}"
                )
        width = self.levels[-1].widths[-1]
        if self.attention_heads < 1 or (self.attention_blocks and width % self.attention_heads):
            raise ValueError(f"attention_heads must divide {width}; got {self.attention_heads}")
        if len(set(self.categories)) != len(self.categories):
            raise ValueError(f"categories must differ; got {self.categories}")

    def to_json(self) -> str:
        """Write as JSON, as checkpoints store it."""
        return json.dumps(dataclasses.asdict(self))

    @classmethod
    def from_json(cls, text: str) -> "NetworkConfig":
        """Read what `to_json` wrote.

        Raises:
            ValueError: If it is no JSON object, or a field is missing, unknown or of a wrong type.
        """
        values = json.loads(text)
        if not isinstance(values, dict):
            raise ValueError(f"a network's configuration must be an object; got {text[:60]}")
        try:
            fields: dict[str, Any] = dict(values)
            fields["levels"] = tuple(
                LevelConfig(**{**level, "widths": tuple(level["widths"])})
                for level in values["levels"]
            )
            fields["up"] = tuple(tuple(widths) for widths in values["up"])
            fields["categories"] = tuple(values["categories"])
            fields["yaw"] = YawConfig(**values["yaw"])
            return cls(**fields)
        except (TypeError, KeyError, AttributeError) as err:
            raise ValueError(f"a network's configuration is wrong: {err}") from err


PRESETS: Mapping[str, NetworkConfig] = {
    "small": NetworkConfig(
        levels=(
            LevelConfig(centres=384, radius=0.2, neighbours=16, widths=(32, 64)),
            LevelConfig(centres=96, radius=0.4, neighbours=24, widths=(96, 128)),
            LevelConfig(centres=32, radius=0.8, neighbours=16, widths=(128, 128)),
        ),
        up=((128,), (128,), (128,)),
        attention_blocks=2,
        attention_heads=4,
        head_width=128,
        features=128,
    ),
    # Source: DexGarmentLab's code, PointNet++ with single-scale grouping; no dropout, layer norm for batch norm.
    "paper": NetworkConfig(
        levels=(
            LevelConfig(centres=512, radius=0.2, neighbours=32, widths=(64, 64, 128)),
            LevelConfig(centres=128, radius=0.4, neighbours=64, widths=(128, 128, 256)),
            LevelConfig(centres=0, radius=0.0, neighbours=0, widths=(256, 512, 1024)),
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
