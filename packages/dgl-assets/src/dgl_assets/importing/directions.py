"""Directions of a garment that the names of its landmarks tell."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dgl_assets.importing.keypoints import Keypoints

_UPPER_PARTS, _LOWER_PARTS = ("neck", "collar", "waist", "shoulder"), ("hem", "crotch", "leg")
_HANDS = ("left_", "right_")
_AGREEING = 0.5  # length of the mean over the mean length of the differences of pairs
_PARALLEL = 0.8  # cosine above which "right" and "up" cannot both be right


@dataclass(frozen=True, kw_only=True, eq=False)
class Directions:
    """Unit vectors in the axes of the file; None where the names do not tell."""

    right: np.ndarray | None
    """From the wearer's left side to the right one, the garment's +x, shape (3,)."""
    up: np.ndarray | None
    """From hem or legs to neck or waist, the garment's +y, shape (3,)."""
    notes: tuple[str, ...]
    """Findings, and landmarks that were left out."""

    @property
    def axes(self) -> np.ndarray | None:
        """The garment's x, y, z as rows, shape (3, 3), if both directions are known."""
        if self.right is None or self.up is None:
            return None
        x = self.right - self.up * (self.right @ self.up)
        x /= np.linalg.norm(x)
        return np.stack([x, self.up, np.cross(x, self.up)])


def find_directions(points: Keypoints | None) -> Directions:
    """Find directions from names such as "left_cuff" and "right_cuff", "collar" and "hem".

    Args:
        points: Landmarks in the axes of the file, if there are any.

    Returns:
        The directions. Names that contradict each other tell nothing, and a note says so.
    """
    if points is None:
        return Directions(right=None, up=None, notes=())
    places = {n.lower(): p for n, p in zip(points.names, points.positions, strict=True)}
    notes: list[str] = []
    pairs = [name[5:] for name in places if name.startswith("left_")]
    pairs = [name for name in pairs if f"right_{name}" in places]
    right = None
    if pairs:
        steps = np.array([places[f"right_{name}"] - places[f"left_{name}"] for name in pairs])
        size = np.linalg.norm(steps.mean(axis=0))
        if size > _AGREEING * np.linalg.norm(steps, axis=1).mean():
            right = steps.mean(axis=0) / size
        else:
            notes.append("the landmarks of the left and right contradict each other, not used")
    up = None
    upper = _mean_of(places, _UPPER_PARTS)
    lower = _mean_of(places, _LOWER_PARTS)
    if upper is not None and lower is not None and np.linalg.norm(upper - lower) > 0:
        up = (upper - lower) / np.linalg.norm(upper - lower)
    if right is not None and up is not None and abs(right @ up) > _PARALLEL:
        notes.append("the landmarks say that up is sideways, not used")
        right = up = None
    return Directions(right=right, up=up, notes=tuple(notes))


def _mean_of(places: dict[str, np.ndarray], parts: tuple[str, ...]) -> np.ndarray | None:
    """Middle of the points of some parts, each side counted alike."""
    found: dict[str, list[np.ndarray]] = {}
    for name, place in places.items():
        side = next((hand for hand in _HANDS if name.startswith(hand)), "")
        part = name.removeprefix(side)
        if any(part == word or part.startswith(f"{word}_") for word in parts):
            found.setdefault(side, []).append(place)
    sides = {side: np.mean(group, axis=0) for side, group in found.items()}
    if all(hand in sides for hand in _HANDS):
        return (sides["left_"] + sides["right_"]) / 2
    return sides.get("")
