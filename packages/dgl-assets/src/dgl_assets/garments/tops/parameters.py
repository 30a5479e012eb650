"""The measures of tops: with long sleeves, without sleeves, and open at the front."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from dgl_assets.garments.uppers.parameters import Armhole, Body, Neck, Opening, Sleeve


@dataclass(frozen=True, kw_only=True)
class TopParameters:
    """Measures of a long-sleeved top that lies flat, arms down and out.

    Defaults are a women's M / men's S regular cut at 85 % of life size; see `sizes`.
    """

    body: Body = field(default_factory=Body)
    neck: Neck = field(default_factory=Neck)
    sleeve: Sleeve = field(default_factory=Sleeve)

    @property
    def span(self) -> float:
        """Upper corner of one cuff to that of the other, sleeves at the mean angle [m]."""
        return compute_span(self.body, self.sleeve)


@dataclass(frozen=True, kw_only=True)
class SleevelessParameters:
    """Measures of a top without sleeves."""

    body: Body = field(default_factory=lambda: Body(shoulder_half_width=0.15))
    """`shoulder_half_width` ends the strap."""
    neck: Neck = field(default_factory=Neck)
    armhole: Armhole = field(default_factory=Armhole)


@dataclass(frozen=True, kw_only=True)
class FrontOpenParameters:
    """Measures of a coat, jacket or cardigan."""

    body: Body = field(default_factory=Body)
    neck: Neck = field(default_factory=Neck)
    """With lapels the neckline runs down the roll line."""
    sleeve: Sleeve = field(default_factory=Sleeve)
    opening: Opening = field(default_factory=Opening)

    @property
    def span(self) -> float:
        """Upper corner of one cuff to that of the other, sleeves at the mean angle [m]."""
        return compute_span(self.body, self.sleeve)


def compute_span(body: Body, sleeve: Sleeve) -> float:
    """Compute the distance of the upper corners of the cuffs, sleeves at the mean angle [m]."""
    return 2 * (body.shoulder_half_width + sleeve.length * math.cos(sleeve.angle))
