"""Props with a level top: the platform that folded tops are stored on, and a table."""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np

from dgl_assets.props.meshes import FINISHES, assemble, make_part, make_wood
from dgl_assets.props.prop import Prop
from dgl_assets.props.shapes import Vector3, make_box
from dgl_assets.ranges import Measures, measure
from dgl_assets.robots._solids import Section, Solid, loft, rounded_box


@dataclass(frozen=True, kw_only=True)
class PlatformParameters(Measures):
    """A low board on a plinth.

    Source: the original code's figures: a box of 0.5 x 0.5 x 0.1 m, half of it below the ground.
    """

    width: float = measure(0.2, 1.5, 0.5)
    """Along x [m] (original code)."""
    depth: float = measure(0.2, 1.5, 0.5)
    """Along y [m] (original code)."""
    height: float = measure(0.03, 0.5, 0.05)
    """Of its top [m] (original code)."""
    wood: str = "ash"
    """One of `dgl_assets.props.WOODS`."""


@dataclass(frozen=True, kw_only=True)
class TableParameters(Measures):
    """A table with four tapered legs and aprons between them.

    Source: the original code's figures: 1.0 x 1.0 x 0.1 m, a solid box there.
    """

    width: float = measure(0.4, 2.4, 1.0)
    """Along x [m] (original code)."""
    depth: float = measure(0.4, 2.4, 1.0)
    """Along y [m] (original code)."""
    height: float = measure(0.08, 1.2, 0.1)
    """Of its top [m] (original code)."""
    wood: str = "oak"
    """One of `dgl_assets.props.WOODS`."""


def make_platform(p: PlatformParameters) -> Prop:
    """Make the platform of Store Tops; the target is the middle of its footprint."""
    x, y, h = p.width / 2, p.depth / 2, p.height
    plinth, inset = 0.35 * h, 0.012
    board = rounded_box("wood", (x, y, (h - plinth) / 2), (0, 0, (h + plinth) / 2), radius=0.003,
                        power=60.0, segments=64)  # fmt: skip
    below = rounded_box("black", (x - inset, y - inset, plinth / 2), (0, 0, plinth / 2),
                        radius=0.001, power=60.0, segments=64)  # fmt: skip
    return assemble(
        "platform",
        [
            make_part("board", board, make_wood(p.wood, seed=6)),
            make_part("plinth", below, FINISHES["black"]),
        ],
        [
            make_box((-x, -y, plinth), (x, y, h)),
            make_box((-x + inset, -y + inset, 0.0), (x - inset, y - inset, plinth)),
        ],
        {"target": (0.0, 0.0, 0.0), **_corners(x, y, h)},
        asdict(p),
    )


def make_table(p: TableParameters) -> Prop:
    """Make a table; the target is the middle of its top."""
    x, y, h = p.width / 2, p.depth / 2, p.height
    thick = min(0.028, 0.4 * h)
    below = h - thick
    apron, leg, inset = min(0.07, 0.4 * below), 0.027, 0.03
    top = rounded_box("wood", (x, y, thick / 2), (0, 0, h - thick / 2), radius=0.003, power=60.0,
                      segments=64)  # fmt: skip
    at = [(sx * (x - inset - leg), sy * (y - inset - leg)) for sx in (-1, 1) for sy in (-1, 1)]
    legs = [_taper(cx, cy, leg, below) for cx, cy in at]
    wall, ax, ay = 0.011, x - inset - leg, y - inset - leg
    low = below - apron
    beams = [((-ax + leg, s * ay - wall, low), (ax - leg, s * ay + wall, below)) for s in (-1, 1)]
    beams += [((s * ax - wall, -ay + leg, low), (s * ax + wall, ay - leg, below)) for s in (-1, 1)]
    aprons = [_make_beam(*beam) for beam in beams]
    wood = make_wood(p.wood, seed=7)
    return assemble(
        "table",
        [make_part("top", top, wood), make_part("frame", [*legs, *aprons], wood)],
        [
            make_box((-x, -y, below), (x, y, h)),
            *(make_box((cx - leg, cy - leg, 0.0), (cx + leg, cy + leg, below)) for cx, cy in at),
            *(make_box(*beam) for beam in beams),
        ],
        {"target": (0.0, 0.0, h), **_corners(x, y, h)},
        asdict(p),
    )


def _corners(x: float, y: float, h: float) -> dict[str, tuple[float, float, float]]:
    """Landmarks of a level top: its middle, and its corners as seen by the robots."""
    return {
        "top": (0.0, 0.0, h),
        "near_left": (-x, -y, h),
        "near_right": (x, -y, h),
        "far_left": (-x, y, h),
        "far_right": (x, y, h),
    }


def _make_beam(low: Vector3, high: Vector3) -> Solid:
    x, y, z = ((np.array(low) + high) / 2).tolist()
    half_x, half_y, half_z = ((np.array(high) - low) / 2).tolist()
    half = (half_x, half_y, half_z)
    return rounded_box("wood", half, (x, y, z), radius=0.001, power=40.0, segments=32)


def _taper(x: float, y: float, half: float, height: float) -> Solid:
    """Make a leg that is a little thinner at its foot."""
    foot = half - min(0.005, 0.06 * height)
    sections = [(0.0, foot - 0.001), (0.0015, foot), (0.6 * height, half - 0.0005), (height, half)]
    return loft("wood", [Section(z=z, hx=r, hy=r, cx=x, cy=y, power=24.0) for z, r in sections], 40)
