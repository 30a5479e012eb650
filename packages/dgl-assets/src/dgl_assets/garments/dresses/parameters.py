"""The measures of a dress."""

from __future__ import annotations

from dataclasses import dataclass, field

from dgl_assets.garments.tops.parameters import compute_span
from dgl_assets.garments.uppers.parameters import Body, Neck, Sleeve


def _default_body() -> Body:
    return Body(length=0.86, waist_depth=0.34, waist_half_width=0.19, hem_half_width=0.30)


@dataclass(frozen=True, kw_only=True)
class DressParameters:
    """Measures of a dress with long or short sleeves.

    Attributes:
        body: Bodice and skirt; `waist_depth` is where the skirt begins: below the bust in an empire line.
        neck: Neckline and collar.
        sleeve: Sleeves, short below about a third of a metre.
    """

    body: Body = field(default_factory=_default_body)
    neck: Neck = field(default_factory=Neck)
    sleeve: Sleeve = field(default_factory=Sleeve)

    def __post_init__(self) -> None:
        if self.body.length < self.body.waist_depth + 0.15:
            raise ValueError(
                f"length of a dress must be at least 0.15 m more than waist_depth "
                f"({self.body.waist_depth}); got {self.body.length}"
            )

    @property
    def span(self) -> float:
        """Upper corner of one cuff to that of the other, sleeves at the mean angle [m]."""
        return compute_span(self.body, self.sleeve)
