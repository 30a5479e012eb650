"""Scarves: measures, making, and random ones.

A scarf is one layer of cloth that lies along x. Canonical coordinates: u from the left tip (-1) to the right tip (1), v from
the lower (0) to the upper (1) long edge; along an end |u| falls from 1 at its middle to 1 - `U_CORNER` at its corners,
whatever its shape. Its one layer counts as the front.

Landmarks: `left_end` and `right_end` (a little inside of the middle of the ends, where they are held), `left_tip` and
`right_tip` (the middle of the ends), `centre`, `left_quarter` and `right_quarter`, `lower_centre` and `upper_centre`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from dgl_assets.garments.assembly import Cut, assemble
from dgl_assets.garments.drawing import draw_until_valid, pick, span
from dgl_assets.garments.garment import Garment
from dgl_assets.garments.measures import check_choice, check_ranges
from dgl_assets.garments.sewing import Curve, Panel, SewnSurface
from dgl_assets.garments.shear import Knots, ShearMap

CATEGORY = "Scarf"

ScarfEnd = Literal["straight", "pointed", "rounded", "slanted"]

SCARF_RANGES: dict[str, tuple[float, float]] = {
    "length": (1.0, 1.6),
    "width": (0.18, 0.45),
    "waist": (0.5, 1.3),
    "end_depth": (0.0, 0.25),
    "bow": (-0.04, 0.04),
}
"""Smallest and largest accepted value of each measure, in its own unit."""

U_CORNER = 0.03
"""How far |u| falls along an end, so that no triangle in the corner of a pointed one lies on a line."""

_HELD = 0.93  # |u| of the landmarks `left_end` and `right_end`
_SAMPLES = 400


@dataclass(frozen=True, kw_only=True)
class ScarfParameters:
    """Measures of a scarf.

    Attributes:
        length: From tip to tip [m].
        width: Width at the ends [m].
        waist: Width at the middle relative to that at the ends.
        end: Shape of the ends.
        end_depth: How far pointed, rounded or slanted ends reach beyond their corners [m]; 0 for straight ones.
        bow: How far the middle lies beyond the line of the ends, towards +y [m]: no scarf lies perfectly.
    """

    length: float = 1.35
    width: float = 0.30
    waist: float = 1.0
    end: ScarfEnd = "straight"
    end_depth: float = 0.0
    bow: float = 0.0

    def __post_init__(self) -> None:
        check_ranges(self, SCARF_RANGES)
        check_choice("end", self.end, ("straight", "pointed", "rounded", "slanted"))
        if (self.end == "straight") != (self.end_depth == 0):
            raise ValueError(
                f"end_depth must be 0 for straight ends and positive for others; got {self.end_depth} "
                f"for {self.end!r}"
            )
        if self.end_depth > 0.62 * self.width:
            raise ValueError(
                f"end_depth must be at most 0.62 of the width ({self.width}), or the tips are too "
                f"sharp; got {self.end_depth}"
            )


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
        """Long edge from the left to the right corner [m], shape (N, 2): the upper one for sign +1."""
        v = np.array([1.0 if sign > 0 else 0.0])
        start, end = self._evaluate_end(v, -1)[0], self._evaluate_end(v, 1)[0]
        x = np.concatenate(
            [np.linspace(start, 0, _SAMPLES + 1), np.linspace(0, end, _SAMPLES + 1)[1:]]
        )
        return np.stack([x, self._columns(x)[0][:, 1 if sign > 0 else 0]], axis=1)

    def cut_end(self, sign: int) -> np.ndarray:
        """Half ends: lower corner to tip, and tip to upper corner, of the left (-1) or right (+1) end [m]."""
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


def make_scarf(
    parameters: ScarfParameters,
    *,
    spacing: float | None = None,
    name: str = "scarf",
) -> Garment:
    """Make a scarf of one layer.

    Args:
        parameters: Measures.
        spacing: Target edge length [m], 0.006 to 0.025; None for 13 mm, adapted to small and large scarves.
        name: Name of the garment.

    Returns:
        One panel with one outline.

    Raises:
        ValueError: If spacing is out of range.
        MeshingError: If the panel cannot be filled at this spacing.
    """
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

    cut = Cut(
        curves=curves,
        panels=(Panel(name="front", layer=1, edges=edges, pins=pins),),
        to_canonical=lambda _, points: pattern.map.to_canonical(points),
        exact=exact,
        landmarks=collect,
    )
    return assemble(
        cut, name=name, category=CATEGORY, parameters=parameters, spacing=spacing, layer_gap=0.0
    )


def sample_scarf(rng: np.random.Generator | int) -> ScarfParameters:
    """Draw the measures of a random scarf of 1.2 to 1.5 m x 0.2 to 0.4 m.

    Args:
        rng: Generator, advanced by this call, or a seed.
    """
    return draw_until_valid(rng, _draw, lambda _: None)


def _draw(rng: np.random.Generator) -> ScarfParameters:
    end = pick(rng, {"straight": 0.45, "pointed": 0.2, "rounded": 0.2, "slanted": 0.15})
    width = span(rng, 0.2, 0.4)
    depth = {
        "straight": (0.0, 0.0),
        "pointed": (0.2, 0.6),
        "rounded": (0.15, 0.5),
        "slanted": (0.15, 0.5),
    }
    is_shaped = rng.random() < 0.4
    return ScarfParameters(
        length=span(rng, 1.2, 1.5),
        width=width,
        waist=span(rng, 0.6, 1.15) if is_shaped else span(rng, 0.97, 1.03),
        end=end,  # type: ignore[arg-type]
        end_depth=width * span(rng, *depth[end]),
        bow=float(np.clip(rng.normal(0.0, 0.008), -0.025, 0.025)),
    )
