"""One half of the body of an upper garment: its curves, and its canonical coordinates.

Pattern frame: metres, x across with 0 at the centre, y up with 0 at the highest point of the
shoulder, seen from above while the garment lies on its back; "left" is -x. Each half is built for
the side +x and mirrored.

Canonical coordinates (u, v) of one layer:

* body, |u| <= 1: u is 0 at the centre (`U_OPENING` at the edge of an open front) and 1 on side seam
  and armhole (1 - `U_STRAP` at the shoulder of a free armhole); v is 0 at the hem, `V_WAIST` at the
  waist (dresses only), `V_ARMPIT` at the armpit, 1 on the shoulder seam, which meets the neckline
  at u = `U_NECK`; the neckline falls towards the centre by a fixed dip.
* collar, |u| <= `U_NECK`: above the neckline, up to v = 1 + `V_COLLAR` at the sides; a hood up to
  1 + `V_HOOD`.
* sleeves, 1 <= |u| <= 2.
"""

from __future__ import annotations

import math

import numpy as np

from dgl_assets.garments.shear import Knots, ShearMap, tabulate_edge
from dgl_assets.garments.uppers.flap import Flap, cut_leaf
from dgl_assets.garments.uppers.neckline import U_NECK, Neckline
from dgl_assets.garments.uppers.outline import (
    SAMPLES,
    cut_armhole,
    cut_collar_edge,
    cut_hem,
    cut_opening,
    cut_side,
    evaluate_hem,
)
from dgl_assets.garments.uppers.parameters import Cuts
from dgl_assets.garments.uppers.sleeve import V_ARMPIT, SleevePattern
from dgl_assets.ranges import check_limit

V_WAIST = 0.35
U_OPENING = 0.05
U_STRAP = 0.15
"""Fall of u along an armhole without sleeve, from the armpit to the shoulder."""

# (u, v) that raglan seams keep clear of by `_CHEST_ROOM` [m]; the second only of open fronts.
_CHEST_PLACES = ((0.70, 0.82), (0.56, 0.945))
_CHEST_ROOM = 0.012
_RAGLAN_BOWS = ((0.42, 0.62), (0.32, 0.66), (0.25, 0.70), (0.20, 0.76), (0.14, 0.82))
_ROOM_BELOW_NECK = 0.06  # between a deep neckline and the level of the armpit [m]
_HOOD_START = 0.35  # of the neck's half width: front edges of a hood on the neckline


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
        self.side = cut_side(body, sign=sign)
        self.shoulder = self._cut_shoulder()
        self.armholes = {layer: self._cut_armhole(layer) for layer in (1, -1)}
        self.opening: np.ndarray | None = None
        self.collar_edge: np.ndarray | None = None
        if cuts.opening is not None:
            self.opening = cut_opening(cuts.opening, self.neckline, body, sign=sign)
            if neck.finish == "stand":
                self.collar_edge = cut_collar_edge(self.opening, self.neckline)
        front = float(self.opening[0, 0]) if self.opening is not None else 0.0
        self.hem = {
            layer: cut_hem(body, sign=sign, start=front if layer > 0 else 0.0) for layer in (1, -1)
        }
        self._maps = {layer: self._map(layer) for layer in (1, -1)}
        if self.sleeve is not None:
            self._check_clearance()
        self.flap = self._make_flap() if neck.leaf_width > 0 else None

    @property
    def neck_end(self) -> float:
        """Inner end x' of the front neckline [m]: 0, or the edge of an open front or of a hood."""
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
        """Map (u, v), shape (N, 2), u <= 1, to body, collar and hood [m], shape (N, 2)."""
        points = self._maps[layer].to_pattern(canonical)
        points[:, 0] *= self.neckline.scale(points[:, 1])
        return points

    def to_canonical(self, points: np.ndarray, *, layer: int, is_sleeve: bool) -> np.ndarray:
        """Map points of body or sleeve panels to (u, v); a raglan sleeve holds some of the body."""
        if not is_sleeve or self.sleeve is None:
            return self.body_to_canonical(points, layer=layer)
        result = self.sleeve.to_canonical(points)
        if self.cuts.sleeve is not None and self.cuts.sleeve.seam == "raglan":
            inside = ~self.sleeve.contains(points)
            result[inside] = self.body_to_canonical(points[inside], layer=layer)
        return result

    def to_pattern(self, canonical: np.ndarray, *, layer: int) -> np.ndarray:
        """Map (u, v), shape (N, 2), on one layer to pattern points [m], shape (N, 2)."""
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
        t = np.linspace(0.0, 1.0, SAMPLES)[:, None]
        # A raglan seam leaves the neck steeply and arrives at the armpit along the armhole. Its bow
        # leaves room for the landmarks on the chest.
        places = np.array(_CHEST_PLACES if self.opening is not None else _CHEST_PLACES[:1])
        chest = self.body_to_pattern(places, layer=1)
        best, room = np.empty((0, 2)), -1.0
        for across, down in _RAGLAN_BOWS:
            control = start + np.array([across, down]) * (end - start)
            seam = (1 - t) ** 2 * start + 2 * t * (1 - t) * control + t**2 * end
            distance = float(np.linalg.norm(seam - chest[:, None], axis=2).min())
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
            gaps = f"top_gap {cuts.opening.top_gap} and hem_gap {cuts.opening.hem_gap}"
            raise ValueError(f"fronts below a hood must not overlap; got {gaps}")
        if neck.finish == "lapel" and cuts.opening is None:
            raise ValueError("finish 'lapel' needs an open front")
        deepest = body.length - 0.12 if cuts.opening is not None else body.armhole_depth - 0.008
        formula = f"the limit for armhole_depth {body.armhole_depth} and length {body.length}"
        check_limit("front_depth", neck.front_depth, formula, most=deepest)
        most = body.armhole_depth - 0.01
        check_limit("back_depth", neck.back_depth, "armhole_depth - 0.01 m", most=most)

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
        armhole, neck = self.cuts.armhole, self.cuts.neck.half_width
        assert armhole is not None
        return cut_armhole(armhole, self.shoulder[0], self.side[-1], layer=layer, neck=neck)

    def _make_flap(self) -> Flap:
        leaf = cut_leaf(self.neckline, start=self.neck_end)
        return Flap(
            leaf,
            canonical=self.body_to_canonical(leaf.hinge, layer=1),
            v_edge=self.neckline.evaluate_edge_v(leaf.hinge[:, 0], layer=1),
        )

    def _evaluate_shoulder(self, x: np.ndarray) -> np.ndarray:
        """Height of the shoulder seam over x, continued level beyond the shoulder."""
        return np.interp(x, *self.shoulder[::-1].T)

    def _evaluate_armpit(self, x: np.ndarray, *, layer: int) -> np.ndarray:
        """Height of v = `V_ARMPIT` over x: level, or sagging below a deep neckline."""
        body, neck = self.cuts.body, self.cuts.neck
        depth = neck.front_depth if layer > 0 else neck.back_depth
        room = min(_ROOM_BELOW_NECK, 0.3 * body.armhole_depth)
        sag = max(0.0, depth + room - body.armhole_depth)
        share = np.clip(x / body.chest_half_width, 0.0, 1.0)
        return -body.armhole_depth - sag * (1 - share**2)

    def _columns(self, x: np.ndarray, *, layer: int) -> Knots:
        """Heights [m] and their v at x': hem, waist, armpit, neckline or shoulder, collar."""
        body, neckline = self.cuts.body, self.neckline
        is_neck = x <= self.cuts.neck.half_width + 1e-9
        hem = evaluate_hem(body, x, sign=self._sign)
        top = np.where(is_neck, neckline.evaluate(x, layer=layer), self._evaluate_shoulder(x))
        v_top = np.where(is_neck, neckline.evaluate_v(x, layer=layer), 1.0)
        armpit = self._evaluate_armpit(x, layer=layer)
        # Without a collar nothing lies above the upper edge, and the last knot is never reached.
        has_collar = is_neck & neckline.has_collar(layer) | is_neck & (
            self.cuts.neck.finish == "hood"
        )
        collar = np.where(has_collar, neckline.evaluate_edge(x, layer=layer), top + 1.0)
        v_collar = np.where(has_collar, neckline.evaluate_edge_v(x, layer=layer), v_top + 1.0)
        heights = [hem, armpit, top, collar]
        values = [np.zeros(len(x)), np.full(len(x), V_ARMPIT), v_top, v_collar]
        if self.cuts.has_waist:
            waist = np.minimum(-body.waist_depth, hem + 0.75 * (armpit - hem))
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
            if self.cuts.neck.finish == "hood":  # above the face opening it reaches the centre
                fade = np.clip((1.15 - v) / 0.15, 0.0, 1.0)
                low, u_low = low * fade, u_low * fade
            # Below the armpit the columns spread to equal shares of the hem.
            share = np.clip(v / V_ARMPIT, 0.0, 1.0)
            even = low + (width - low) * (U_NECK - u_low) / (1 - u_low)
            middle = (1 - share) * even + share * half_neck
            middle = np.clip(middle, low + 0.2 * (width - low), low + 0.9 * (width - low))
            middle = np.where(v >= V_ARMPIT, half_neck, middle)
            places = np.stack([low, middle, width], axis=1)
            return places, np.stack([u_low, np.full(len(v), U_NECK), u_high], axis=1)

        return ShearMap(columns=columns, rows=rows)

    def _get_outer_u(self, v: np.ndarray) -> np.ndarray:
        """Value of u on the side seam and on the armhole at v."""
        if self.sleeve is not None:
            return np.ones(len(v))
        # A triangle in the corner of side and free armhole must not lie on one line.
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
                "a sleeve lies on the body: angle "
                f"{self.cuts.sleeve and self.cuts.sleeve.angle} is too steep for hem_half_width "
                f"{self.cuts.body.hem_half_width} and its widths"
            )
