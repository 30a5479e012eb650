"""A leaf of a collar, folded over the neckline onto the front."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from dgl_assets.garments.uppers.neckline import Neckline

# (share along the hinge, share of `leaf_width`); the last one is added: the collar's side seam.
_LEAF = (0.0, 1.15), (0.25, 1.0), (0.7, 0.92)
_LAPEL = (0.0, 0.0), (0.06, 0.3), (0.56, 1.1), (0.62, 0.66), (0.68, 0.95), (0.85, 0.85)
_CORNERS = {"fold": (), "lapel": (0.56, 0.62, 0.68)}
_JOIN = 0.85  # share of the hinge from which the leaf passes into the side seam
_SAMPLES = 400


@dataclass(frozen=True, kw_only=True)
class Leaf:
    """The shape of a leaf on the side +x."""

    hinge: np.ndarray
    """Neckline from the centre or the opening to its side, evenly divided [m], shape (N, 2)."""
    outer: np.ndarray
    """Free edge from the tip to the collar's side seam [m], shape (N, 2); a straight ruling joins
    each point to the hinge."""
    reach: np.ndarray
    """Width relative to the widest point, 1 at the side seam, shape (N,)."""
    corners: tuple[float, ...]
    """Shares of the outer edge at which it has corners, each in (0, 1)."""

    @property
    def is_pointed(self) -> bool:
        """The leaf begins with an edge, not in a point on the neckline."""
        return bool(np.linalg.norm(self.outer[0] - self.hinge[0]) > 0.005)


def cut_leaf(neckline: Neckline, *, start: float) -> Leaf:
    """Cut a leaf along the front neckline from x' = `start` [m]."""
    neck, share = neckline.neck, np.linspace(0.0, 1.0, _SAMPLES)
    hinge = neckline.cut(1, x_end=start)[::-1]
    arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(hinge, axis=0), axis=1))])
    hinge = np.stack([np.interp(share * arc[-1], arc, hinge[:, k]) for k in range(2)], axis=1)
    side = neckline.cut_side()
    last = side[-1] - side[0]
    turn = math.atan2(last[1], last[0]) + neck.leaf_angle
    angle = share * turn - neck.leaf_angle
    places, widths = np.array(_LAPEL if neck.finish == "lapel" else _LEAF).T
    ends = float(np.linalg.norm(last)) / neck.leaf_width
    width = np.interp(share, np.append(places, 1.0), np.append(widths, ends))
    along = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    outer = hinge + neck.leaf_width * width[:, None] * along
    outer[-1] = side[-1]
    relative = width / widths.max()
    joins = np.clip((share - _JOIN) / (1 - _JOIN), 0.0, 1.0)
    reach = relative + (1 - relative) * joins
    return Leaf(hinge=hinge, outer=outer, reach=reach, corners=_CORNERS[neck.finish])


class Flap:
    """A leaf and its canonical map.

    v grows from the neckline by the width of the leaf, so that its corners are corners in (u, v)
    too.

    Args:
        leaf: Its shape.
        canonical: (u, v) along the hinge, shape (N, 2).
        v_edge: v that the widest leaf would reach, shape (N,).

    Raises:
        ValueError: If the rulings cross, so that the leaf folds over itself.
    """

    def __init__(self, leaf: Leaf, *, canonical: np.ndarray, v_edge: np.ndarray) -> None:
        self.leaf = leaf
        self._share = np.linspace(0.0, 1.0, len(leaf.hinge))
        self._u, self._v = canonical.T
        self._v_edge = self._v + (v_edge - self._v) * leaf.reach
        rulings = (leaf.outer - leaf.hinge)[:-1]
        is_wide = np.linalg.norm(rulings, axis=1) > 0.004
        for edge in (leaf.hinge, leaf.outer):
            if np.any(_cross(np.diff(edge, axis=0), rulings)[is_wide] >= 0):
                raise ValueError(
                    "the leaf of the collar folds over itself: it is too wide for its neckline"
                )

    def to_canonical(self, points: np.ndarray) -> np.ndarray:
        """Map points of the leaf [m], shape (N, 2), to (u, v), shape (N, 2)."""
        low, high = np.zeros(len(points)), np.ones(len(points))
        for _ in range(45):  # the point passes from one side of the ruling to the other once
            middle = 0.5 * (low + high)
            start, end = self._get_ruling(middle)
            is_before = _cross(end - start, points - start) < 0
            high, low = np.where(is_before, middle, high), np.where(is_before, low, middle)
        share = 0.5 * (low + high)
        start, end = self._get_ruling(share)
        ruling = end - start
        length = np.maximum((ruling**2).sum(axis=1), 1e-12)
        across = np.clip(((points - start) * ruling).sum(axis=1) / length, 0.0, 1.0)
        u, v, v_edge = (
            np.interp(share, self._share, values) for values in (self._u, self._v, self._v_edge)
        )
        return np.stack([u, v + across * (v_edge - v)], axis=1)

    def _get_ruling(self, share: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        start, end = (
            np.stack([np.interp(share, self._share, curve[:, k]) for k in range(2)], axis=1)
            for curve in (self.leaf.hinge, self.leaf.outer)
        )
        return start, end


def _cross(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    return first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]
