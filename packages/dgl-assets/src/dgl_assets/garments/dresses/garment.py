"""Dresses: category, and places of landmarks.

Landmarks are those of long-sleeved tops and, with `left_` or `right_`, `waist` (at the side of the
waist), `side` (on the skirt, where a long dress is folded) and `skirt` (further out on the skirt).
"""

from __future__ import annotations

from dgl_assets.garments.tops.garment import V_CUFF
from dgl_assets.garments.uppers.cutting import Pins
from dgl_assets.garments.uppers.half import V_WAIST

CATEGORY = "Dress_LongSleeve"

DRESS_PINS: Pins = {
    "{}_cuff": (1.90, V_CUFF, 1),
    "{}_sleeve_joint": (1.11, 0.85, 1),
    "{}_shoulder": (0.90, 0.92, 1),
    "{}_upper_chest": (0.70, 0.82, 1),
    "{}_waist": (0.86, V_WAIST, 1),
    "{}_side": (0.68, 0.21, 1),
    "{}_skirt": (0.86, 0.20, 1),
    "{}_hem": (0.80, 0.05, 1),
    "centre": (0.0, 0.42, 1),
    "collar": (0.0, 0.925, -1),
}
"""Canonical (|u|, v, side) of landmarks, after the demonstration points of the paper's tasks."""
