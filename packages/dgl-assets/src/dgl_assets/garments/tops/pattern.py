"""The pattern of a long-sleeved top: its curves, and its canonical coordinates.

Pattern frame: metres, x across with 0 at the centre, y up with 0 at the highest point of the shoulder, seen from above
while the top lies on its back; "left" is -x. Curves are built for the side +x and mirrored.

Canonical coordinates (u, v) name a tailoring place on one layer of any long-sleeved top:

* body, |u| <= 1: u is 0 at the centre and +-1 on side seam and armhole; v is 0 at the hem, `V_ARMPIT` at the armpit, 1
  on the shoulder seam, which meets the neckline at |u| = `U_NECK`; the neckline dips to v = 1 - `NECK_DIP` at u = 0.
* collar, |u| <= `U_NECK`: above the neckline, up to v = 1 + `V_COLLAR` at the sides. Most tops have none.
* sleeves, 1 <= |u| <= 2: u is +-1 on the armhole and +-2 at the cuff; v is `V_ARMPIT` on the underarm seam and 1 on
  the upper edge.

Each map is a shear along columns followed by a shear along rows (or the reverse), each strictly monotone, so it is
injective, continuous across the armhole, and inverted in closed form.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.interpolate import PchipInterpolator

from dgl_assets.garments.tops.parameters import TopParameters, compute_armhole_width

V_ARMPIT = 0.6
U_NECK = 0.42
V_COLLAR = 0.12
NECK_DIP = {1: 0.18, -1: 0.035}
"""Fall of the neckline at the centre in v, on the front (1) and the back (-1)."""

_OPENING_DIP = {1: 0.05, -1: 0.012}  # likewise of a collar's upper edge

_SAMPLES = 400
_ROUNDING = 0.06  # length of shoulder and of sleeve that the rounded shoulder point takes up [m]
_ARMHOLE_BOW = 0.06  # depth of the armhole curve, share of its length
# A collar that lies flat still shows its back through the opening [m].
_COLLAR_OPENING = {1: 0.028, -1: 0.006}


class SleevePattern:
    """One sleeve on the side +x: outline and canonical map.

    Args:
        parameters: Measures of the top.
        angle: Fall of this sleeve below horizontal [rad].

    Raises:
        ValueError: If the widths of the sleeve contradict its armhole.

    Attributes:
        armhole: Shoulder to armpit [m], shape (N, 2), pattern frame.
        upper: Shoulder to cuff [m], shape (N, 2).
        underarm: Armpit to cuff [m], shape (N, 2).
        cuff: Upper to lower corner [m], shape (2, 2).
    """

    def __init__(self, parameters: TopParameters, *, angle: float) -> None:
        p = parameters
        self._along = np.array([math.cos(angle), -math.sin(angle)])
        self._across = np.array([-math.sin(angle), -math.cos(angle)])
        fall = (p.shoulder_half_width - p.neck_half_width) * math.tan(p.shoulder_slope)
        self._origin = np.array([p.shoulder_half_width, -fall])
        self._length = p.sleeve_length
        self._bend = p.sleeve_bend
        rounding = min(_ROUNDING, 0.45 * (p.shoulder_half_width - p.neck_half_width))
        slope = np.array([math.cos(p.shoulder_slope), -math.sin(p.shoulder_slope)])
        t = np.linspace(0.0, 1.0, 41)[:, None]
        bezier = self._origin - (1 - t) ** 2 * rounding * slope + t**2 * rounding * self._along
        self.shoulder_round, sleeve_round = bezier[:21], bezier[20:]
        self.shoulder = bezier[20]
        armpit = np.array([p.chest_half_width, -p.armhole_depth])

        # Upper edge and underside as functions of the distance along the sleeve, before bending.
        local = self._to_local(sleeve_round)
        self._upper_a = np.concatenate([local[:, 0], [p.sleeve_length]])
        self._upper_c = np.concatenate([local[:, 1], [0.0]])
        armpit_a, armpit_c = self._to_local(armpit[None])[0]
        self._check_widths(p, angle=angle, underarm=p.sleeve_length - armpit_a)
        knots = armpit_a + (p.sleeve_length - armpit_a) * np.array([0.0, 0.25, 0.8, 1.0])
        widths = [armpit_c, p.upper_sleeve_width, p.lower_sleeve_width, p.cuff_width]
        self._underside = PchipInterpolator(knots, widths)
        self._armpit_a, self._armpit_c = armpit_a, armpit_c

        a = np.linspace(self._upper_a[0], p.sleeve_length, _SAMPLES)
        self.upper = self._from_local(a, self._evaluate_upper(a))
        self.upper[0] = self.shoulder
        a = np.linspace(armpit_a, p.sleeve_length, _SAMPLES)
        self.underarm = self._from_local(a, self._evaluate_lower(a))
        self.underarm[0] = armpit
        self.cuff = np.stack([self.upper[-1], self.underarm[-1]])
        self.armhole = self._bow(self.shoulder, armpit)

        local = self._to_local(self.armhole)
        t = self._share_across(local[:, 0], local[:, 1])
        t[0], t[-1] = 0.0, 1.0
        if np.any(np.diff(t) <= 0):
            raise ValueError(
                f"the armhole folds over itself: armhole_depth {p.armhole_depth} and sleeve_angle "
                f"{angle:.3f} do not go together"
            )
        self._armhole_t, self._armhole_a = t, local[:, 0]
        self._armhole_v: np.ndarray | None = None

    def join_body(self, armhole_v: np.ndarray) -> None:
        """Take over the body's v along the armhole, shape (N,), so that both maps agree there."""
        self._armhole_v = armhole_v

    def to_canonical(self, points: np.ndarray) -> np.ndarray:
        """Map pattern points of the sleeve [m], shape (N, 2), to (u, v), shape (N, 2), u in [1, 2]."""
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
        assert self._armhole_v is not None, "join_body comes first"
        at_armhole = np.interp(t, self._armhole_t, self._armhole_v)
        return (1 - s) * at_armhole + s * (1 - (1 - V_ARMPIT) * t)

    def _share_across(self, a: np.ndarray, c: np.ndarray) -> np.ndarray:
        upper, lower = self._evaluate_upper(a), self._evaluate_lower(a)
        return (c - upper) / (lower - upper)

    def _evaluate_upper(self, a: np.ndarray) -> np.ndarray:
        return np.interp(a, self._upper_a, self._upper_c)

    def _evaluate_lower(self, a: np.ndarray) -> np.ndarray:
        return np.where(
            a < self._armpit_a,
            self._armpit_c,
            self._underside(np.clip(a, self._armpit_a, self._length)),
        )

    def _bend_at(self, a: np.ndarray) -> np.ndarray:
        share = np.clip((a - self._armpit_a) / (self._length - self._armpit_a), 0.0, 1.0)
        return self._bend * np.sin(math.pi * share) ** 2

    def _to_local(self, points: np.ndarray) -> np.ndarray:
        offset = points - self._origin
        a, c = offset @ self._along, offset @ self._across
        # The armpit is not known while its own coordinates are computed; nothing bends there.
        bend = self._bend_at(a) if hasattr(self, "_armpit_a") else 0.0
        return np.stack([a, c + bend], axis=1)

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
    def _check_widths(p: TopParameters, *, angle: float, underarm: float) -> None:
        if underarm < 0.15:
            raise ValueError(
                f"the underarm seam must be at least 0.15 m; got {underarm:.3f} from sleeve_length "
                f"{p.sleeve_length}, armhole_depth {p.armhole_depth} and sleeve_angle {angle:.3f}"
            )
        width = compute_armhole_width(p, sleeve_angle=angle)
        low, high = 0.6 * width, 1.25 * width
        if not low <= p.upper_sleeve_width <= high:
            raise ValueError(
                f"upper_sleeve_width must be in [{low:.3f}, {high:.3f}], 0.6 to 1.25 times the "
                f"armhole width that the other measures give; got {p.upper_sleeve_width}"
            )


class TopPattern:
    """All curves of a top, and its canonical maps.

    Args:
        parameters: Measures.

    Raises:
        ValueError: If the measures contradict each other; the message names them.

    Attributes:
        right: Sleeve on the side +x.
        left: Sleeve on the side -x, drawn mirrored, on +x.
        side: Hem corner to armpit [m], shape (N, 2), side +x.
    """

    def __init__(self, parameters: TopParameters) -> None:
        p = self._p = parameters
        half = p.sleeve_angle_difference / 2
        self.right = SleevePattern(p, angle=p.sleeve_angle - half)
        self.left = SleevePattern(p, angle=p.sleeve_angle + half)
        self._hem_half = p.chest_half_width + p.hem_flare
        self._armpit_y = -p.armhole_depth
        self.side = self._cut_side()
        self._check_clearance()
        # The two angles move the rounded shoulder point by millimetres, so each side has its own tables.
        self._edges = {1: self._tabulate_edge(self.right), -1: self._tabulate_edge(self.left)}

    def cut_neck(self, layer: int) -> np.ndarray:
        """Neck opening from the right to the left corner [m], shape (N, 2)."""
        x = np.linspace(1.0, -1.0, 2 * _SAMPLES + 1) * self._p.neck_half_width
        return np.stack([x, self._evaluate_opening(np.abs(x), layer=layer)], axis=1)

    def cut_shoulder(self, sleeve: SleevePattern) -> tuple[np.ndarray, np.ndarray]:
        """Shoulder seam, and the collar's side seam (one point without a collar) [m], side +x.

        Returns:
            Shoulder point to the neck, shape (N, 2); neck up to the opening, shape (M, 2).
        """
        neck = np.array([[self._p.neck_half_width, 0.0]])
        shoulder = np.concatenate([sleeve.shoulder_round[::-1], neck])
        collar = np.array([[self._p.neck_half_width, self._p.collar_height]])
        return shoulder, neck if self._p.collar_height == 0 else np.concatenate([neck, collar])

    def cut_hem(self) -> np.ndarray:
        """Hem from the left to the right corner [m], shape (N, 2)."""
        x = np.linspace(-self._hem_half, self._hem_half, 2 * _SAMPLES + 1)
        return np.stack([x, self._evaluate_hem(x)], axis=1)

    def body_to_canonical(self, points: np.ndarray, *, layer: int) -> np.ndarray:
        """Map pattern points of body and collar [m], shape (N, 2), to (u, v), shape (N, 2)."""
        x, y = np.abs(points[:, 0]), points[:, 1]
        sign = np.where(points[:, 0] >= 0, 1, -1)
        heights, values = self._column_knots(x, layer=layer, sign=sign)
        v = _interpolate_rows(y, heights, values)
        width, neck = self._row_knots(v, sign=sign)
        inner = U_NECK * x / neck
        outer = U_NECK + (1 - U_NECK) * (x - neck) / (width - neck)
        u = np.clip(np.where(x <= neck, inner, outer), 0.0, 1.0)
        return np.stack([sign * u, v], axis=1)

    def body_to_pattern(self, canonical: np.ndarray, *, layer: int) -> np.ndarray:
        """Map (u, v), shape (N, 2), |u| <= 1, to pattern points of body and collar [m], shape (N, 2)."""
        u, v = np.abs(canonical[:, 0]), canonical[:, 1]
        sign = np.where(canonical[:, 0] >= 0, 1, -1)
        width, neck = self._row_knots(v, sign=sign)
        inner = neck * u / U_NECK
        outer = neck + (width - neck) * (u - U_NECK) / (1 - U_NECK)
        x = np.where(u <= U_NECK, inner, outer)
        heights, values = self._column_knots(x, layer=layer, sign=sign)
        return np.stack([sign * x, _interpolate_rows(v, values, heights)], axis=1)

    def to_canonical(self, points: np.ndarray, *, part: str, layer: int) -> np.ndarray:
        """Map pattern points of one part ("body", "left_sleeve", "right_sleeve") to (u, v)."""
        if part == "body":
            return self.body_to_canonical(points, layer=layer)
        sleeve, mirror = self._get_sleeve(part)
        return sleeve.to_canonical(points * mirror) * mirror

    def to_pattern(self, canonical: np.ndarray, *, layer: int) -> np.ndarray:
        """Map (u, v), shape (N, 2), anywhere on one layer, to pattern points [m], shape (N, 2)."""
        result = np.empty_like(canonical, dtype=np.float64)
        body = np.abs(canonical[:, 0]) <= 1
        result[body] = self.body_to_pattern(canonical[body], layer=layer)
        for part, mask in (
            ("left_sleeve", canonical[:, 0] < -1),
            ("right_sleeve", canonical[:, 0] > 1),
        ):
            sleeve, mirror = self._get_sleeve(part)
            result[mask] = sleeve.to_pattern(canonical[mask] * mirror) * mirror
        return result

    def _get_sleeve(self, part: str) -> tuple[SleevePattern, np.ndarray]:
        if part == "right_sleeve":
            return self.right, np.array([1.0, 1.0])
        if part == "left_sleeve":
            return self.left, np.array([-1.0, 1.0])
        raise ValueError(f"part must be body, left_sleeve or right_sleeve; got {part!r}")

    def _evaluate_hem(self, x: np.ndarray) -> np.ndarray:
        share = np.minimum(np.abs(x) / self._hem_half, 1.0)
        return -self._p.body_length + self._p.hem_curve * share**2

    def _evaluate_neckline(self, x: np.ndarray, *, layer: int) -> np.ndarray:
        p = self._p
        depth, power = (
            (p.neck_front_depth, p.neck_roundness) if layer > 0 else (p.neck_back_depth, 2.0)
        )
        return -depth * (1 - np.minimum(x / p.neck_half_width, 1.0) ** power)

    def _evaluate_opening(self, x: np.ndarray, *, layer: int) -> np.ndarray:
        """The neckline, or the upper edge of the collar."""
        p = self._p
        if p.collar_height == 0:
            return self._evaluate_neckline(x, layer=layer)
        share = np.minimum(x / p.neck_half_width, 1.0)
        return p.collar_height - _COLLAR_OPENING[layer] * (1 - share**2)

    def _evaluate_shoulder(self, x: np.ndarray, *, sleeve: SleevePattern) -> np.ndarray:
        """Height of the shoulder seam over |x|, continued straight beyond the shoulder."""
        curve = self.cut_shoulder(sleeve)[0][::-1]
        slope = curve[-1] - curve[-2]
        beyond = curve[-1] + slope * 0.2 / slope[0]
        return np.interp(x, *np.concatenate([curve, beyond[None]]).T)

    def _column_knots(
        self, x: np.ndarray, *, layer: int, sign: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Heights [m] and their v along the columns at |x|, shape (N, 4): hem, armpit, upper edge, collar."""
        right = self._evaluate_shoulder(x, sleeve=self.right)
        left = self._evaluate_shoulder(x, sleeve=self.left)
        is_neck = x <= self._p.neck_half_width + 1e-9
        shoulder = np.where(sign > 0, right, left)
        top = np.where(is_neck, self._evaluate_neckline(x, layer=layer), shoulder)
        fall = 1 - np.minimum(x / self._p.neck_half_width, 1.0) ** 2
        v_top = 1 - NECK_DIP[layer] * fall
        # Without a collar nothing lies above the upper edge, and the last knot is never reached.
        has_collar = is_neck & (self._p.collar_height > 0)
        collar = np.where(has_collar, self._evaluate_opening(x, layer=layer), top + 1.0)
        v_collar = np.where(has_collar, 1 + V_COLLAR - _OPENING_DIP[layer] * fall, v_top + 1.0)
        hem, armpit = self._evaluate_hem(x), np.full(len(x), self._armpit_y)
        values = [np.zeros(len(x)), np.full(len(x), V_ARMPIT), v_top, v_collar]
        return np.stack([hem, armpit, top, collar], axis=1), np.stack(values, axis=1)

    def _row_knots(self, v: np.ndarray, *, sign: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Half width of the body, and the |x| of u = U_NECK, at each v."""
        right, left = (np.interp(v, *self._edges[side]) for side in (1, -1))
        width = np.where(sign > 0, right, left)
        # Below the armpit the columns spread to equal shares of the hem, whatever the width of the neck.
        share = np.clip(v / V_ARMPIT, 0.0, 1.0)
        return width, (1 - share) * U_NECK * width + share * self._p.neck_half_width

    def _tabulate_edge(self, sleeve: SleevePattern) -> tuple[np.ndarray, np.ndarray]:
        armhole = sleeve.armhole[::-1]
        edge = np.concatenate([self.side, armhole[1:]])
        x, y = edge.T
        hem, top = self._evaluate_hem(x), self._evaluate_shoulder(x, sleeve=sleeve)
        below = V_ARMPIT * (y - hem) / (self._armpit_y - hem)
        above = V_ARMPIT + (1 - V_ARMPIT) * (y - self._armpit_y) / (top - self._armpit_y)
        v = np.where(y < self._armpit_y, below, above)
        v[0], v[len(self.side) - 1], v[-1] = 0.0, V_ARMPIT, 1.0
        if np.any(np.diff(v) <= 0):
            raise ValueError(
                "the side of the body folds over itself: expected chest_half_width, "
                f"shoulder_half_width and armhole_depth that go together; got {self._p}"
            )
        sleeve.join_body(v[len(self.side) - 1 :][::-1])
        return v, edge[:, 0]

    def _cut_side(self) -> np.ndarray:
        p = self._p
        hem_y = -p.body_length + p.hem_curve
        waist = p.chest_half_width + 0.45 * p.hem_flare - p.waist_taper
        y = np.array([hem_y, hem_y + 0.55 * (self._armpit_y - hem_y), self._armpit_y])
        curve = PchipInterpolator(y, [self._hem_half, waist, p.chest_half_width])
        samples = np.linspace(hem_y, self._armpit_y, _SAMPLES)
        return np.stack([curve(samples), samples], axis=1)

    def _check_clearance(self) -> None:
        """Refuse sleeves that lie on the body."""
        for name, sleeve in (("right", self.right), ("left", self.left)):
            x, y = np.concatenate([sleeve.underarm, sleeve.cuff[::-1]]).T
            below = (y < self._armpit_y - 0.005) & (y > self.side[0, 1] - 0.05)
            gap = x - np.interp(y, self.side[:, 1], self.side[:, 0])
            needed = 0.25 * (self._armpit_y - y)
            if np.any(gap[below] < needed[below]):
                raise ValueError(
                    f"the {name} sleeve lies on the body: sleeve_angle {self._p.sleeve_angle} is "
                    f"too steep for hem_flare {self._p.hem_flare} and sleeve widths "
                    f"{self._p.upper_sleeve_width}, {self._p.cuff_width}"
                )


def _interpolate_rows(query: np.ndarray, knots: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Interpolate each query, shape (N,), along its own knots, shape (N, K), without extrapolating."""
    segment = (query[:, None] > knots[:, 1:-1]).sum(axis=1)[:, None]
    start, end = (np.take_along_axis(knots, segment + k, axis=1)[:, 0] for k in (0, 1))
    low, high = (np.take_along_axis(values, segment + k, axis=1)[:, 0] for k in (0, 1))
    return low + np.clip((query - start) / (end - start), 0.0, 1.0) * (high - low)
