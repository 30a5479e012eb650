"""The neckline, and the collar or hood above it, on the side +x."""

from __future__ import annotations

import numpy as np

from dgl_assets.garments.uppers.parameters import Neck

U_NECK = 0.42
"""|u| of the highest point of the shoulder, and of the sides of collars and hoods."""
V_COLLAR = 0.12
"""Excess of v over 1 at the sides of a collar."""
V_HOOD = 0.5
"""Excess of v over 1 at the top of a hood."""

_OPENING_DIP = {1: 0.05, -1: 0.012}  # fall of a collar's upper edge in v
# A collar that lies flat still shows its back through the opening [m].
_COLLAR_OPENING = {1: 0.028, -1: 0.006}
_BULGE = 0.35  # share of a hood's height by which it has reached its width
_DOME = 0.55  # share of a hood's height where its top begins to round
_FACE_RIM = 0.055  # width of a hood's front edge at its top [m]
_SAMPLES = 400


class Neckline:
    """Curves of the neckline, and of the collar or hood above it.

    Heights are functions of x', which is x over the width of collar or hood at that height relative
    to the neck, so that all of it lies within |x'| <= half_width.

    Args:
        neck: Measures.
        dip: Fall of the neckline at the centre in v: front (1) and back (-1).
        start: x of the edge of an open front at the neck [m], where v of the front has fallen by
            its dip; 0 if closed.
    """

    def __init__(self, neck: Neck, *, dip: dict[int, float], start: float = 0.0) -> None:
        self.neck = neck
        self._dip = dip
        self._start = {1: start, -1: 0.0}

    def has_collar(self, layer: int) -> bool:
        """Tell if body panels of a layer continue above the neckline."""
        finish = self.neck.finish
        return finish == "stand" or (layer < 0 and finish != "plain")

    def evaluate(self, x: np.ndarray, *, layer: int) -> np.ndarray:
        """Height of the neckline at x' [m]."""
        depth, power = (
            (self.neck.front_depth, self.neck.roundness)
            if layer > 0
            else (self.neck.back_depth, 2.0)
        )
        return -depth * (1 - self._share(x) ** power)

    def evaluate_v(self, x: np.ndarray, *, layer: int) -> np.ndarray:
        """Value of v on the neckline at x'."""
        return 1 - self._dip[layer] * (1 - self._share(x, layer) ** 2)

    def evaluate_edge(self, x: np.ndarray, *, layer: int) -> np.ndarray:
        """Height of the upper edge of collar or hood at x' [m]."""
        share, height = self._share(x), self.neck.height
        if self.neck.finish == "hood":
            return height * (_DOME + (1 - _DOME) * (1 - share**2.4) ** 0.5)
        opening = min(_COLLAR_OPENING[layer], 0.8 * height)
        if self.neck.finish != "stand":  # the fold of the leaf rises behind the neck
            return height + 0.25 * height * (1 - share**2)
        return height - opening * (1 - share**2)

    def evaluate_edge_v(self, x: np.ndarray, *, layer: int) -> np.ndarray:
        """Value of v on the upper edge of collar or hood at x'."""
        if self.neck.finish == "hood":
            return np.full(len(x), 1 + V_HOOD)
        return 1 + V_COLLAR - _OPENING_DIP[layer] * (1 - self._share(x, layer) ** 2)

    def scale(self, y: np.ndarray) -> np.ndarray:
        """Ratio of x to x' at height y; 1 below the neck."""
        neck = self.neck
        if neck.height == 0:
            return np.ones(len(y))
        if neck.finish == "hood":
            share = np.clip(y / (_BULGE * neck.height), 0.0, 1.0)
            share = share * share * (3 - 2 * share)
        else:
            share = np.clip(y / neck.height, 0.0, 1.0)
        return 1 + neck.spread / neck.half_width * share

    def cut(self, layer: int, *, x_end: float = 0.0) -> np.ndarray:
        """Neckline from its side to `x_end` [m], shape (N, 2)."""
        # Denser towards the side, where square necklines turn.
        share = 1 - np.linspace(0.0, 1.0, 2 * _SAMPLES) ** 2
        x = x_end + (self.neck.half_width - x_end) * share
        return np.stack([x, self.evaluate(x, layer=layer)], axis=1)

    def cut_edge(self, layer: int, *, x_end: float = 0.0) -> np.ndarray:
        """Upper edge of collar or hood from its side to `x_end` [m], shape (N, 2)."""
        x = x_end + (self.neck.half_width - x_end) * np.sin(np.linspace(np.pi / 2, 0.0, _SAMPLES))
        y = self.evaluate_edge(x, layer=layer)
        return np.stack([x * self.scale(y), y], axis=1)

    def cut_side(self) -> np.ndarray:
        """Side seam of collar or hood from the neck upward [m], shape (N, 2)."""
        top = self.evaluate_edge(np.array([self.neck.half_width]), layer=-1)[0]
        y = np.linspace(0.0, top, _SAMPLES)
        return np.stack([self.neck.half_width * self.scale(y), y], axis=1)

    def cut_face(self, start: np.ndarray) -> np.ndarray:
        """Half of a hood's face opening, from the front neckline to the top [m], shape (N, 2)."""
        neck = self.neck
        width = neck.half_width + neck.spread - 0.05
        top = neck.height - _FACE_RIM
        knots = np.array(
            [start, [width, start[1] + 0.35 * (top - start[1])], [width, top], [0, top]]
        )
        t = np.linspace(0.0, 1.0, _SAMPLES)[:, None]
        weights = np.hstack([(1 - t) ** 3, 3 * t * (1 - t) ** 2, 3 * t**2 * (1 - t), t**3])
        return weights @ knots

    def _share(self, x: np.ndarray, layer: int = -1) -> np.ndarray:
        start = self._start[layer]
        return np.clip((x - start) / (self.neck.half_width - start), 0.0, 1.0)
