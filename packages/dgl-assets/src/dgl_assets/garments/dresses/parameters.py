"""The measures of a dress."""

from __future__ import annotations

from dataclasses import dataclass, field

from dgl_assets.garments.tops.parameters import compute_span
from dgl_assets.garments.uppers.parameters import Body, Neck, Sleeve
from dgl_assets.ranges import check_limit


def _default_body() -> Body:
    return Body(length=0.86, waist_depth=0.34, waist_half_width=0.19, hem_half_width=0.30)


@dataclass(frozen=True, kw_only=True)
class DressParameters:
    """Measures of a dress with long or short sleeves."""

    body: Body = field(default_factory=_default_body)
    """Bodice and skirt, which begins at `waist_depth`: below the bust in an empire line."""
    neck: Neck = field(default_factory=Neck)
    sleeve: Sleeve = field(default_factory=Sleeve)

    def __post_init__(self) -> None:
        least = self.body.waist_depth + 0.15
        check_limit("length of a dress", self.body.length, "waist_depth + 0.15 m", least=least)

    @property
    def span(self) -> float:
        """Upper corner of one cuff to that of the other, sleeves at the mean angle [m]."""
        return compute_span(self.body, self.sleeve)
