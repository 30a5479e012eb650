"""Make tops: cut the pattern, sew it, lay it flat.

Landmarks are exact correspondences. All tops have, with `left_` or `right_`, `shoulder` (inside the
shoulder point, or in the middle of a strap), `upper_chest`, `hem` (inside the hem corner), the
corners `armpit`, `hem_corner` and `neck_side` (highest point of the shoulder); `centre`,
`hem_centre`, and `collar`, on the back layer below the neckline. Sleeves add `cuff` (inside the
cuff, upper layer), `cuff_upper`, `cuff_lower` and `sleeve_joint` (upper sleeve, just outside the
armhole). Open fronts add `lapel` (on the front, beside the neck), `front` (beside the opening),
`opening_top` and `opening_hem`; their `centre` and `hem_centre` are on the back.
"""

from __future__ import annotations

from dgl_assets.garments.assembly import assemble
from dgl_assets.garments.garment import Garment
from dgl_assets.garments.tops.parameters import (
    FrontOpenParameters,
    SleevelessParameters,
    TopParameters,
)
from dgl_assets.garments.uppers.cutting import Pins, cut_upper
from dgl_assets.garments.uppers.half import Cuts
from dgl_assets.garments.uppers.sleeve import V_ARMPIT

LONG_SLEEVE = "Tops_LongSleeve"
NO_SLEEVE = "Tops_NoSleeve"
FRONT_OPEN = "Tops_FrontOpen"

V_CUFF = (1 + V_ARMPIT) / 2
_ON_SLEEVE: Pins = {"{}_cuff": (1.93, V_CUFF, 1), "{}_sleeve_joint": (1.06, 0.86, 1)}
_ON_BODY: Pins = {"centre": (0.0, 0.42, 1), "collar": (0.0, 0.925, -1)}
TOP_PINS: Pins = {
    **_ON_SLEEVE,
    **_ON_BODY,
    "{}_shoulder": (0.91, 0.93, 1),
    "{}_upper_chest": (0.70, 0.82, 1),
    "{}_hem": (0.76, 0.11, 1),
}
"""Canonical (|u|, v, side) of landmarks of long-sleeved tops, after the demonstration points of the
paper's fold, fling and hang tasks."""
SLEEVELESS_PINS: Pins = {
    **_ON_BODY,
    "{}_shoulder": (0.71, 0.955, 1),
    "{}_upper_chest": (0.70, 0.70, 1),
    "{}_hem": (0.88, 0.07, 1),
}
"""Landmarks of sleeveless tops, after the paper's store task."""
FRONT_OPEN_PINS: Pins = {
    **_ON_SLEEVE,
    "{}_shoulder": (0.91, 0.93, 1),
    "{}_lapel": (0.56, 0.945, 1),
    "{}_upper_chest": (0.70, 0.82, 1),
    "{}_front": (0.28, 0.40, 1),
    "{}_hem": (0.80, 0.10, 1),
    "centre": (0.0, 0.42, -1),
    "collar": (0.0, 0.925, -1),
}
"""Landmarks of open fronts, after the paper's task of hanging a coat."""
_OPEN_NECK_DIP = (0.30, 0.035)  # necklines of open fronts fall deeper


def cut_top(parameters: TopParameters) -> Cuts:
    """Compose a long-sleeved top of its parts."""
    return Cuts(body=parameters.body, neck=parameters.neck, sleeve=parameters.sleeve)


def cut_sleeveless(parameters: SleevelessParameters) -> Cuts:
    """Compose a sleeveless top of its parts."""
    return Cuts(body=parameters.body, neck=parameters.neck, armhole=parameters.armhole)


def cut_front_open(parameters: FrontOpenParameters) -> Cuts:
    """Compose a top with an open front of its parts."""
    return Cuts(
        body=parameters.body,
        neck=parameters.neck,
        sleeve=parameters.sleeve,
        opening=parameters.opening,
        neck_dip=_OPEN_NECK_DIP,
    )


def make_top(
    parameters: TopParameters,
    *,
    spacing: float | None = None,
    layer_gap: float = 0.012,
    name: str = "top",
) -> Garment:
    """Make a long-sleeved top.

    Args:
        parameters: Measures.
        spacing: Target edge length [m], 0.006 to 0.025; None for 13 mm, adapted to the size.
        layer_gap: Distance of the two layers while it lies flat [m], 0 to 0.03; 0 at the seams.
        name: Name of the garment.

    Returns:
        One welded surface with four openings: neck, hem and both cuffs.

    Raises:
        ValueError: If the measures contradict each other, or spacing or gap are out of range.
        MeshingError: If a panel cannot be filled at this spacing.
    """
    pattern = cut_upper(cut_top(parameters), TOP_PINS)
    return assemble(pattern, LONG_SLEEVE, parameters, name, spacing, layer_gap)


def make_sleeveless_top(
    parameters: SleevelessParameters,
    *,
    spacing: float | None = None,
    layer_gap: float = 0.012,
    name: str = "sleeveless top",
) -> Garment:
    """Make a sleeveless top, open at neck, hem and armholes; arguments as for `make_top`."""
    pattern = cut_upper(cut_sleeveless(parameters), SLEEVELESS_PINS)
    return assemble(pattern, NO_SLEEVE, parameters, name, spacing, layer_gap)


def make_front_open_top(
    parameters: FrontOpenParameters,
    *,
    spacing: float | None = None,
    layer_gap: float = 0.012,
    name: str = "coat",
) -> Garment:
    """Make a coat, jacket or cardigan; arguments as for `make_top`.

    Its three openings are both cuffs, and one along hem, fronts and neck. Where the fronts overlap,
    the right one lies higher by `layer_gap`.
    """
    pattern = cut_upper(cut_front_open(parameters), FRONT_OPEN_PINS)
    return assemble(pattern, FRONT_OPEN, parameters, name, spacing, layer_gap)
