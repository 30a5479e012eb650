"""The pattern of trousers: its curves, and its canonical coordinates.

Pattern frame: metres, x across with 0 at the centre, y up with 0 at the sides of the waistband,
"left" is -x. Curves are built for the side +x and mirrored.

Canonical coordinates (u, v) on one layer: v is 0 at the hems, `V_CROTCH` at the crotch, 1 at the
waistband; |u| is 1 on the outer seam, 0 on the centre seam, and on the inner seam it grows from 0
at the crotch to `U_INSEAM` at the hem, so that the legs are apart.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.interpolate import PchipInterpolator

from dgl_assets.garments.shear import Knots, ShearMap, tabulate_edge
from dgl_assets.garments.trousers.parameters import TrousersParameters

V_CROTCH = 0.62
U_INSEAM = 0.25

_SAMPLES = 400
_LEG_SHARES = (0.5, 0.9, 1.0)  # of the inseam: knee, ankle, hem
_CLEARANCE = 0.006  # least distance of an inner seam from the centre below the crotch [m]


class LegPattern:
    """One half of a pair of trousers, on the side +x.

    Args:
        parameters: Measures.
        angle: Outward direction of this leg [rad].

    Raises:
        ValueError: If the measures contradict each other.

    Attributes:
        outseam: Hem to waistband [m], shape (N, 2).
        inseam: Hem to crotch [m], shape (N, 2).
        hem: Inner to outer corner [m], shape (2, 2).
        crotch: Lowest point of the centre seam [m], shape (2,).
    """

    def __init__(self, parameters: TrousersParameters, *, angle: float) -> None:
        p = self._p = parameters
        self.crotch = np.array([0.0, -p.rise])
        self.inseam, self.outseam = self._cut_leg(angle)
        self.hem = np.stack([self.inseam[0], self.outseam[0]])
        slope = np.diff(self.hem, axis=0)[0]
        self._hem_slope = float(slope[1] / slope[0])
        if self._evaluate_hem(self.outseam[:, 0]).max() > -p.rise - 0.015:
            raise ValueError(
                f"the hem reaches the crotch: inseam_length {p.inseam_length} is too short for "
                f"leg_angle {angle:.3f} and hem_width {p.hem_width}"
            )
        self._maps = {layer: self._map(layer) for layer in (1, -1)}

    def cut_waist(self, layer: int) -> np.ndarray:
        """Half of the waistband from the side to the centre [m], shape (N, 2)."""
        x = np.linspace(self._p.waist_half_width, 0.0, _SAMPLES)
        return np.stack([x, self._evaluate_waist(x, layer=layer)], axis=1)

    def get_map(self, layer: int) -> ShearMap:
        """Canonical map of one layer of this half."""
        return self._maps[layer]

    def _cut_leg(self, angle: float) -> tuple[np.ndarray, np.ndarray]:
        p = self._p
        along = np.array([math.sin(angle), -math.cos(angle)])
        across = np.array([math.cos(angle), math.sin(angle)])
        root = np.array([p.thigh_width / 2, -p.rise])
        inner, outer = [self.crotch], [np.array([p.thigh_width, -p.rise])]
        widths = (p.knee_width, p.ankle_width, p.hem_width)
        for share, width in zip(_LEG_SHARES, widths, strict=True):
            middle = root + share * p.inseam_length * along
            inner.append(middle - width / 2 * across)
            outer.append(middle + width / 2 * across)
        outer[-1] = outer[-1] - np.array([0.0, p.hem_slant])
        hip = np.array([p.hip_half_width, -0.6 * p.rise])
        outer = [np.array([p.waist_half_width, 0.0]), hip, *outer]
        inseam, outseam = (self._draw(knots) for knots in (inner, outer))
        if p.pocket_bulge > 0:
            low, high = -p.rise - 0.55 * p.inseam_length, -p.rise - 0.1 * p.inseam_length
            share = np.clip((outseam[:, 1] - low) / (high - low), 0.0, 1.0)
            outseam[:, 0] += p.pocket_bulge * np.sin(math.pi * share) ** 2
        below = inseam[:, 1] < -p.rise - 0.35 * p.inseam_length
        needed = _CLEARANCE * np.clip((-p.rise - inseam[:, 1]) / 0.05, 0.0, 1.0)
        if np.any(inseam[below, 0] < _CLEARANCE) or np.any(inseam[:-1, 0] < needed[:-1] - 1e-4):
            raise ValueError(
                f"the legs lie on each other: leg_angle {angle:.3f} is too small for knee_width "
                f"{p.knee_width}, ankle_width {p.ankle_width} and hem_width {p.hem_width}"
            )
        return inseam, outseam

    @staticmethod
    def _draw(knots: list[np.ndarray]) -> np.ndarray:
        """Smooth curve through knots that are given from the top, as points from the hem up."""
        x, y = np.array(knots[::-1]).T
        if np.any(np.diff(y) <= 0.004):
            raise ValueError("the seams of a leg fold over themselves: hem_slant is too large")
        heights = np.linspace(y[0], y[-1], _SAMPLES)
        return np.stack([PchipInterpolator(y, x)(heights), heights], axis=1)

    def _evaluate_waist(self, x: np.ndarray, *, layer: int) -> np.ndarray:
        p = self._p
        fall = 1 - np.minimum(np.abs(x) / p.waist_half_width, 1.0) ** 2
        return fall * (-p.waist_front_drop if layer > 0 else p.waist_back_rise)

    def _evaluate_hem(self, x: np.ndarray) -> np.ndarray:
        return self.hem[0, 1] + self._hem_slope * (x - self.hem[0, 0])

    def _map(self, layer: int) -> ShearMap:
        def columns(x: np.ndarray) -> Knots:
            level = np.full(len(x), -self._p.rise)
            heights = [self._evaluate_hem(x), level, self._evaluate_waist(x, layer=layer)]
            return np.stack(heights, axis=1), np.tile([0.0, V_CROTCH, 1.0], (len(x), 1))

        def compute_v(curve: np.ndarray) -> np.ndarray:
            knots, values = columns(curve[:, 0])
            return np.array(
                [np.interp(y, k, w) for y, k, w in zip(curve[:, 1], knots, values, strict=True)]
            )

        v_out, v_in = compute_v(self.outseam), compute_v(self.inseam)
        v_out[0], v_out[-1], v_in[0], v_in[-1] = 0.0, 1.0, 0.0, V_CROTCH
        outer = tabulate_edge(self.outseam, v_out, what="the outer seam")
        inner = tabulate_edge(self.inseam, v_in, what="the inner seam")

        def rows(v: np.ndarray) -> Knots:
            low = np.where(v < V_CROTCH, np.interp(v, *inner), 0.0)
            u_low = U_INSEAM * np.clip(1 - v / V_CROTCH, 0.0, 1.0)
            places = np.stack([low, np.interp(v, *outer)], axis=1)
            return places, np.stack([u_low, np.ones(len(v))], axis=1)

        return ShearMap(columns=columns, rows=rows)
