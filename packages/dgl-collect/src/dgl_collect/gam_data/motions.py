"""Held landmarks of each category, and the paths along which they are carried."""

from dataclasses import dataclass

import numpy as np

__all__ = ["FOLDS", "PAIRS", "Fold", "make_arc", "make_fling"]

Pair = tuple[str, str]


@dataclass(frozen=True, kw_only=True)
class Fold:
    """A fold: part of a garment is carried over a line and laid on the rest."""

    state: str
    """Kind of the state."""
    grips: tuple[str, ...]
    """Landmarks that are held; {side} and {other} stand for left and right."""
    hinge: tuple[str, ...]
    """Landmarks whose middle lies on the line farthest from the grips."""
    nearest: float = 0.6
    """Least distance of the line from the grips, as a share of that to the hinge, in (0, 1]."""


_SLEEVE = Fold(state="sleeve_folded", grips=("{side}_cuff",), hinge=("{side}_sleeve_joint",))
FOLDS: dict[str, tuple[Fold, ...]] = {
    "Tops_LongSleeve": (_SLEEVE,),
    "Tops_FrontOpen": (_SLEEVE,),
    "Dress_LongSleeve": (_SLEEVE,),
    "Tops_NoSleeve": (
        Fold(
            state="side_folded",
            grips=("{side}_hem_corner", "{side}_shoulder"),
            hinge=("hem_centre", "centre"),
        ),
    ),
    "Trousers": (
        Fold(
            state="leg_folded",
            grips=("{side}_hem_outer", "{side}_waist"),
            hinge=("crotch", "waist_centre"),
            nearest=0.9,
        ),
        Fold(
            state="leg_folded",
            grips=("{side}_hem_outer", "{side}_hem_inner"),
            hinge=("{side}_hip",),
            nearest=0.4,
        ),
    ),
    "Scarf": (Fold(state="end_folded", grips=("{side}_end",), hinge=("centre",), nearest=0.4),),
}
"""Folds of each category of cloth; one of several is drawn."""

_UPPER: tuple[Pair, ...] = (
    ("left_shoulder", "right_shoulder"),
    ("left_hem_corner", "right_hem_corner"),
)
_SLEEVED: tuple[Pair, ...] = (*_UPPER, ("left_cuff", "right_cuff"))
PAIRS: dict[str, tuple[Pair, ...]] = {
    "Tops_LongSleeve": _SLEEVED,
    "Tops_FrontOpen": _SLEEVED,
    "Dress_LongSleeve": _UPPER,
    "Tops_NoSleeve": _UPPER,
    "Trousers": (
        ("left_waist_corner", "right_waist_corner"),
        ("left_hem_outer", "right_hem_outer"),
    ),
    "Scarf": (("left_end", "right_end"), ("left_quarter", "right_quarter")),
}
"""Pairs of landmarks for two hands; the first pair of a category is for flings."""


def make_arc(held: np.ndarray, hinge: np.ndarray, turn: float, *, speed: float) -> np.ndarray:
    """Make the path of grips over a line on the ground: half a circle each.

    Args:
        held: Middle of each grip [m], shape (G, 3).
        hinge: Point of the line [m], shape (3,).
        turn: Turn of the line about the hinge; at 0 it faces the middle of the grips [rad].
        speed: Speed of the fastest grip [m/s].

    Returns:
        Displacement since the start [m], shape (T, G, 3), one row for 1/60 s.
    """
    toward = (hinge - held.mean(axis=0))[:2]
    toward /= np.linalg.norm(toward)
    c, s = np.cos(turn), np.sin(turn)
    toward = np.array([c * toward[0] - s * toward[1], s * toward[0] + c * toward[1], 0.0])
    radius = np.maximum((hinge - held) @ toward, 0.0)  # a grip beyond the line stays
    frames = max(30, round(np.pi * radius.max() / speed * 60))
    part = np.linspace(0.0, 1.0, frames + 1)
    angle = np.pi * part**2 * (3 - 2 * part)
    way = np.zeros((frames + 1, len(held), 3))
    way += (radius * (1 - np.cos(angle))[:, None])[..., None] * toward
    # end on top of the lying part, not inside it
    way[..., 2] = 0.95 * radius * np.sin(angle)[:, None] + 0.03 * part[:, None]
    return way


def make_fling(height: float, length: float, *, forward: float) -> np.ndarray:
    """Make the path of hands that swing a garment forward and lay it down on the way back.

    Args:
        height: Height of the hands at the start [m].
        length: Length of the garment below the hands [m].
        forward: Distance of the swing [m].

    Returns:
        Displacement since the start [m], shape (T, 1, 3), towards +y and back.
    """
    corners = np.array([[0.0, 0.0, 0.0], [0.0, forward, 0.1], [0.0, -0.5 * length, 0.04 - height]])
    legs = []
    for start, end, frames in zip(corners[:-1], corners[1:], (30, 60), strict=True):
        part = np.linspace(0.0, 1.0, frames, endpoint=False)[:, None]
        legs.append(start + (end - start) * part**2 * (3 - 2 * part))
    return np.concatenate([*legs, corners[-1:]])[:, None]
