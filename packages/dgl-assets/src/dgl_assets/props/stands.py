"""Props that carry garments: the hook for coats, the stand for hats, the fork for gloves."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from itertools import pairwise

import numpy as np
from scipy.interpolate import PchipInterpolator

from dgl_assets.props.hanger import CABLE_TOP
from dgl_assets.props.meshes import FINISHES, assemble, make_part, make_wood
from dgl_assets.props.prop import Prop
from dgl_assets.props.shapes import PropShape, make_box, make_cylinder
from dgl_assets.ranges import Measures, measure
from dgl_assets.robots._solids import (
    along_x,
    along_y,
    cylinder,
    rounded_box,
    turn,
)

_POST_LOW, _POST_HIGH = 0.3, 1.1  # of the pothook (original code) [m]


@dataclass(frozen=True, kw_only=True)
class PothookParameters(Measures):
    """An arm with a cross-bar that reaches out of a post, as a coat rack's hook.

    The post ends above the floor, where the garment lies; it hangs from a thin rod, which is
    picture only. Source: the original code's figures; its post is picture only, too.
    """

    height: float = measure(0.5, 1.8, 1.0)
    """Height of arm and cross-bar [m] (original code)."""
    reach: float = measure(0.1, 0.4, 0.20)
    """Length of the arm [m] (original code)."""
    bar_length: float = measure(0.04, 0.3, 0.12)
    """Of the cross-bar, along x [m] (original code)."""
    thickness: float = measure(0.012, 0.05, 0.025)
    """Of arm and cross-bar [m] (original code)."""
    post: float = measure(0.03, 0.1, 0.05)
    """Width of the post [m] (original code)."""
    wood: str = "walnut"
    """One of `dgl_assets.props.WOODS`."""


@dataclass(frozen=True, kw_only=True)
class HatStandParameters(Measures):
    """A turned stand: foot, column, a seat for the rim of a hat and a dome inside of its crown.

    Source: the original code's figures for the seat's height and the column's width. Its hats lie
    on an invisible plate of 0.5 m; here the seat carries them and leaves the brim free.
    """

    height: float = measure(0.2, 1.6, 0.6)
    """Of the seat [m] (original code)."""
    column: float = measure(0.03, 0.12, 0.07)
    """Largest width of the column [m] (original code)."""
    seat_radius: float = measure(0.04, 0.2, 0.082)
    """[m]."""
    dome_radius: float = measure(0.02, 0.12, 0.056)
    """Of the dome at the seat [m], less than that of the seat."""
    dome_height: float = measure(0.01, 0.15, 0.05)
    """Above the seat [m]."""
    foot_radius: float = measure(0.06, 0.3, 0.14)
    """[m]."""
    wood: str = "cherry"
    """One of `dgl_assets.props.WOODS`."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.dome_radius < self.seat_radius:
            text = f"dome_radius must be less than seat_radius {self.seat_radius}"
            raise ValueError(f"{text}; got {self.dome_radius}")


@dataclass(frozen=True, kw_only=True)
class GloveStandParameters(Measures):
    """A post with two upright boards that clamp a glove, which stands between them, open above."""

    height: float = measure(0.2, 1.5, 0.5)
    """Of the boards' upper side [m]."""
    gap: float = measure(0.002, 0.1, 0.013)
    """Between the boards, along x [m]."""
    length: float = measure(0.1, 0.4, 0.2)
    """Of the boards, along y [m]."""
    depth: float = measure(0.01, 0.1, 0.04)
    """Of the boards, along z [m]."""
    thickness: float = measure(0.004, 0.02, 0.01)
    """Of the boards, along x [m]."""
    foot_radius: float = measure(0.06, 0.3, 0.09)
    """[m]."""
    wood: str = "maple"
    """One of `dgl_assets.props.WOODS`."""


def make_pothook(p: PothookParameters) -> Prop:
    """Make the hook of Hang Coat; the target is the middle of the cross-bar."""
    r, z, w = p.thickness / 2, p.height, p.post / 2
    near, far = -0.01, p.reach - 0.01  # ends of the arm in y
    middle = p.reach + 0.015  # of the post
    arm = along_y(rounded_box("wood", (r, r, (far - near) / 2), radius=0.003, power=9, segments=32))
    bar = along_x(rounded_box("wood", (r, r, p.bar_length / 2), radius=0.003, power=9, segments=32))
    shift = z - 1.0
    low, high = _POST_LOW + shift, _POST_HIGH + shift
    post = rounded_box("wood", (w, w, (high - low) / 2), (0, middle, (low + high) / 2),
                       radius=0.008, power=9, segments=32)  # fmt: skip
    plate = along_y(cylinder("brass", 1.6 * r, 0.0, 0.006, bevel=0.0015, segments=32))
    rod = cylinder("steel", 0.004, high - 0.001, CABLE_TOP, segments=12)
    ferrule = cylinder("brass", 0.011, high, high + 0.02, bevel=0.002, segments=24)
    wood = make_wood(p.wood, seed=3)
    return assemble(
        "pothook",
        [
            make_part("arm", arm.shifted(0.0, (near + far) / 2, z), wood),
            make_part("cross_bar", bar.shifted(0.0, 0.0, z), wood),
            make_part("post", post, wood),
            make_part("plate", plate.shifted(0.0, middle - w - 0.006, z), FINISHES["brass"],
                      is_solid=False),
            make_part("rod", rod.shifted(0.0, middle, 0.0), FINISHES["steel"], is_solid=False),
            make_part("ferrule", ferrule.shifted(0.0, middle, 0.0), FINISHES["brass"],
                      is_solid=False),
        ],
        [
            make_box((-r, near, z - r), (r, far, z + r)),
            make_box((-p.bar_length / 2, -r, z - r), (p.bar_length / 2, r, z + r)),
            make_box((-w, middle - w, low), (w, middle + w, high)),
        ],
        {
            "target": (0.0, 0.0, z),
            "left_end": (-p.bar_length / 2, 0.0, z),
            "right_end": (p.bar_length / 2, 0.0, z),
            "top": (0.0, 0.0, z + r),
            "arm_end": (0.0, far, z),
        },
        asdict(p),
    )  # fmt: skip


def make_hat_stand(p: HatStandParameters) -> Prop:
    """Make the stand of Wear Baseball Cap and Wear Bowl Hat; the target is the seat's middle."""
    h, c, f, s = p.height, p.column / 2, p.foot_radius, p.seat_radius
    thick, foot = 0.016, 0.026
    # The column: a ring at the foot, a belly, a waist and a collar below the seat.
    rise = h - thick - foot
    share = np.array([0.0, 0.03, 0.075, 0.27, 0.55, 0.84, 0.905, 0.925, 0.955, 0.975, 1.0])
    width = np.array([0.9, 0.9, 0.62, 1.0, 0.78, 0.56, 0.56, 0.84, 0.84, 0.62, 0.62])
    heights = np.linspace(0.0, 1.0, 100)
    radii = c * PchipInterpolator(share, width)(heights)
    column = turn("wood", [(0.0, foot - 0.002), *zip(radii, foot + rise * heights, strict=True),
                           (0.0, h - thick + 0.002)], 40)  # fmt: skip
    base = turn("wood", [(0.0, 0.0), (f - 0.004, 0.0), (f, 0.004), (f, 0.016), (f - 0.003, 0.0195),
                         (f - 0.012, 0.0215), (f - 0.02, foot), (0.0, foot)], 64)  # fmt: skip
    seat = turn("wood", [(0.0, h - thick), (s - 0.006, h - thick), (s, h - thick + 0.006),
                         (s, h - 0.006), (s - 0.002, h - 0.002), (s - 0.006, h), (0.0, h)],
                48)  # fmt: skip
    bow = np.linspace(0.0, np.pi / 2, 12)
    profile = [(p.dome_radius * np.cos(a), h + p.dome_height * np.sin(a)) for a in bow[:-1]]
    dome = turn("pad", [(0.0, h - 0.001), *profile, (0.0, h + p.dome_height)], 40)
    bounds = [0.0, 0.035, 0.06, 0.1, 0.17, 0.4, 0.55, 0.7, 0.91, 0.97, 1.0]
    shapes: list[PropShape] = [make_cylinder(f, 0.0, foot), make_cylinder(s, h - thick, h)]
    for a, b in pairwise(bounds):
        inside = radii[(heights >= a - 1e-9) & (heights <= b + 1e-9)]
        shapes.append(make_cylinder(float(inside.mean()), foot + rise * a, foot + rise * b))
    hull = turn("pad", [*profile[::2], (0.0, h + p.dome_height)], 24)  # PhysX takes 255 points
    shapes.append(PropShape(kind="convex", points=np.unique(hull.vertices, axis=0)))
    wood = make_wood(p.wood, seed=4)
    return assemble(
        "hat_stand",
        [
            make_part("stand", [base, column, seat], wood),
            make_part("dome", dome, make_wood("maple", seed=5)),
        ],
        shapes,
        {
            "target": (0.0, 0.0, h),
            "seat": (0.0, 0.0, h),
            "top": (0.0, 0.0, h + p.dome_height),
        },
        asdict(p),
    )


def make_glove_stand(p: GloveStandParameters) -> Prop:
    """Make the stand of Wear Glove; the target is in the middle between the boards, at their top.

    The other landmark is "foot", on the ground below.
    """
    half, low, h = p.length / 2, p.height - p.depth, p.height
    inner, outer, foot, f = p.gap / 2, p.gap / 2 + p.thickness, 0.02, p.foot_radius
    behind = half + outer  # of the post
    sizes = (p.thickness / 2, half, p.depth / 2)
    board = rounded_box("wood", sizes, (0, 0, low + p.depth / 2), radius=0.002, power=9,
                        segments=32)  # fmt: skip
    boards = [board.shifted(side * (inner + outer) / 2, 0.0, 0.0) for side in (-1, 1)]
    post = rounded_box("wood", (outer, outer, (h - foot) / 2), (0, behind, (h + foot) / 2),
                       radius=0.003, power=9, segments=32)  # fmt: skip
    base = cylinder("wood", f, 0.0, foot, bevel=0.004, segments=64)
    disc = PropShape(kind="cylinder", radius=f, half_length=foot / 2, xyz=(0.0, behind, foot / 2))
    wood = make_wood(p.wood, seed=7)
    return assemble(
        "glove_stand",
        [
            make_part("boards", boards, wood),
            make_part("post", post, wood),
            make_part("foot", base.shifted(0.0, behind, 0.0), wood),
        ],
        [
            make_box((-outer, -half, low), (-inner, half, h)),
            make_box((inner, -half, low), (outer, half, h)),
            make_box((-outer, half, foot), (outer, behind + outer, h)),
            disc,
        ],
        {"target": (0.0, 0.0, h), "foot": (0.0, 0.0, 0.0)},
        asdict(p),
    )
