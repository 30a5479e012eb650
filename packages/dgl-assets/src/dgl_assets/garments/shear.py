"""Injective maps between a region of a pattern and canonical coordinates."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

Knots = tuple[np.ndarray, np.ndarray]


class ShearMap:
    """A shear along columns followed by a shear along rows, each strictly monotone.

    Such a map is injective whatever its curves are, and is inverted in closed form.

    Args:
        columns: From x [m], shape (N,), to heights y [m] and their v, both (N, K) and rising along
            K.
        rows: From v, shape (N,), to positions x [m] and their u, both (N, J) and rising along J.
    """

    def __init__(
        self, *, columns: Callable[[np.ndarray], Knots], rows: Callable[[np.ndarray], Knots]
    ) -> None:
        self._columns = columns
        self._rows = rows

    def compute_v(self, points: np.ndarray) -> np.ndarray:
        """Compute v of pattern points [m], shape (N, 2): shape (N,)."""
        return interpolate_rows(points[:, 1], *self._columns(points[:, 0]))

    def to_canonical(self, points: np.ndarray) -> np.ndarray:
        """Map pattern points [m], shape (N, 2), to (u, v), shape (N, 2)."""
        v = self.compute_v(points)
        return np.stack([interpolate_rows(points[:, 0], *self._rows(v)), v], axis=1)

    def to_pattern(self, canonical: np.ndarray) -> np.ndarray:
        """Map (u, v), shape (N, 2), to pattern points [m], shape (N, 2)."""
        places, values = self._rows(canonical[:, 1])
        x = interpolate_rows(canonical[:, 0], values, places)
        heights, levels = self._columns(x)
        return np.stack([x, interpolate_rows(canonical[:, 1], levels, heights)], axis=1)


def interpolate_rows(query: np.ndarray, knots: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Interpolate each query, shape (N,), along its own knots, shape (N, K), clamped to them."""
    segment = (query[:, None] > knots[:, 1:-1]).sum(axis=1)[:, None]
    start, end = (np.take_along_axis(knots, segment + k, axis=1)[:, 0] for k in (0, 1))
    low, high = (np.take_along_axis(values, segment + k, axis=1)[:, 0] for k in (0, 1))
    return low + np.clip((query - start) / (end - start), 0.0, 1.0) * (high - low)


def tabulate_edge(curve: np.ndarray, v: np.ndarray, *, what: str) -> Knots:
    """Tabulate (v, x) along an edge, for `numpy.interp`.

    Raises:
        ValueError: If v does not rise along the curve, so that the region `what` folds over itself.
    """
    if np.any(np.diff(v) <= 0):
        raise ValueError(f"{what} folds over itself: its measures do not go together")
    return v, curve[:, 0]
