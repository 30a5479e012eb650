"""Cut trousers and shorts.

Landmarks are exact correspondences. With `left_` or `right_`: `waist` and `waist_inner` (just below
the waistband, beside the outer seam and the centre), `waistband` (further in and lower, grasped by
a fling), `hem_outer` and `hem_inner` (just above the hem), `knee`, `hip`; the corners
`waist_corner`, `hem_outer_corner`, `hem_inner_corner`. Besides `centre` (below the middle of the
waistband), `waist_centre` and `crotch`.
"""

from __future__ import annotations

import numpy as np

from dgl_assets.garments.assembly import Cut
from dgl_assets.garments.sewing import Curve, Panel, SewnSurface
from dgl_assets.garments.trousers.parameters import TrousersParameters
from dgl_assets.garments.trousers.pattern import LegPattern

CATEGORY = "Trousers"

_LAYERS = {"front": 1, "back": -1}
_HANDS = {"left": -1.0, "right": 1.0}
_PINNED: dict[str, tuple[float, float]] = {
    "waist": (0.90, 0.955),
    "waist_inner": (0.45, 0.955),
    "waistband": (0.80, 0.90),
    "hip": (0.88, 0.76),
    "knee": (0.55, 0.31),
    "hem_outer": (0.86, 0.045),
    "hem_inner": (0.40, 0.045),
}
"""Canonical (|u|, v) of landmarks on the front of each half, after the demonstration points of the
paper's fold, fling and hang tasks."""
_V_CENTRE = 0.89


def cut_trousers(parameters: TrousersParameters) -> Cut:
    """Cut trousers or shorts, open at waist and hems.

    A seam runs down the centre of front and back and meets the inner seams at the crotch.

    Raises:
        ValueError: If the measures contradict each other.
    """
    half = parameters.leg_angle_difference / 2
    legs = {
        hand: LegPattern(parameters, angle=parameters.leg_angle - sign * half)
        for hand, sign in _HANDS.items()
    }
    curves: dict[str, Curve] = {}
    panels, exact = [], []
    for hand, sign in _HANDS.items():
        leg, mirror = legs[hand], np.array([sign, 1.0])
        corner, inner, outer = (f"{hand}_{n}" for n in ("waist_corner", "hem_inner", "hem_outer"))
        curves[f"{hand}_outseam"] = Curve(start=outer, end=corner, points=leg.outseam * mirror)
        curves[f"{hand}_inseam"] = Curve(start=inner, end="crotch", points=leg.inseam * mirror)
        for face, layer in _LAYERS.items():
            waist = leg.cut_waist(layer)
            middle = f"{face}_waist"
            mark = leg.get_map(layer).to_pattern(np.array([[0.0, _V_CENTRE]]))[0]
            rise, top = np.stack([leg.crotch, mark]), np.stack([mark, waist[-1]])
            centre = f"{face}_centre"
            curves[f"{face}_rise"] = Curve(start="crotch", end=centre, points=rise)
            curves[centre] = Curve(start=centre, end=middle, points=top)
            curves[f"{face}_{hand}_waist"] = Curve(start=corner, end=middle, points=waist * mirror)
            curves[f"{face}_{hand}_hem"] = Curve(start=inner, end=outer, points=leg.hem * mirror)
            exact += [(f"{face}_{hand}_waist", 1, 1.0), (f"{face}_{hand}_hem", 1, 0.0)]
            exact += [(f"{face}_centre", 0, 0.0), (f"{face}_rise", 0, 0.0)]
            edges = (f"{face}_{hand}_hem", f"{hand}_outseam", f"{face}_{hand}_waist")
            edges += (f"-{face}_centre", f"-{face}_rise", f"-{hand}_inseam")
            if sign < 0:  # mirrored, so walked the other way round
                edges = tuple(e[1:] if e[0] == "-" else f"-{e}" for e in reversed(edges))
            pins = {}
            if layer > 0:
                places = np.array(list(_PINNED.values()))
                points = leg.get_map(layer).to_pattern(places) * mirror
                pins = {f"{hand}_{n}": point for n, point in zip(_PINNED, points, strict=True)}
            panels.append(Panel(name=f"{face}_{hand}", layer=layer, edges=edges, pins=pins))
        exact.append((f"{hand}_outseam", 0, sign))

    def to_canonical(panel: str, points: np.ndarray) -> np.ndarray:
        face, hand = panel.split("_")
        mirror = np.array([_HANDS[hand], 1.0])
        return legs[hand].get_map(_LAYERS[face]).to_canonical(points * mirror) * mirror

    return Cut(
        curves=curves,
        panels=tuple(panels),
        to_canonical=to_canonical,
        exact=exact,
        landmarks=_collect_landmarks,
    )


def _collect_landmarks(surface: SewnSurface) -> dict[str, int]:
    landmarks = {"crotch": surface.junctions["crotch"], "centre": surface.junctions["front_centre"]}
    landmarks["waist_centre"] = surface.junctions["front_waist"]
    for hand in _HANDS:
        landmarks[f"{hand}_waist_corner"] = surface.junctions[f"{hand}_waist_corner"]
        for name in ("hem_inner", "hem_outer"):
            landmarks[f"{hand}_{name}_corner"] = surface.junctions[f"{hand}_{name}"]
    return landmarks
