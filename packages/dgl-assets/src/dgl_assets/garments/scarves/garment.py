"""Scarves: measures, cut, and random ones.

A scarf is one layer of cloth that lies along x and counts as the front. Canonical coordinates: u
from the left tip (-1) to the right tip (1), v from the lower (0) to the upper (1) long edge; along
an end of any shape |u| falls from 1 at its middle to 1 - `U_CORNER` at its corners.

Landmarks: `left_end` and `right_end` (grasp points just inside of the middle of the ends),
`left_tip` and `right_tip` (the middle of the ends), `centre`, `left_quarter` and `right_quarter`,
`lower_centre` and `upper_centre`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from dgl_assets.garments.assembly import Cut
from dgl_assets.garments.drawing import pick, span
from dgl_assets.garments.sewing import Curve, Panel, SewnSurface
from dgl_assets.garments.shear import Knots, ShearMap
from dgl_assets.garments.sizes import Sizes
from dgl_assets.ranges import Measures, check_choice, check_limit, measure

CATEGORY = "Scarf"

ScarfEnd = Literal["straight", "pointed", "rounded", "slanted"]

U_CORNER = 0.03
"""Fall of |u| along an end; keeps the (u, v) area of triangles in pointed corners above 0."""

_HELD = 0.93  # |u| of the landmarks `left_end` and `right_end`
_SAMPLES = 400


@dataclass(frozen=True, kw_only=True)
class ScarfParameters(Measures):
    """Measures of a scarf."""

    length: float = measure(1.0, 1.6, 1.35)
    """From tip to tip [m]."""
    width: float = measure(0.18, 0.45, 0.30)
    """Width at the ends [m]."""
    waist: float = measure(0.5, 1.3, 1.0)
    """Width at the middle relative to that at the ends."""
    end: ScarfEnd = "straight"
    """Shape of the ends."""
    end_depth: float = measure(0.0, 0.25, 0.0)
    """Reach of pointed, rounded or slanted ends beyond their corners [m]; 0 for straight ones."""
    bow: float = measure(-0.04, 0.04, 0.0)
    """Offset of the middle from the line of the ends, towards +y [m]: no scarf lies perfectly."""

    def __post_init__(self) -> None:
        super().__post_init__()
        check_choice("end", self.end, ("straight", "pointed", "rounded", "slanted"))
        if (self.end == "straight") != (self.end_depth == 0):
            raise ValueError(
                "end_depth must be 0 for straight ends and positive for others; got "
                f"{self.end_depth} for {self.end!r}"
            )
        formula = "0.62 of the width, or the tips are too sharp,"
        check_limit("end_depth", self.end_depth, formula, most=0.62 * self.width)


class ScarfPattern:
    """The outline of a scarf, and its canonical map.

    Pattern frame: metres, x along the scarf with 0 at its middle, y across.

    Args:
        parameters: Measures.
    """

    def __init__(self, parameters: ScarfParameters) -> None:
        self._p = parameters
        self.map = ShearMap(columns=self._columns, rows=self._rows)

    def cut_edge(self, sign: int) -> np.ndarray:
        """Lower (-1) or upper (+1) long edge from left to right [m], shape (N, 2)."""
        v = np.array([1.0 if sign > 0 else 0.0])
        start, end = self._evaluate_end(v, -1)[0], self._evaluate_end(v, 1)[0]
        x = np.concatenate(
            [np.linspace(start, 0, _SAMPLES + 1), np.linspace(0, end, _SAMPLES + 1)[1:]]
        )
        return np.stack([x, self._columns(x)[0][:, 1 if sign > 0 else 0]], axis=1)

    def cut_end(self, sign: int) -> np.ndarray:
        """Left (-1) or right (+1) end from the lower over the tip to the upper corner [m]."""
        v = np.linspace(0.0, 1.0, 2 * _SAMPLES + 1)
        x = self._evaluate_end(v, sign)
        heights, _ = self._columns(x)
        return np.stack([x, heights[:, 0] + v * (heights[:, 1] - heights[:, 0])], axis=1)

    def _evaluate_end(self, v: np.ndarray, sign: int) -> np.ndarray:
        p, offset = self._p, np.abs(2 * v - 1)
        if p.end == "pointed":
            fall = offset
        elif p.end == "rounded":
            fall = 1 - np.sqrt(1 - 0.97 * offset**2)
        elif p.end == "slanted":
            fall = 1 - v if sign > 0 else v
        else:
            fall = np.zeros(len(v))
        return sign * (p.length / 2 - p.end_depth * fall)

    def _columns(self, x: np.ndarray) -> Knots:
        p = self._p
        share = np.clip(2 * x / p.length, -1.0, 1.0)
        bend = np.cos(math.pi / 2 * share) ** 2
        half = p.width / 2 * (1 + (p.waist - 1) * bend)
        middle = p.bow * bend
        return np.stack([middle - half, middle + half], axis=1), np.tile([0.0, 1.0], (len(x), 1))

    def _rows(self, v: np.ndarray) -> Knots:
        ends = [self._evaluate_end(v, -1), np.zeros(len(v)), self._evaluate_end(v, 1)]
        u = 1 - U_CORNER * np.abs(2 * v - 1)
        return np.stack(ends, axis=1), np.stack([-u, np.zeros(len(v)), u], axis=1)


def cut_scarf(parameters: ScarfParameters) -> Cut:
    """Cut a scarf of one panel with one outline."""
    pattern = ScarfPattern(parameters)
    curves, exact = {}, []
    for edge, sign in (("lower", -1), ("upper", 1)):
        points = pattern.cut_edge(sign)
        for part, half in (("left", points[: _SAMPLES + 1]), ("right", points[_SAMPLES:][::-1])):
            name_ = f"{edge}_{part}"
            curves[name_] = Curve(start=f"{part}_{edge}", end=f"{edge}_centre", points=half)
            exact.append((name_, 1, float(sign > 0)))
    for hand, sign in (("left", -1), ("right", 1)):
        points = pattern.cut_end(sign)
        for edge, half in (("lower", points[: _SAMPLES + 1]), ("upper", points[_SAMPLES:][::-1])):
            name_ = f"{hand}_{edge}_end"
            curves[name_] = Curve(start=f"{hand}_{edge}", end=f"{hand}_tip", points=half)
    edges = ("lower_left", "-lower_right", "right_lower_end", "-right_upper_end")
    edges += ("upper_right", "-upper_left", "left_upper_end", "-left_lower_end")
    places = {"centre": 0.0, "left_quarter": -0.5, "right_quarter": 0.5}
    places |= {"left_end": -_HELD, "right_end": _HELD}
    pins = {
        landmark: pattern.map.to_pattern(np.array([[u, 0.5]]))[0] for landmark, u in places.items()
    }

    def collect(surface: SewnSurface) -> dict[str, int]:
        names = ("left_tip", "right_tip", "lower_centre", "upper_centre")
        return {landmark: surface.junctions[landmark] for landmark in names}

    return Cut(
        curves=curves,
        panels=(Panel(name="front", layer=1, edges=edges, pins=pins),),
        to_canonical=lambda _, points: pattern.map.to_canonical(points),
        exact=exact,
        landmarks=collect,
    )


def draw_scarf(rng: np.random.Generator, _: Sizes) -> ScarfParameters:
    """Draw a scarf, 1.2 to 1.5 m by 0.2 to 0.4 m; the robots reach all sizes."""
    end = pick(rng, {"straight": 0.45, "pointed": 0.2, "rounded": 0.2, "slanted": 0.15})
    width = span(rng, 0.2, 0.4)
    depth = {"straight": (0.0, 0.0), "pointed": (0.2, 0.6)}
    is_shaped = rng.random() < 0.4
    return ScarfParameters(
        length=span(rng, 1.2, 1.5),
        width=width,
        waist=span(rng, 0.6, 1.15) if is_shaped else span(rng, 0.97, 1.03),
        end=end,  # type: ignore[arg-type]
        end_depth=width * span(rng, *depth.get(end, (0.15, 0.5))),
        bow=float(np.clip(rng.normal(0.0, 0.008), -0.025, 0.025)),
    )
