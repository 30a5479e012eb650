"""The flat pattern of a glove and its map to canonical coordinates.

Pattern frame: fingers towards -y, thumb towards +x (a right hand seen from its back), the middle of
the knuckles at the origin. The palm with the cuff is ruled by lines from its little-finger side to
its thumb side; each digit is ruled across its axis and closed by half an ellipse.

Canonical coordinates: u runs across the hand, -1 at the little-finger side to 1 at the thumb side;
v is 0 at the knuckles, 1 at the wrist, 2 at the opening. A finger continues below the knuckles to v
= -1.3 at its tip, a little narrower towards it; the thumb continues to u = 2.38 from the side
between v = 0.33 and 0.76.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import PchipInterpolator

from dgl_assets.garments.gloves.parameters import GloveParameters

FINGERS = ("index", "middle", "ring", "little")
DIGITS = ("thumb", *FINGERS)
KNOTS = np.array([-1.0, -0.53, -0.47, -0.03, 0.03, 0.47, 0.53, 1.0])
"""Canonical u of fingers and webs at the knuckles, from the little finger on."""
V_THUMB = (0.33, 0.76)
"""v of the thumb's base, on the side of the index finger and on that of the wrist."""
V_WEB = 0.25
"""v of the beginning of the web between index finger and thumb."""
V_WRIST = (0.85, 1.15)
"""v of the ends of the wrist, between hand and cuff."""

_BULGE = 0.08  # canonical: bulge of the corner between web and thumb
_CAP = 0.3  # canonical length of the rounded tip
_CANONICAL_TAPER = 0.2
_FLARE = {"finger": 6, "thumb": 1}  # powers of the transition from hand to digit
_BISECTIONS = 45
_ARC_SAMPLES = 20


@dataclass(frozen=True, kw_only=True)
class Digit:
    """A finger or thumb: sections across an axis, and half an ellipse at the tip."""

    base: np.ndarray
    """Middle of its first section [m], shape (2,)."""
    axis: np.ndarray
    """Unit direction to the tip, shape (2,)."""
    length: float
    """First to last straight section [m]."""
    half_base: np.ndarray
    """Middle of the first section to its end at x = 1 [m], shape (2,)."""
    half_tip: np.ndarray
    """Middle of the last straight section to its end at x = 1, across the axis [m], shape (2,)."""
    cap: float
    """Last straight section to the tip [m]."""
    flare: int
    """Power of the transition from the first section to the last."""

    def place(self, t: np.ndarray, x: np.ndarray) -> np.ndarray:
        """Points [m], shape (N, 2), at t from 0 (base) to 1.3 (tip) and x across in [-1, 1]."""
        straight = np.clip(t, 0.0, 1.0)
        along = self.length * straight + self.cap * np.clip((t - 1) / _CAP, 0.0, 1.0)
        half = self._compute_half(straight)
        return self.base + along[:, None] * self.axis + x[:, None] * half

    def find(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Invert `place` on points [m], shape (N, 2)."""
        offset = points - self.base
        beyond = offset @ self.axis - self.length
        low, high = np.zeros(len(points)), np.ones(len(points))
        for _ in range(_BISECTIONS):
            t = (low + high) / 2
            half = self._compute_half(t)
            rest = offset - self.length * t[:, None] * self.axis
            side = rest @ self.axis - (rest * half).sum(axis=1) / (half**2).sum(axis=1) * (
                half @ self.axis
            )
            low, high = np.where(side > 0, t, low), np.where(side > 0, high, t)
        t = np.where(beyond > 0, 1.0, (low + high) / 2)
        half = self._compute_half(t)
        rest = offset - (offset @ self.axis)[:, None] * self.axis
        across = half - (half @ self.axis)[:, None] * self.axis
        x = (rest * across).sum(axis=1) / (across**2).sum(axis=1)
        t = np.where(beyond > 0, 1 + _CAP * np.clip(beyond / self.cap, 0, 1), t)
        return t, x

    def _compute_half(self, t: np.ndarray) -> np.ndarray:
        """Half sections [m], shape (N, 2): they flare where the digit leaves the hand."""
        flare = ((1 - t) ** self.flare)[:, None]
        return flare * self.half_base + (1 - flare) * self.half_tip

    def outline(self, sign: int) -> np.ndarray:
        """Edge from the base to the tip on the side x = sign [m], shape (N, 2)."""
        turn = np.linspace(0, np.pi / 2, _ARC_SAMPLES)
        flare = np.linspace(0, 1, _ARC_SAMPLES)[:-1] ** 2
        t = np.concatenate([flare, 1 + _CAP * np.sin(turn)])
        x = sign * np.concatenate([np.ones(len(flare)), np.cos(turn)])
        return self.place(t, x)


class GlovePattern:
    """Curves of the pattern, and its map to canonical coordinates."""

    def __init__(self, parameters: GloveParameters) -> None:
        self._p = parameters
        p = parameters
        finger = (p.hand_width - 3 * p.web_width) / (3 + p.little_width_ratio)
        widths = [finger * p.little_width_ratio, p.web_width, *(2 * [finger, p.web_width]), finger]
        self._knuckles = np.concatenate([[0.0], np.cumsum(widths)]) / p.hand_width
        slant = np.array([1.0, -np.tan(p.knuckle_slant)])
        half = p.hand_width / 2
        left, right = -half * slant, half * slant
        self._make_sides(left, right)
        self.digits = {"thumb": self._make_thumb()}
        for k, finger in enumerate(FINGERS):
            place = KNOTS[[7 - 2 * k, 6 - 2 * k]]  # its ends in u, thumb side first
            first, second = self.to_pattern_palm(np.column_stack([place, np.zeros(2)]))
            self.digits[finger] = self._make_finger(k, first, second)

    def _make_sides(self, left: np.ndarray, right: np.ndarray) -> None:
        p = self._p
        wrist = p.wrist_ratio * p.hand_width / 2
        cuff = wrist * p.cuff_ratio
        top = p.palm_length + p.cuff_length
        v = np.array([0.0, 0.45, 1.0, 1.5, 2.0])
        x = [left[0], 1.02 * left[0], -wrist, -(wrist + cuff) / 2, -cuff]
        y = [
            left[1],
            0.45 * p.palm_length + 0.5 * left[1],
            p.palm_length,
            p.palm_length + p.cuff_length / 2,
            top,
        ]
        self._left = PchipInterpolator(v, np.column_stack([x, y]))
        low, high = V_THUMB
        side = np.array([right[0] + 0.001, right[1] * 0.6 + V_WEB * p.palm_length])
        crotch = side + p.web_width * np.array([1.2, 0.25])
        heel = np.array([0.45 * right[0] + 0.55 * wrist + 0.003, high * p.palm_length])
        self._right_knots = np.array([0.0, V_WEB, low, high])
        self._right_points = np.stack([right, side, crotch, heel])
        x = [heel[0], wrist, (wrist + cuff) / 2, cuff]
        y = [heel[1], p.palm_length, p.palm_length + p.cuff_length / 2, top]
        self._right_upper = PchipInterpolator([high, 1.0, 1.5, 2.0], np.column_stack([x, y]))

    def side(self, v: np.ndarray, sign: int) -> np.ndarray:
        """Edge of palm and cuff [m], shape (N, 2); sign 1 is the thumb's side."""
        v = np.asarray(v, dtype=np.float64)
        if sign < 0:
            return self._left(v)
        lower = np.stack(
            [np.interp(v, self._right_knots, self._right_points[:, k]) for k in range(2)], axis=-1
        )
        upper = self._right_upper(np.maximum(v, V_THUMB[1]))
        return np.where((v > V_THUMB[1])[..., None], upper, lower)

    def to_pattern_palm(self, places: np.ndarray) -> np.ndarray:
        """Points of palm and cuff [m], shape (N, 2), at (u, v), shape (N, 2)."""
        u, v = places.T
        share = np.interp(u / _compute_bulge(u, v), KNOTS, self._knuckles)
        left, right = self.side(v, -1), self.side(v, 1)
        return left + share[:, None] * (right - left)

    def to_canonical(self, points: np.ndarray, part: str) -> np.ndarray:
        """(u, v), shape (N, 2), of points [m], shape (N, 2), of the palm or of a digit."""
        if part == "palm":
            return self._to_canonical_palm(points)
        t, x = self.digits[part].find(points)
        narrow = 1 - _CANONICAL_TAPER * np.minimum(t, 1.0)
        if part == "thumb":
            middle, half = sum(V_THUMB) / 2, (V_THUMB[1] - V_THUMB[0]) / 2
            bulge = _BULGE * (1 + x) / 2
            return np.column_stack([1 + bulge + t, middle - half * x * narrow])
        k = FINGERS.index(part)
        low, high = KNOTS[6 - 2 * k], KNOTS[7 - 2 * k]
        return np.column_stack([(low + high) / 2 + (high - low) / 2 * x * narrow, -t])

    def _to_canonical_palm(self, points: np.ndarray) -> np.ndarray:
        low, high = np.zeros(len(points)), np.full(len(points), 2.0)
        for _ in range(_BISECTIONS):
            v = (low + high) / 2
            left = self.side(v, -1)
            along, offset = self.side(v, 1) - left, points - left
            is_above = along[:, 0] * offset[:, 1] - along[:, 1] * offset[:, 0] > 0
            low, high = np.where(is_above, v, low), np.where(is_above, high, v)
        v = (low + high) / 2
        left = self.side(v, -1)
        along = self.side(v, 1) - left
        share = ((points - left) * along).sum(axis=1) / (along**2).sum(axis=1)
        u = np.interp(share, self._knuckles, KNOTS)
        return np.column_stack([u * _compute_bulge(u, v), v])

    def _make_finger(self, k: int, first: np.ndarray, second: np.ndarray) -> Digit:
        p = self._p
        turn = p.finger_spread * (1.5 - k)
        axis = np.array([np.sin(turn), -np.cos(turn)])
        half_base = (first - second) / 2
        half_tip = np.linalg.norm(half_base) * p.finger_taper * np.array([-axis[1], axis[0]])
        ratio = (p.index_ratio, 1.0, p.ring_ratio, p.little_ratio)[k]
        cap = 1.1 * float(np.linalg.norm(half_tip))
        return Digit(
            base=(first + second) / 2,
            axis=axis,
            length=p.middle_length * ratio - cap,
            half_base=half_base,
            half_tip=half_tip,
            cap=cap,
            flare=_FLARE["finger"],
        )

    def _make_thumb(self) -> Digit:
        p = self._p
        crotch, heel = self.side(np.array(V_THUMB), 1)
        axis = np.array([np.sin(p.thumb_angle), -np.cos(p.thumb_angle)])
        half_tip = p.thumb_width / 2 * np.array([axis[1], -axis[0]])
        cap = 1.1 * float(np.linalg.norm(half_tip))
        return Digit(
            base=(crotch + heel) / 2,
            axis=axis,
            length=p.thumb_length - cap,
            half_base=(crotch - heel) / 2,
            half_tip=half_tip,
            cap=cap,
            flare=_FLARE["thumb"],
        )


def _compute_bulge(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Factor of u on the thumb's half of the palm, beside the web of index finger and thumb."""
    rise = np.interp(v, [V_WEB, *V_THUMB], [0.0, 1.0, 0.0])
    return np.where(u > 0, 1 + _BULGE * rise, 1.0)
