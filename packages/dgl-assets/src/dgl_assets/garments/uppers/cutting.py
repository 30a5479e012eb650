"""Seams, panels and maps of an upper garment from its two halves."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from dgl_assets.garments.assembly import Cut
from dgl_assets.garments.meshing import contains_points
from dgl_assets.garments.sewing import Curve, Panel, SewnSurface, trace_outline
from dgl_assets.garments.uppers.half import HalfPattern
from dgl_assets.garments.uppers.neckline import U_NECK, V_HOOD
from dgl_assets.garments.uppers.parameters import Cuts
from dgl_assets.garments.uppers.sleeve import V_ARMPIT

LAYERS = {"front": 1, "back": -1}
HANDS = {"left": -1, "right": 1}

Pins = Mapping[str, tuple[float, float, int]]
"""Canonical (|u|, v, side) by landmark; braces stand for the hand: "{}_cuff"."""

_RAISE_REACH = 0.06  # over which one front climbs onto the other [m]


def cut_upper(cuts: Cuts, pins: Pins) -> Cut:
    """Cut an upper garment.

    Args:
        cuts: The parts.
        pins: Landmarks inside of the panels.

    Returns:
        The input of `assemble`.

    Raises:
        ValueError: If the measures contradict each other.
    """
    return _UpperCutter(cuts, pins).cut()


class _UpperCutter:
    def __init__(self, cuts: Cuts, pins: Pins) -> None:
        self._cuts = cuts
        self._pins = pins
        self._halves = {hand: HalfPattern(cuts, sign=sign) for hand, sign in HANDS.items()}
        self._curves: dict[str, Curve] = {}
        self._exact: list[tuple[str, int, float]] = []
        self._finish = cuts.neck.finish

    def cut(self) -> Cut:
        for hand in HANDS:
            self._cut_half(hand)
        panels = self._cut_sleeves() + self._cut_hood() + self._cut_flaps() + self._cut_bodies()
        overlap = self._cuts.opening.overlap if self._cuts.opening is not None else 0.0
        return Cut(
            curves=self._curves,
            panels=tuple(self._place_pins(panels)),
            to_canonical=self._to_canonical,
            exact=self._exact,
            landmarks=self._collect_landmarks,
            compute_raise=self._compute_raise if overlap > 0 else None,
        )

    def _add(self, hand: str, name: str, start: str, end: str, points: np.ndarray) -> None:
        mirror = np.array([float(HANDS[hand]), 1.0])
        self._curves[name] = Curve(start=start, end=end, points=points * mirror)

    def _cut_half(self, hand: str) -> None:
        half, sign = self._halves[hand], float(HANDS[hand])
        armpit, shoulder, base = (f"{hand}_{n}" for n in ("armpit", "shoulder_point", "neck_side"))
        corner = f"{hand}_hem_corner"
        self._add(hand, f"{hand}_side", corner, armpit, half.side)
        self._add(hand, f"{hand}_shoulder", shoulder, base, half.shoulder)
        self._exact += [(f"{hand}_side", 0, sign), (f"{hand}_shoulder", 1, 1.0)]
        is_raglan = self._cuts.sleeve is not None and self._cuts.sleeve.seam == "raglan"
        for face, layer in LAYERS.items():
            start = base if is_raglan else shoulder
            name = f"{face}_{hand}_armhole"
            self._add(hand, name, start, armpit, half.cut_armhole_seam(layer))
            if half.sleeve is not None and not is_raglan:
                self._exact.append((name, 0, sign))
            is_open = layer > 0 and half.opening is not None
            start = f"{hand}_opening_hem" if is_open else f"{face}_hem_centre"
            self._add(hand, f"{face}_{hand}_hem", start, corner, half.hem[layer])
            self._exact.append((f"{face}_{hand}_hem", 1, 0.0))
            self._cut_neck(hand, face)
        if half.opening is not None:
            name = f"{hand}_opening"
            self._add(hand, name, f"{hand}_opening_hem", f"{hand}_opening_top", half.opening)
        if half.sleeve is not None:
            upper, lower = f"{hand}_cuff_upper", f"{hand}_cuff_lower"
            self._add(hand, f"{hand}_upper", shoulder, upper, half.sleeve.upper)
            self._add(hand, f"{hand}_underarm", armpit, lower, half.sleeve.underarm)
            for face in LAYERS:
                self._add(hand, f"{face}_{hand}_cuff", upper, lower, half.sleeve.cuff)
                self._exact.append((f"{face}_{hand}_cuff", 0, 2 * sign))
            self._exact += [(f"{hand}_upper", 1, 1.0), (f"{hand}_underarm", 1, V_ARMPIT)]

    def _cut_neck(self, hand: str, face: str) -> None:
        half, layer = self._halves[hand], LAYERS[face]
        base, top, sign = f"{hand}_neck_side", f"{hand}_collar_top", float(HANDS[hand])
        centre, end = f"{face}_neck_centre", 0.0
        if layer > 0:
            end = half.neck_end
            if half.opening is not None:
                centre = f"{hand}_opening_top"
            elif self._finish == "hood":
                centre = f"{hand}_hood_front"
        line = half.neckline
        if (layer < 0 and self._finish != "plain") or self._finish == "stand":
            name = f"{hand}_collar"
            self._add(hand, name, base, top, line.cut_side())
            self._exact.append((name, 0, sign * U_NECK))
            edge = line.cut_edge(layer, x_end=end if layer > 0 else 0.0)
            if self._finish == "hood":
                self._add(hand, f"{hand}_hood_top", top, "hood_top", edge)
                self._exact.append((f"{hand}_hood_top", 1, 1 + V_HOOD))
                return
            if layer > 0 and half.collar_edge is not None:
                self._add(
                    hand, f"{hand}_collar_edge", centre, f"{hand}_collar_front", half.collar_edge
                )
                centre, edge[-1] = f"{hand}_collar_front", half.collar_edge[-1]
            self._add(hand, f"{face}_{hand}_neck", top, centre, edge)
        else:
            self._add(hand, f"{face}_{hand}_neck", base, centre, line.cut(layer, x_end=end))
        if layer > 0 and self._finish == "hood":
            start = self._curves[f"{face}_{hand}_neck"].points[-1] * [sign, 1.0]
            self._add(hand, f"{hand}_face", centre, "face_top", line.cut_face(start))

    def _cut_bodies(self) -> list[Panel]:
        panels = []
        for face, layer in LAYERS.items():
            runs = {hand: self._walk_half(hand, face) for hand in HANDS}
            if layer > 0 and self._cuts.opening is not None:
                for hand in HANDS:
                    collar = (f"-{hand}_collar_edge",) if self._finish == "stand" else ()
                    edges = (*runs[hand], *collar, f"-{hand}_opening")
                    edges = edges if hand == "right" else _reverse(edges)
                    name = f"{face}_{hand}_body"
                    panels.append(Panel(name=name, layer=layer, edges=edges, pins={}))
                continue
            gap: tuple[str, ...] = ()
            if layer > 0 and self._finish == "hood":
                gap = ("front_neck_gap",)
                points = np.stack(
                    [self._curves[f"front_{h}_neck"].points[-1] for h in ("right", "left")]
                )
                self._curves[gap[0]] = Curve(
                    start="right_hood_front", end="left_hood_front", points=points
                )
            edges = (*runs["right"], *gap, *_reverse(runs["left"]))
            panels.append(Panel(name=f"{face}_body", layer=layer, edges=edges, pins={}))
        return panels

    def _walk_half(self, hand: str, face: str) -> tuple[str, ...]:
        """Edges of half a body panel from the centre of the hem to the neck, as on the right."""
        is_raglan = self._cuts.sleeve is not None and self._cuts.sleeve.seam == "raglan"
        shoulder = () if is_raglan else (f"{hand}_shoulder",)
        neck: tuple[str, ...] = (f"{face}_{hand}_neck",)
        if (face == "back" and self._finish != "plain") or self._finish == "stand":
            neck = (f"{hand}_collar", *neck)
        if face == "back" and self._finish == "hood":
            neck = (f"{hand}_collar", f"{hand}_hood_top")
        return (f"{face}_{hand}_hem", f"{hand}_side", f"-{face}_{hand}_armhole", *shoulder, *neck)

    def _cut_sleeves(self) -> list[Panel]:
        if self._cuts.sleeve is None:
            return []
        panels = []
        shoulder = ("{}_shoulder",) if self._cuts.sleeve.seam == "raglan" else ()
        for face, layer in LAYERS.items():
            for hand in HANDS:
                edges = ("{}_underarm", f"-{face}_{{}}_cuff", "-{}_upper", *shoulder)
                edges = tuple(e.format(hand) for e in (*edges, f"{face}_{{}}_armhole"))
                edges = edges if hand == "right" else _reverse(edges)
                name = f"{face}_{hand}_sleeve"
                panels.append(Panel(name=name, layer=layer, edges=edges, pins={}))
        return panels

    def _cut_hood(self) -> list[Panel]:
        if self._finish != "hood":
            return []
        right = ("-right_face", "-front_right_neck", "right_collar", "right_hood_top")
        left = tuple(edge.replace("right", "left") for edge in right)
        return [Panel(name="front_hood", layer=1, edges=(*right, *_reverse(left)), pins={})]

    def _cut_flaps(self) -> list[Panel]:
        panels = []
        for hand, half in self._halves.items():
            if half.flap is None:
                continue
            start = f"{hand}_opening_top" if half.opening is not None else "front_neck_centre"
            leaf = half.flap.leaf
            outer, shares = leaf.outer, (0.0, *leaf.corners, 1.0)
            names: list[str] = []
            last = start
            if leaf.is_pointed:
                tip = f"{hand}_collar_tip"
                edge = np.stack([leaf.hinge[0], leaf.outer[0]])
                self._add(hand, f"{hand}_leaf_tip", last, tip, edge)
                names.append(f"{hand}_leaf_tip")
                last = tip
            for k, (low, high) in enumerate(itertools.pairwise(shares)):
                part = outer[round(low * (len(outer) - 1)) : round(high * (len(outer) - 1)) + 1]
                following = f"{hand}_collar_top" if high == 1.0 else f"{hand}_leaf_corner_{k}"
                self._add(hand, f"{hand}_leaf_{k}", last, following, part)
                names.append(f"{hand}_leaf_{k}")
                last = following
            # The leaf lies beside its hinge on the body's side, so it is walked like the body.
            edges = (*names, f"-{hand}_collar", f"front_{hand}_neck")
            edges = edges if hand == "right" else _reverse(edges)
            panels.append(Panel(name=f"front_{hand}_collar_flap", layer=2, edges=edges, pins={}))
        return panels

    def _place_pins(self, panels: list[Panel]) -> list[Panel]:
        """Give every pin to the panel that it lies in."""
        pins: dict[str, tuple[str, int, np.ndarray]] = {}
        for name, (u, v, side) in self._pins.items():
            for hand in HANDS if "{}" in name else ("right",):
                point = self._halves[hand].to_pattern(np.array([[u, v]]), layer=side)[0]
                pins[name.format(hand)] = hand, side, point * [HANDS[hand], 1.0]
        placed = []
        for panel in panels:
            outline = trace_outline(self._curves, panel)
            other = {hand for hand in HANDS if f"_{hand}_" not in panel.name}
            other = set() if len(other) == len(HANDS) else other  # of both hands
            chosen = {
                name: point
                for name, (hand, side, point) in pins.items()
                if side == panel.layer
                and hand not in other
                and contains_points(outline, point[None])[0]
            }
            for name in chosen:
                del pins[name]
            placed.append(replace(panel, pins=chosen))
        if pins:
            raise ValueError(f"landmarks {sorted(pins)} lie on no panel")
        return placed

    def _to_canonical(self, panel: str, points: np.ndarray) -> np.ndarray:
        layer = LAYERS[panel.split("_", maxsplit=1)[0]]
        result = np.empty((len(points), 2))
        named = [hand for hand in HANDS if f"_{hand}_" in panel]
        for hand, sign in HANDS.items():
            # Panels across the centre hold both halves; those of an open front may overlap it.
            mine = np.full(len(points), hand == named[0]) if named else (points[:, 0] * sign >= 0)
            mirror, half = np.array([float(sign), 1.0]), self._halves[hand]
            if panel.endswith("_flap"):
                if mine.any() and half.flap is not None:
                    result[mine] = half.flap.to_canonical(points[mine] * mirror) * mirror
                continue
            mapped = half.to_canonical(
                points[mine] * mirror, layer=layer, is_sleeve=panel.endswith("sleeve")
            )
            result[mine] = mapped * mirror
        return result

    def _compute_raise(self, points: np.ndarray, panel: str) -> np.ndarray:
        """Raise the right front over the left one where they overlap."""
        opening = self._cuts.opening
        if opening is None or not panel.startswith("front_right") or panel.endswith("sleeve"):
            return np.zeros(len(points))
        share = np.clip((opening.overlap + 0.01 - points[:, 0]) / _RAISE_REACH + 1, 0.0, 1.0)
        return share**2 * (3 - 2 * share)

    def _collect_landmarks(self, surface: SewnSurface) -> dict[str, int]:
        names = ["armpit", "hem_corner", "neck_side"]
        if self._cuts.sleeve is not None:
            names += ["cuff_upper", "cuff_lower"]
        if self._cuts.opening is not None:
            names += ["opening_top", "opening_hem"]
        landmarks = {f"{h}_{n}": surface.junctions[f"{h}_{n}"] for h in HANDS for n in names}
        centre = "back" if self._cuts.opening is not None else "front"
        landmarks["hem_centre"] = surface.junctions[f"{centre}_hem_centre"]
        return landmarks


def _reverse(edges: tuple[str, ...]) -> tuple[str, ...]:
    """Walk edges the other way round."""
    return tuple(edge[1:] if edge[0] == "-" else f"-{edge}" for edge in reversed(edges))
