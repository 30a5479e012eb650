"""The measures of tops: with long sleeves, without sleeves, and open at the front."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from dgl_assets.garments.uppers.parameters import (
    Armhole,
    Body,
    Cuts,
    Neck,
    Opening,
    SleevedParameters,
)

_OPEN_NECK_DIP = (0.30, 0.035)  # necklines of open fronts fall deeper


@dataclass(frozen=True, kw_only=True)
class TopParameters(SleevedParameters):
    """Measures of a long-sleeved top.

    Defaults are a women's M / men's S regular cut at 85 % of life size; see `sizes`.
    """


@dataclass(frozen=True, kw_only=True)
class SleevelessParameters:
    """Measures of a top without sleeves."""

    body: Body = field(default_factory=lambda: Body(shoulder_half_width=0.15))
    """`shoulder_half_width` ends the strap."""
    neck: Neck = field(default_factory=Neck)
    armhole: Armhole = field(default_factory=Armhole)

    @property
    def cuts(self) -> Cuts:
        """Parts that it is composed of."""
        return Cuts(body=self.body, neck=self.neck, armhole=self.armhole)


@dataclass(frozen=True, kw_only=True)
class FrontOpenParameters(SleevedParameters):
    """Measures of a coat, jacket or cardigan. With lapels the neckline runs down the roll line."""

    opening: Opening = field(default_factory=Opening)

    @property
    def cuts(self) -> Cuts:
        """Parts that it is composed of."""
        return replace(super().cuts, opening=self.opening, neck_dip=_OPEN_NECK_DIP)
