"""One sleeve: its outline and its canonical map."""

from __future__ import annotations

import math

import numpy as np
from scipy.interpolate import PchipInterpolator

from dgl_assets.garments.uppers.parameters import Body, Neck, Sleeve

V_ARMPIT = 0.6
"""v of the armpit and of the underarm seam."""

_SAMPLES = 400
_ROUNDING = {"set_in": 0.06, "raglan": 0.11}  # length of the round shoulder on either side [m]
_ARMHOLE_BOW = 0.06  # depth of the armhole curve, share of its length
_LEAST_UNDERARM = 0.035  # [m]
_STEEPEST_WIDTH = 1.8


def compute_armhole_width(body: Body, neck: Neck, *, sleeve_angle: float) -> float:
    """Compute the width of the sleeve where it leaves the armpit [m].

    It follows from shoulder, chest, armhole and the angle of the sleeve [rad], and bounds the
    sleeve's widths.
    """
    x = body.chest_half_width - body.shoulder_half_width
    drop = (body.shoulder_half_width - neck.half_width) * math.tan(body.shoulder_slope)
    return (body.armhole_depth - drop) * math.cos(sleeve_angle) - x * math.sin(sleeve_angle)


class SleevePattern:
    """One sleeve on the side +x.

    Canonical coordinates: u is 1 on the armhole and 2 at the cuff; v is `V_ARMPIT` on the underarm
    seam and 1 on the upper edge. On the armhole v is that of the body.

    Args:
        body: Measures of the body.
        neck: Measures of the neck.
        sleeve: Measures of the sleeve.
        angle: Fall of this sleeve below horizontal [rad].

    Raises:
        ValueError: If the widths of the sleeve contradict its armhole.

    Attributes:
        armhole: Shoulder to armpit [m], shape (N, 2), pattern frame: the border of its canonical
            map.
        shoulder_round: Rounded end of the shoulder line, shoulder point last [m], shape (N, 2).
        upper: Shoulder to cuff [m], shape (N, 2).
        underarm: Armpit to cuff [m], shape (N, 2).
        cuff: Upper to lower corner [m], shape (2, 2).
    """

    def __init__(self, body: Body, neck: Neck, sleeve: Sleeve, *, angle: float) -> None:
        self._sleeve = sleeve
        self._check_widths(body, neck, sleeve, angle=angle)
        self._along = np.array([math.cos(angle), -math.sin(angle)])
        self._across = np.array([-math.sin(angle), -math.cos(angle)])
        seam = body.shoulder_half_width - neck.half_width
        self._origin = np.array([body.shoulder_half_width, -seam * math.tan(body.shoulder_slope)])
        self._length = sleeve.length
        rounding = min(_ROUNDING[sleeve.seam], 0.45 * seam, 0.4 * sleeve.length)
        slope = np.array([math.cos(body.shoulder_slope), -math.sin(body.shoulder_slope)])
        t = np.linspace(0.0, 1.0, 41)[:, None]
        bezier = self._origin - (1 - t) ** 2 * rounding * slope + t**2 * rounding * self._along
        self.shoulder_round, sleeve_round = bezier[:21], bezier[20:]
        armpit = np.array([body.chest_half_width, -body.armhole_depth])

        # Upper edge and underside as functions of the distance along the sleeve, before bending.
        upper = self._project(sleeve_round)
        self._upper_a = np.append(upper[:, 0], sleeve.length)
        self._upper_c = np.append(upper[:, 1], 0.0)
        self._armpit_a, self._armpit_c = self._project(armpit[None])[0]
        underarm = sleeve.length - self._armpit_a
        if underarm < _LEAST_UNDERARM:
            raise ValueError(
                f"the underarm seam must be at least {_LEAST_UNDERARM} m; got {underarm:.3f} from "
                f"sleeve length {sleeve.length}, armhole_depth {body.armhole_depth} and angle "
                f"{angle:.3f}"
            )
        knots = self._armpit_a + underarm * np.array([0.0, 0.25, 0.8, 1.0])
        widths = [self._armpit_c, sleeve.upper_width, sleeve.lower_width, sleeve.cuff_width]
        slopes = np.abs(np.diff(widths) / np.diff(knots))[1:]
        if slopes.max() > _STEEPEST_WIDTH:
            raise ValueError(
                f"the width of a sleeve may change by at most {_STEEPEST_WIDTH} times the length "
                f"over which it does; got {slopes.max():.2f} from widths {widths[1:]} on "
                f"{underarm:.3f} m of underarm seam"
            )
        self._underside = PchipInterpolator(knots, widths)

        a = np.linspace(self._upper_a[0], sleeve.length, _SAMPLES)
        self.upper = self._from_local(a, self._evaluate_upper(a))
        self.upper[0] = bezier[20]
        a = np.linspace(self._armpit_a, sleeve.length, _SAMPLES)
        self.underarm = self._from_local(a, self._evaluate_lower(a))
        self.underarm[0] = armpit
        self.cuff = np.stack([self.upper[-1], self.underarm[-1]])
        self.armhole = self._bow(bezier[20], armpit)

        local = self._to_local(self.armhole)
        t = self._share_across(local[:, 0], local[:, 1])
        t[0], t[-1] = 0.0, 1.0
        if np.any(np.diff(t) <= 0):
            raise ValueError(
                f"the armhole folds over itself: armhole_depth {body.armhole_depth} and sleeve "
                f"angle {angle:.3f} do not go together"
            )
        self._armhole_t, self._armhole_a = t, local[:, 0]
        self._armhole_v = np.linspace(1.0, V_ARMPIT, _SAMPLES)

    def join_body(self, armhole_v: np.ndarray) -> None:
        """Take over the body's v along the armhole, shape (N,), so that both maps agree there."""
        self._armhole_v = armhole_v

    def contains(self, points: np.ndarray) -> np.ndarray:
        """Find the points [m], shape (N, 2), on the sleeve's side of the armhole, shape (N,)."""
        local = self._to_local(points)
        t = self._share_across(local[:, 0], local[:, 1])
        start = np.interp(np.clip(t, 0, 1), self._armhole_t, self._armhole_a)
        return local[:, 0] > start

    def to_canonical(self, points: np.ndarray) -> np.ndarray:
        """Map points of the sleeve [m], shape (N, 2), to (u, v), shape (N, 2), u in [1, 2]."""
        local = self._to_local(points)
        t = np.clip(self._share_across(local[:, 0], local[:, 1]), 0.0, 1.0)
        start = np.interp(t, self._armhole_t, self._armhole_a)
        s = np.clip((local[:, 0] - start) / (self._length - start), 0.0, 1.0)
        return np.stack([1.0 + s, self._blend_v(s, t)], axis=1)

    def to_pattern(self, canonical: np.ndarray) -> np.ndarray:
        """Map (u, v), shape (N, 2), u in [1, 2], to pattern points [m], shape (N, 2)."""
        s, v = canonical[:, 0] - 1.0, canonical[:, 1]
        low, high = np.zeros(len(s)), np.ones(len(s))
        for _ in range(50):  # v falls strictly with t
            t = 0.5 * (low + high)
            above = self._blend_v(s, t) > v
            low, high = np.where(above, t, low), np.where(above, high, t)
        t = 0.5 * (low + high)
        start = np.interp(t, self._armhole_t, self._armhole_a)
        a = start + s * (self._length - start)
        upper, lower = self._evaluate_upper(a), self._evaluate_lower(a)
        return self._from_local(a, upper + t * (lower - upper))

    def _blend_v(self, s: np.ndarray, t: np.ndarray) -> np.ndarray:
        at_armhole = np.interp(t, self._armhole_t, self._armhole_v)
        return (1 - s) * at_armhole + s * (1 - (1 - V_ARMPIT) * t)

    def _share_across(self, a: np.ndarray, c: np.ndarray) -> np.ndarray:
        upper, lower = self._evaluate_upper(a), self._evaluate_lower(a)
        return (c - upper) / (lower - upper)

    def _evaluate_upper(self, a: np.ndarray) -> np.ndarray:
        return np.interp(a, self._upper_a, self._upper_c)

    def _evaluate_lower(self, a: np.ndarray) -> np.ndarray:
        within = np.clip(a, self._armpit_a, self._length)
        return np.where(a < self._armpit_a, self._armpit_c, self._underside(within))

    def _bend_at(self, a: np.ndarray) -> np.ndarray:
        share = np.clip((a - self._armpit_a) / (self._length - self._armpit_a), 0.0, 1.0)
        return self._sleeve.bend * np.sin(math.pi * share) ** 2

    def _project(self, points: np.ndarray) -> np.ndarray:
        offset = points - self._origin
        return np.stack([offset @ self._along, offset @ self._across], axis=1)

    def _to_local(self, points: np.ndarray) -> np.ndarray:
        local = self._project(points)
        local[:, 1] += self._bend_at(local[:, 0])
        return local

    def _from_local(self, a: np.ndarray, c: np.ndarray) -> np.ndarray:
        c = c - self._bend_at(a)
        return self._origin + a[:, None] * self._along + c[:, None] * self._across

    @staticmethod
    def _bow(shoulder: np.ndarray, armpit: np.ndarray) -> np.ndarray:
        share = np.linspace(0.0, 1.0, _SAMPLES)
        chord = armpit - shoulder
        inward = np.array([chord[1], -chord[0]])  # towards the body
        depth = _ARMHOLE_BOW * 4 * share * (1 - share)
        return shoulder + share[:, None] * chord + depth[:, None] * inward

    @staticmethod
    def _check_widths(body: Body, neck: Neck, sleeve: Sleeve, *, angle: float) -> None:
        if angle < body.shoulder_slope:
            raise ValueError(
                f"sleeves must fall at least as steeply as the shoulder (shoulder_slope "
                f"{body.shoulder_slope}); got angle {angle:.3f}"
            )
        width = compute_armhole_width(body, neck, sleeve_angle=angle)
        low, high = 0.6 * width, 1.3 * width
        if not low <= sleeve.upper_width <= high:
            raise ValueError(
                f"upper_width of the sleeve must be in [{low:.3f}, {high:.3f}], 0.6 to 1.3 times "
                f"the armhole width of the other measures; got {sleeve.upper_width}"
            )
