"""Tops: categories, and places of landmarks.

Landmarks are exact correspondences. All tops have, with `left_` or `right_`, `shoulder` (inside the
shoulder point, or in the middle of a strap), `upper_chest`, `hem` (inside the hem corner), the
corners `armpit`, `hem_corner` and `neck_side` (highest point of the shoulder); `centre`,
`hem_centre`, and `collar`, on the back layer below the neckline. Sleeves add `cuff` (inside the
cuff, upper layer), `cuff_upper`, `cuff_lower` and `sleeve_joint` (upper sleeve, just outside the
armhole). Open fronts add `lapel` (on the front, beside the neck), `front` (beside the opening),
`opening_top` and `opening_hem`; their `centre` and `hem_centre` are on the back.
"""

from __future__ import annotations

from dgl_assets.garments.uppers.cutting import Pins
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
