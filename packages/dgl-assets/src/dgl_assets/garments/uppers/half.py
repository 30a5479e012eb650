"""One half of the body of an upper garment: its curves, and its canonical coordinates.

Pattern frame: metres, x across with 0 at the centre, y up with 0 at the highest point of the shoulder, seen from above
while the garment lies on its back; "left" is -x. Each half is built for the side +x and mirrored.

Canonical coordinates (u, v) of one layer:

* body, |u| <= 1: u is 0 at the centre (`U_OPENING` at the edge of an open front) and 1 on side seam and armhole (a free armhole falls to 1 - `U_STRAP`); v is 0 at
  the hem, `V_WAIST` at the waist (dresses only), `V_ARMPIT` at the armpit, 1 on the shoulder seam, which meets the
  neckline at u = `U_NECK`; the neckline falls towards the centre by a fixed dip.
* collar, |u| <= `U_NECK`: above the neckline, up to v = 1 + `V_COLLAR` at the sides; a hood up to 1 + `V_HOOD`.
* sleeves, 1 <= |u| <= 2.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import PchipInterpolator

from dgl_assets.garments.shear import Knots, ShearMap, tabulate_edge
from dgl_assets.garments.uppers.flap import Flap
from dgl_assets.garments.uppers.neckline import U_NECK, Neckline
from dgl_assets.garments.uppers.parameters import Armhole, Body, Neck, Opening, Sleeve
from dgl_assets.garments.uppers.sleeve import V_ARMPIT, SleevePattern

V_WAIST = 0.35
U_OPENING = 0.05
U_STRAP = 0.15
"""How far u of an armhole without sleeve falls from the armpit to the shoulder."""

_SAMPLES = 400
_HIP_BELOW_WAIST = 0.17  # [m]
_UPPER_CHEST, _CHEST_ROOM = (
    (0.70, 0.82),
    0.012,
)  # place that raglan seams keep clear of, by so much [m]
_RAGLAN_BOWS = ((0.42, 0.62), (0.32, 0.66), (0.25, 0.70), (0.20, 0.76), (0.14, 0.82))
_LEAST_STEP = 0.035  # between heights that shape the side seam [m]
_SOFT_ARMPIT, _SOFT_WAIST = (
    0.8,
    0.45,
)  # highest share of a column where a deep neckline pushes these levels down
_HOOD_START = 0.35  # of the neck's half width: where the front edges of a hood meet the neckline


@dataclass(frozen=True, kw_only=True)
class Cuts:
    """The parts that an upper garment is composed of.

    Attributes:
        body: Front and back.
        neck: Neckline and collar.
        sleeve: Sleeves, or None.
        armhole: Edge of the armholes where there are no sleeves, or None.
        opening: Open front, or None.
        neck_dip: Fall of the neckline at the centre in v: front, back.
        has_waist: Whether v is fixed at the waist.
    """

    body: Body
    neck: Neck
    sleeve: Sleeve | None = None
    armhole: Armhole | None = None
    opening: Opening | None = None
    neck_dip: tuple[float, float] = (0.18, 0.035)
    has_waist: bool = False


class HalfPattern:
    """One half of an upper garment on the side +x.

    Args:
        cuts: The parts.
        sign: +1 for the right half, -1 for the left one, which is drawn mirrored.

    Raises:
        ValueError: If the measures contradict each other; the message names them.

    Attributes:
        cuts: The parts.
        sleeve: The sleeve, or None.
        neckline: Neckline and collar.
        side: Hem corner to armpit [m], shape (N, 2).
        shoulder: Shoulder point to the neck [m], shape (N, 2).
        armholes: Shoulder to armpit [m], shape (N, 2), by layer.
        opening: Hem to neckline along the edge of an open front [m], shape (N, 2), or None.
        collar_edge: Neckline to the top of a standing collar, likewise.
        hem: Centre or opening to the corner [m], shape (N, 2), by layer.
        flap: Folded leaf of the collar, or None.
    """

    def __init__(self, cuts: Cuts, *, sign: int) -> None:
        self.cuts, self._sign = cuts, sign
        self._check_parts()
        body, neck = cuts.body, cuts.neck
        top_gap = cuts.opening.top_gap if cuts.opening is not None else 0.0
        dip = {1: cuts.neck_dip[0], -1: cuts.neck_dip[1]}
        self.neckline = Neckline(neck, dip=dip, start=top_gap)
        self.sleeve: SleevePattern | None = None
        if cuts.sleeve is not None:
            angle = cuts.sleeve.angle - sign * cuts.sleeve.angle_difference / 2
            self.sleeve = SleevePattern(body, neck, cuts.sleeve, angle=angle)
        self._hem_half = body.hem_half_width
        self.side = self._cut_side()
        self.shoulder = self._cut_shoulder()
        self.armholes = {layer: self._cut_armhole(layer) for layer in (1, -1)}
        self.opening = self._cut_opening()
        self.collar_edge = self._cut_collar_edge()
        self.hem = {layer: self._cut_hem(layer) for layer in (1, -1)}
        self._maps = {layer: self._map(layer) for layer in (1, -1)}
        if self.sleeve is not None:
            self._check_clearance()
        self.flap = self._cut_flap() if neck.leaf_width > 0 else None

    @property
    def neck_end(self) -> float:
        """x' of the inner end of the front neckline [m]: 0, or the edge of an open front or of a hood."""
        if self.cuts.opening is not None:
            return self.cuts.opening.top_gap
        if self.cuts.neck.finish == "hood":
            return _HOOD_START * self.cuts.neck.half_width
        return 0.0

    def body_to_canonical(self, points: np.ndarray, *, layer: int) -> np.ndarray:
        """Map points of body, collar and hood [m], shape (N, 2), to (u, v), shape (N, 2)."""
        straight = points / np.stack(
            [self.neckline.scale(points[:, 1]), np.ones(len(points))], axis=1
        )
        return self._maps[layer].to_canonical(straight)

    def body_to_pattern(self, canonical: np.ndarray, *, layer: int) -> np.ndarray:
        """Map (u, v), shape (N, 2), u <= 1, to points of body, collar and hood [m], shape (N, 2)."""
        points = self._maps[layer].to_pattern(canonical)
        points[:, 0] *= self.neckline.scale(points[:, 1])
        return points

    def to_canonical(self, points: np.ndarray, *, layer: int, is_sleeve: bool) -> np.ndarray:
        """Map points of the body's panels, or of the sleeve's, to (u, v); a raglan's holds some of the body."""
        if not is_sleeve or self.sleeve is None:
            return self.body_to_canonical(points, layer=layer)
        result = self.sleeve.to_canonical(points)
        if self.cuts.sleeve is not None and self.cuts.sleeve.seam == "raglan":
            inside = ~self.sleeve.contains(points)
            result[inside] = self.body_to_canonical(points[inside], layer=layer)
        return result

    def to_pattern(self, canonical: np.ndarray, *, layer: int) -> np.ndarray:
        """Map (u, v), shape (N, 2), anywhere on one layer of this half, to pattern points [m], shape (N, 2)."""
        result = self.body_to_pattern(np.minimum(canonical, [1.0, np.inf]), layer=layer)
        outside = canonical[:, 0] > 1
        if outside.any():
            if self.sleeve is None:
                raise ValueError("u must be at most 1 on a garment without sleeves")
            result[outside] = self.sleeve.to_pattern(canonical[outside])
        return result

    def cut_armhole_seam(self, layer: int) -> np.ndarray:
        """Seam of the sleeve, or edge of the armhole, down to the armpit [m], shape (N, 2)."""
        sleeve = self.cuts.sleeve
        if sleeve is None or sleeve.seam == "set_in":
            return self.armholes[layer]
        start, end = self.shoulder[-1], self.side[-1]
        t = np.linspace(0.0, 1.0, _SAMPLES)[:, None]
        # A raglan seam leaves the neck steeply and arrives at the armpit along the armhole. It is bowed as far as a vertex
        # on the upper chest, where landmarks are, needs room beside it.
        chest = self.body_to_pattern(np.array([_UPPER_CHEST]), layer=1)
        best, room = np.empty((0, 2)), -1.0
        for across, down in _RAGLAN_BOWS:
            control = start + np.array([across, down]) * (end - start)
            seam = (1 - t) ** 2 * start + 2 * t * (1 - t) * control + t**2 * end
            distance = float(np.linalg.norm(seam - chest, axis=1).min())
            if distance > room:
                best, room = seam, distance
            if room > _CHEST_ROOM:
                break
        return best

    def _check_parts(self) -> None:
        cuts = self.cuts
        body, neck = cuts.body, cuts.neck
        if (cuts.sleeve is None) == (cuts.armhole is None):
            raise ValueError("a garment needs either a sleeve or an armhole")
        strap = body.shoulder_half_width - neck.half_width
        if strap < 0.024:
            raise ValueError(
                f"half_width of the neck must be at least 0.024 m below shoulder_half_width "
                f"({body.shoulder_half_width}); got {neck.half_width}"
            )
        if neck.finish == "hood" and cuts.opening is not None and cuts.opening.overlap > 0:
            raise ValueError(
                "fronts below a hood must not overlap; got top_gap "
                f"{cuts.opening.top_gap} and hem_gap {cuts.opening.hem_gap}"
            )
        if neck.finish == "lapel" and cuts.opening is None:
            raise ValueError("finish 'lapel' needs an open front")
        deepest = body.length - 0.12 if cuts.opening is not None else body.armhole_depth - 0.008
        if neck.front_depth > deepest:
            raise ValueError(
                f"front_depth must be at most {deepest:.3f} m for armhole_depth {body.armhole_depth} and "
                f"length {body.length}; got {neck.front_depth}"
            )
        if neck.back_depth > body.armhole_depth - 0.01:
            raise ValueError(
                f"back_depth must be at least 0.01 m below armhole_depth ({body.armhole_depth}); got "
                f"{neck.back_depth}"
            )

    def _cut_side(self) -> np.ndarray:
        body = self.cuts.body
        start = -body.length + body.hem_curve + self._sign * body.hem_tilt
        knots = [(start, body.hem_half_width)]
        hip = body.waist_depth + _HIP_BELOW_WAIST
        for depth, width in ((hip, body.hip_half_width), (body.waist_depth, body.waist_half_width)):
            # Levels beyond the hem, or almost on another one, do not shape the seam.
            if width > 0 and -depth > knots[-1][0] + _LEAST_STEP:
                knots.append((-depth, width))
        if knots[-1][0] > -body.armhole_depth - _LEAST_STEP and len(knots) > 1:
            knots.pop()
        knots.append((-body.armhole_depth, body.chest_half_width))
        y, x = np.array(knots).T
        if y[-1] - y[0] < 0.05:
            raise ValueError(
                f"the side seam must be at least 0.05 m long; got {y[-1] - y[0]:.3f} from length "
                f"{body.length}, hem_curve {body.hem_curve} and armhole_depth {body.armhole_depth}"
            )
        heights = np.linspace(y[0], y[-1], _SAMPLES)
        return np.stack([PchipInterpolator(y, x)(heights), heights], axis=1)

    def _cut_shoulder(self) -> np.ndarray:
        body, neck = self.cuts.body, self.cuts.neck
        end = np.array([[neck.half_width, 0.0]])
        if self.sleeve is not None:
            return np.concatenate([self.sleeve.shoulder_round[::-1], end])
        fall = (body.shoulder_half_width - neck.half_width) * math.tan(body.shoulder_slope)
        return np.concatenate([[[body.shoulder_half_width, -fall]], end])

    def _cut_armhole(self, layer: int) -> np.ndarray:
        if self.sleeve is not None:
            return self.sleeve.armhole
        armhole = self.cuts.armhole
        assert armhole is not None
        start, end = self.shoulder[0], self.side[-1]
        angle = np.linspace(0.0, math.pi / 2, _SAMPLES)
        x = start[0] + (end[0] - start[0]) * (1 - np.cos(angle)) ** (1 / armhole.squareness)
        y = start[1] + (end[1] - start[1]) * np.sin(angle)
        x -= (
            (armhole.front_scoop if layer > 0 else armhole.back_scoop)
            * np.sin(angle) ** 2
            * np.sin(2 * angle)
            * 1.3
        )
        x[-1], y[-1] = end
        if x.min() < self.cuts.neck.half_width + 0.02:
            raise ValueError(
                f"the armhole reaches the neck: front_scoop {armhole.front_scoop} and back_scoop "
                f"{armhole.back_scoop} are too deep for shoulder_half_width "
                f"{self.cuts.body.shoulder_half_width}"
            )
        return np.stack([x, y], axis=1)

    def _cut_opening(self) -> np.ndarray | None:
        opening, body, neck = self.cuts.opening, self.cuts.body, self.cuts.neck
        if opening is None:
            return None
        if opening.top_gap > 0.6 * neck.half_width:
            raise ValueError(
                f"top_gap must be at most 0.6 of the neck's half width ({neck.half_width}); got "
                f"{opening.top_gap}"
            )
        top = float(self.neckline.evaluate(np.array([opening.top_gap]), layer=1)[0])
        bottom = float(self._evaluate_hem(np.array([opening.hem_gap]))[0])
        y = np.linspace(bottom, top, _SAMPLES)
        x = opening.hem_gap + (opening.top_gap - opening.hem_gap) * (y - bottom) / (top - bottom)
        if opening.corner_radius > 0:
            share = np.clip((bottom + opening.corner_radius - y) / opening.corner_radius, 0.0, 1.0)
            x += opening.corner_radius * (1 - np.sqrt(1 - 0.96 * share**2))
            y[0] = self._evaluate_hem(x[:1])[0]
        return np.stack([x, y], axis=1)

    def _cut_collar_edge(self) -> np.ndarray | None:
        if self.opening is None or self.cuts.neck.finish != "stand":
            return None
        x, y = self.opening[-1:].T
        rise = np.linspace(y[0], self.neckline.evaluate_edge(x, layer=1)[0], 60)
        return np.stack([x * self.neckline.scale(rise), rise], axis=1)

    def _cut_hem(self, layer: int) -> np.ndarray:
        start = self.opening[0, 0] if layer > 0 and self.opening is not None else 0.0
        x = np.linspace(start, self._hem_half, _SAMPLES)
        return np.stack([x, self._evaluate_hem(x)], axis=1)

    def _cut_flap(self) -> Flap:
        neck = self.cuts.neck
        hinge = self.neckline.cut(1, x_end=self.neck_end)[::-1]
        step = np.linalg.norm(np.diff(hinge, axis=0), axis=1)
        share = np.concatenate([[0.0], np.cumsum(step)]) / step.sum()
        hinge = np.stack(
            [np.interp(np.linspace(0, 1, _SAMPLES), share, hinge[:, k]) for k in range(2)], axis=1
        )
        share = np.linspace(0.0, 1.0, _SAMPLES)
        side = self.neckline.cut_side()
        last = side[-1] - side[0]
        end_angle = math.atan2(last[1], last[0])
        angle = -neck.leaf_angle + share * (end_angle + neck.leaf_angle)
        is_lapel = neck.finish == "lapel"
        knots, corners = _LAPEL if is_lapel else _LEAF
        end_width = float(np.linalg.norm(last)) / neck.leaf_width
        places, widths = np.array(knots).T
        width = neck.leaf_width * np.interp(
            share, np.append(places, 1.0), np.append(widths, end_width)
        )
        outer = hinge + width[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        outer[-1] = side[-1]
        places = np.stack([hinge[:, 0], hinge[:, 1]], axis=1)
        canonical = self.body_to_canonical(places, layer=1)
        u, v = canonical.T
        # v tells the width of the leaf, except where it joins the side seam, so that its corners stay corners.
        relative = width / (neck.leaf_width * max(widths))
        joins = np.clip((share - 0.85) / 0.15, 0.0, 1.0)
        v_edge = self.neckline.evaluate_edge_v(hinge[:, 0], layer=1)
        v_edge = v + (v_edge - v) * (relative + (1 - relative) * joins)

        def get_span(query: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
            return tuple(np.interp(query, share, values) for values in (u, v, v_edge))  # type: ignore[return-value]

        return Flap(hinge, outer, corners=corners, get_span=get_span)

    def _evaluate_hem(self, x: np.ndarray) -> np.ndarray:
        body = self.cuts.body
        share = np.clip(x / self._hem_half, 0.0, 1.0)
        return -body.length + body.hem_curve * share**2 + self._sign * body.hem_tilt * share

    def _evaluate_shoulder(self, x: np.ndarray) -> np.ndarray:
        """Height of the shoulder seam over x, continued level beyond the shoulder."""
        return np.interp(x, *self.shoulder[::-1].T)

    def _columns(self, x: np.ndarray, *, layer: int) -> Knots:
        """Heights [m] and their v along the columns at x': hem, waist, armpit, neckline or shoulder, collar."""
        body, neckline = self.cuts.body, self.neckline
        is_neck = x <= self.cuts.neck.half_width + 1e-9
        hem = self._evaluate_hem(x)
        top = np.where(is_neck, neckline.evaluate(x, layer=layer), self._evaluate_shoulder(x))
        v_top = np.where(is_neck, neckline.evaluate_v(x, layer=layer), 1.0)
        armpit = np.minimum(-body.armhole_depth, hem + _SOFT_ARMPIT * (top - hem))
        # Without a collar nothing lies above the upper edge, and the last knot is never reached.
        has_collar = is_neck & neckline.has_collar(layer) | is_neck & (
            self.cuts.neck.finish == "hood"
        )
        collar = np.where(has_collar, neckline.evaluate_edge(x, layer=layer), top + 1.0)
        v_collar = np.where(has_collar, neckline.evaluate_edge_v(x, layer=layer), v_top + 1.0)
        heights = [hem, armpit, top, collar]
        values = [np.zeros(len(x)), np.full(len(x), V_ARMPIT), v_top, v_collar]
        if self.cuts.has_waist:
            waist = np.minimum(-body.waist_depth, hem + _SOFT_WAIST * (top - hem))
            heights.insert(1, waist)
            values.insert(1, np.full(len(x), V_WAIST))
        return np.stack(heights, axis=1), np.stack(values, axis=1)

    def _map(self, layer: int) -> ShearMap:
        def columns(x: np.ndarray) -> Knots:
            return self._columns(x, layer=layer)

        shape = ShearMap(columns=columns, rows=lambda v: (v[:, None], v[:, None]))
        armhole = self.armholes[layer][::-1]
        edge = np.concatenate([self.side, armhole[1:]])
        v = shape.compute_v(edge)
        v[0], v[len(self.side) - 1], v[-1] = 0.0, V_ARMPIT, 1.0
        outer = tabulate_edge(edge, v, what="the side of the body")
        if self.sleeve is not None:
            self.sleeve.join_body(v[len(self.side) - 1 :][::-1])
        inner: Knots | None = None
        if layer > 0 and self.opening is not None:
            straight = self.opening.copy()
            if self.collar_edge is not None:
                straight = np.concatenate([straight, self.collar_edge[1:]])
            straight[:, 0] /= self.neckline.scale(straight[:, 1])
            v = shape.compute_v(straight)
            v[0] = 0.0
            inner = tabulate_edge(straight, v, what="the edge of the open front")
        half_neck = self.cuts.neck.half_width

        def rows(v: np.ndarray) -> Knots:
            width = np.interp(v, *outer)
            low = np.interp(v, *inner) if inner is not None else np.zeros(len(v))
            u_low = np.full(len(v), U_OPENING if inner is not None else 0.0)
            u_high = self._get_outer_u(v)
            # Below the armpit the columns spread to equal shares of the hem, whatever the width of the neck.
            share = np.clip(v / V_ARMPIT, 0.0, 1.0)
            even = low + (width - low) * (U_NECK - u_low) / (1 - u_low)
            middle = (1 - share) * even + share * half_neck
            middle = np.clip(middle, low + 0.2 * (width - low), low + 0.9 * (width - low))
            middle = np.where(v >= V_ARMPIT, half_neck, middle)
            places = np.stack([low, middle, width], axis=1)
            return places, np.stack([u_low, np.full(len(v), U_NECK), u_high], axis=1)

        return ShearMap(columns=columns, rows=rows)

    def _get_outer_u(self, v: np.ndarray) -> np.ndarray:
        """u of the side seam and of the armhole at v."""
        if self.sleeve is not None:
            return np.ones(len(v))
        # Side and free armhole meet in a corner, which a triangle may fill; it must not lie on one line.
        return 1 - U_STRAP * np.clip((v - V_ARMPIT) / (1 - V_ARMPIT), 0.0, 1.0)

    def _check_clearance(self) -> None:
        """Refuse sleeves that lie on the body."""
        assert self.sleeve is not None
        armpit_y = -self.cuts.body.armhole_depth
        x, y = np.concatenate([self.sleeve.underarm, self.sleeve.cuff[::-1]]).T
        below = (y < armpit_y - 0.005) & (y > self.side[0, 1] - 0.05)
        gap = x - np.interp(y, self.side[:, 1], self.side[:, 0])
        if np.any(gap[below] < np.minimum(0.25 * (armpit_y - y), 0.05)[below]):
            raise ValueError(
                f"a sleeve lies on the body: angle {self.cuts.sleeve and self.cuts.sleeve.angle} is too "
                f"steep for hem_half_width {self.cuts.body.hem_half_width} and the widths of the sleeve"
            )


# Width of a leaf as shares of `leaf_width` at shares along its hinge; the last point is the collar's side seam.
_LEAF = ((0.0, 1.15), (0.25, 1.0), (0.7, 0.92)), ()
_LAPEL = (
    ((0.0, 0.0), (0.06, 0.3), (0.56, 1.1), (0.62, 0.66), (0.68, 0.95), (0.85, 0.85)),
    (0.56, 0.62, 0.68),
)
