"""The measures of a dress."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from dgl_assets.garments.uppers.parameters import Body, Cuts, SleevedParameters
from dgl_assets.ranges import check_limit


def _default_body() -> Body:
    return Body(length=0.86, waist_depth=0.34, waist_half_width=0.19, hem_half_width=0.30)


@dataclass(frozen=True, kw_only=True)
class DressParameters(SleevedParameters):
    """Measures of a dress with long or short sleeves."""

    body: Body = field(default_factory=_default_body)
    """Bodice and skirt, which begins at `waist_depth`: below the bust in an empire line."""

    def __post_init__(self) -> None:
        least = self.body.waist_depth + 0.15
        check_limit("length of a dress", self.body.length, "waist_depth + 0.15 m", least=least)

    @property
    def cuts(self) -> Cuts:
        """Parts that it is composed of."""
        return replace(super().cuts, has_waist=True)
