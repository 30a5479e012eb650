"""The bar that tops, dresses and trousers are hung over, and a coat hanger with a hook."""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from dgl_assets.props.meshes import FINISHES, assemble, make_part, make_wood, sweep
from dgl_assets.props.prop import Prop
from dgl_assets.props.shapes import PropShape, make_box, make_capsules
from dgl_assets.ranges import Measures, measure
from dgl_assets.robots._solids import along_x, cylinder, rounded_box

_TIP = 0.0145  # reach of a shoulder's rounding beyond the arms' middle line [m]
CABLE_TOP = 2.6
"""Height that cables hang from, above what the film's camera sees [m]."""


@dataclass(frozen=True, kw_only=True)
class HangerParameters(Measures):
    """A level bar on two thin cables; it leaves the floor free for the garment.

    Source: the original code's figures; its two floating columns of 0.1 m, which are picture
    only, are cables here.
    """

    length: float = measure(0.3, 1.5, 0.75)
    """Along x [m] (original code)."""
    thickness: float = measure(0.012, 0.06, 0.02)
    """Width and height of the bar's section [m] (original code)."""
    height: float = measure(0.3, 1.8, 0.80)
    """Height of the bar's middle [m] (original code)."""
    wood: str = "oak"
    """One of `dgl_assets.props.WOODS`."""


@dataclass(frozen=True, kw_only=True)
class CoatHangerParameters(Measures):
    """A wooden hanger with rounded shoulders, a trouser bar and a hook of wire.

    Not among the original's props. Sizes are those of ordinary hangers at 85 %, as the garments.
    """

    width: float = measure(0.26, 0.5, 0.38)
    """From shoulder to shoulder [m]."""
    drop: float = measure(0.03, 0.14, 0.075)
    """Fall of the shoulders below the neck [m]."""
    sweep: float = measure(0.0, 0.06, 0.022)
    """Bend of the shoulders to the front, -y [m]."""
    hook_radius: float = measure(0.012, 0.04, 0.021)
    """Inner radius of the hook [m]."""
    height: float = measure(0.4, 2.0, 1.0)
    """Height of the wire at the top of the hook's bend [m]."""
    wood: str = "beech"
    """One of `dgl_assets.props.WOODS`."""


def make_hanger(p: HangerParameters) -> Prop:
    """Make the bar of Hang Tops, Hang Dress and Hang Trousers; the target is its middle."""
    half, r, z = p.length / 2, p.thickness / 2, p.height
    bar = along_x(rounded_box("wood", (r, r, half - 0.012), radius=0.004, power=9.0, segments=32))
    caps = [
        along_x(rounded_box("brass", (r, r, 0.006), (0, 0, side * (half - 0.006)), radius=0.003,
                            power=9.0, segments=32))
        for side in (-1, 1)
    ]  # fmt: skip
    at = half - 0.025
    cable = cylinder("steel", 0.003, r, CABLE_TOP - z, segments=8)
    cables = [cable.shifted(side * at, 0.0, z) for side in (-1, 1)]
    ferrule = cylinder("brass", 0.0042, r, r + 0.022, bevel=0.0012, segments=16)
    ferrules = [ferrule.shifted(side * at, 0.0, z) for side in (-1, 1)]
    return assemble(
        "hanger",
        [
            make_part("bar", bar.shifted(z=z), make_wood(p.wood, seed=1)),
            make_part("caps", [cap.shifted(z=z) for cap in caps], FINISHES["brass"]),
            make_part("cables", cables, FINISHES["steel"], is_solid=False),
            make_part("ferrules", ferrules, FINISHES["brass"], is_solid=False),
        ],
        [make_box((-half, -r, z - r), (half, r, z + r))],
        {
            "target": (0.0, 0.0, z),
            "left_end": (-half, 0.0, z),
            "right_end": (half, 0.0, z),
            "top": (0.0, 0.0, z + r),
        },
        asdict(p),
    )


def make_coat_hanger(p: CoatHangerParameters) -> Prop:
    """Make a coat hanger; the target is its neck, from which the shoulders fall."""
    wire, stem = 0.0019, 0.034
    neck = p.height - 2 * wire - 2 * p.hook_radius - stem  # height of the arms' middle line
    arms, sizes = _bend_arms(p, neck)
    hook = _bend_hook(p.hook_radius + wire, stem, neck)
    half = p.width / 2
    bar_at, bar_z = 0.86 * half, neck - p.drop - 0.006
    ends = np.array([_find_on(arms, s * bar_at) for s in (-1, 1)])
    ends[:, 2] = bar_z
    trouser_bar = np.linspace(ends[0], ends[1], 9)
    tip = hook[-1]
    top = hook[np.argmax(hook[:, 2])]
    knots = np.linspace(0, len(arms) - 1, 13).round().astype(int)
    turns = np.unique(np.linspace(0, len(hook) - 1, 15).round().astype(int))
    shapes: list[PropShape] = [
        *make_capsules(arms[knots], sizes[knots].mean(axis=1)),
        *make_capsules(ends, 0.0055),
        *make_capsules(hook[turns], wire),
    ]
    wood = make_wood(p.wood, seed=2)
    collar = cylinder("brass", 0.005, neck + 0.011, neck + 0.0225, bevel=0.0015, segments=20)
    return assemble(
        "coat_hanger",
        [
            make_part("arms", sweep("wood", arms, sizes, segments=28), wood),
            make_part("bar", sweep("wood", trouser_bar, np.array([0.0055, 0.0055])), wood),
            make_part("hook", sweep("steel", hook, np.array([wire, wire]), up=(0, 1, 0),
                                    segments=14), FINISHES["steel"]),
            make_part("collar", collar, FINISHES["brass"]),
        ],
        shapes,
        {
            "target": (0.0, 0.0, neck),
            "neck": (0.0, 0.0, neck),
            "left_shoulder": tuple(arms[0]),
            "right_shoulder": tuple(arms[-1]),
            "hook_tip": tuple(tip),
            "hook_bend": (float(top[0]), 0.0, float(top[2]) - wire),
            "bar_centre": tuple(trouser_bar[4]),
        },
        asdict(p),
    )  # fmt: skip


def _bend_arms(p: CoatHangerParameters, neck: float) -> tuple[np.ndarray, np.ndarray]:
    """Middle line of the arms from left to right, and half sizes (front to back, up)."""
    t = np.linspace(-1.0, 1.0, 61)
    # Level at the neck, straight over the shoulders, rounder at the tips.
    fall = np.sqrt(t**2 + 0.05) - np.sqrt(0.05) + 0.16 * t**6
    fall *= p.drop / fall[-1]
    line = np.stack([(0.5 * p.width - _TIP) * t, -p.sweep * t**2, neck - fall], axis=1)
    broad = np.abs(t) ** 1.5
    deep = 0.0115 + 0.005 * broad
    high = 0.0165 - 0.0035 * broad
    return line, np.stack([deep, high], axis=1)


def _bend_hook(radius: float, stem: float, neck: float) -> np.ndarray:
    """Middle line of the wire: up from the neck, round to the right and over to the left."""
    centre = neck + stem + radius
    angle = np.radians(np.linspace(-42.0, 205.0, 22))
    arc = np.stack([radius * np.cos(angle), np.zeros(22), centre + radius * np.sin(angle)], axis=1)
    foot = np.array([[0, 0, neck], [0, 0, neck + 0.3 * stem], [0.0008, 0, neck + 0.72 * stem]])
    corners = np.vstack([foot, arc])
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1))])
    return CubicSpline(along, corners)(np.linspace(0.0, along[-1], 72))


def _find_on(line: np.ndarray, x: float) -> np.ndarray:
    return np.array([np.interp(x, line[:, 0], line[:, axis]) for axis in range(3)])
