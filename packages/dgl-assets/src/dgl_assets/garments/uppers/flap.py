"""A leaf of a collar, folded over the neckline onto the front."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np


class Flap:
    """A ruled strip along a hinge.

    Args:
        hinge: Neckline from the centre or the opening to the neck side [m], shape (N, 2), pattern frame.
        outer: Free edge of the leaf, as many points; each is joined to the hinge by a straight ruling.
        corners: Shares of the outer edge at which it has corners, each in (0, 1).
        get_span: Given shares along the hinge, shape (M,), returns u, shape (M,), and v at the hinge and at the free
            edge, each of shape (M,).

    Raises:
        ValueError: If the rulings cross, so that the leaf folds over itself.

    Attributes:
        outer: Free edge from the tip to the collar's side seam [m], shape (N, 2).
        corners: Shares of the outer edge at which it has corners.
    """

    def __init__(
        self,
        hinge: np.ndarray,
        outer: np.ndarray,
        *,
        corners: tuple[float, ...],
        get_span: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray, np.ndarray]],
    ) -> None:
        self._hinge, self.outer, self.corners = hinge, outer, corners
        self._share = np.linspace(0.0, 1.0, len(hinge))
        self._get_span = get_span
        rulings, step = outer - hinge, np.diff(hinge, axis=0)
        at_hinge = _cross(step, rulings[:-1])
        at_edge = _cross(np.diff(outer, axis=0), rulings[:-1])
        is_wide = np.linalg.norm(rulings[:-1], axis=1) > 0.004
        if np.any(at_hinge[is_wide] >= 0) or np.any(at_edge[is_wide] >= 0):
            raise ValueError(
                "the leaf of the collar folds over itself: it is too wide for its neckline"
            )

    def to_canonical(self, points: np.ndarray) -> np.ndarray:
        """Map points of the leaf [m], shape (N, 2), to (u, v), shape (N, 2)."""
        low, high = np.zeros(len(points)), np.ones(len(points))
        for _ in range(45):  # the point passes from one side of the ruling to the other once
            middle = 0.5 * (low + high)
            start, end = self._ruling(middle)
            is_before = _cross(end - start, points - start) < 0
            high, low = np.where(is_before, middle, high), np.where(is_before, low, middle)
        share = 0.5 * (low + high)
        start, end = self._ruling(share)
        ruling = end - start
        length = np.maximum((ruling**2).sum(axis=1), 1e-12)
        across = np.clip(((points - start) * ruling).sum(axis=1) / length, 0.0, 1.0)
        u, v_hinge, v_edge = self._get_span(share)
        return np.stack([u, v_hinge + across * (v_edge - v_hinge)], axis=1)

    def _ruling(self, share: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        start, end = (
            np.stack([np.interp(share, self._share, curve[:, k]) for k in range(2)], axis=1)
            for curve in (self._hinge, self.outer)
        )
        return start, end


def _cross(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    return first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]
