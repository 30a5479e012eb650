"""Make long-sleeved tops: cut the pattern, sew it, lay it flat.

Landmarks, all exact correspondences: `cuff` (inside the cuff, upper layer), `cuff_upper`, `cuff_lower`, `armpit`,
`hem_corner`, `neck_side` (highest point of the shoulder), `shoulder` (inside the shoulder point), `sleeve_joint` (upper
sleeve, just outside the armhole), `upper_chest` and `hem` (inside the hem corner), each with `left_` or `right_`;
`centre`, `hem_centre`, and `collar`, on the back layer below the neckline: seen through the neck, unless the top has a
standing collar, which covers it.
"""

from __future__ import annotations

from dataclasses import asdict

import numpy as np

from dgl_assets.garments.garment import Garment
from dgl_assets.garments.meshing import compute_segment_distances, resample_polyline
from dgl_assets.garments.sewing import Panel, Seam, SewnSurface, sew_panels
from dgl_assets.garments.tops.parameters import TopParameters
from dgl_assets.garments.tops.pattern import U_NECK, V_ARMPIT, TopPattern

CATEGORY = "Tops_LongSleeve"

_LAYERS = {"front": 1, "back": -1}
_BLEND_ROWS = 3.5  # spacings from a seam over which a layer rises to its height

_CUFF_V = (1 + V_ARMPIT) / 2
_PINNED: dict[str, tuple[float, float, int]] = {
    "left_cuff": (-1.93, _CUFF_V, 1),
    "right_cuff": (1.93, _CUFF_V, 1),
    "left_shoulder": (-0.91, 0.93, 1),
    "right_shoulder": (0.91, 0.93, 1),
    "left_sleeve_joint": (-1.06, 0.86, 1),
    "right_sleeve_joint": (1.06, 0.86, 1),
    "left_upper_chest": (-0.70, 0.82, 1),
    "right_upper_chest": (0.70, 0.82, 1),
    "centre": (0.0, 0.42, 1),
    "collar": (0.0, 0.925, -1),
    "left_hem": (-0.76, 0.11, 1),
    "right_hem": (0.76, 0.11, 1),
}
"""Canonical (u, v, side) of landmarks inside the panels, after the demonstration points of the paper's fold, fling and
hang tasks."""

_JUNCTION_LANDMARKS = ("cuff_upper", "cuff_lower", "armpit", "hem_corner")


def make_top(
    parameters: TopParameters,
    *,
    spacing: float = 0.013,
    layer_gap: float = 0.012,
    name: str = "top",
) -> Garment:
    """Make a long-sleeved top.

    Args:
        parameters: Measures.
        spacing: Target edge length [m], 0.006 to 0.025.
        layer_gap: Distance between the two layers while it lies flat [m], 0 to 0.03. They meet at the seams.
        name: Name of the garment.

    Returns:
        One welded surface with four openings: neck, hem and both cuffs.

    Raises:
        ValueError: If the measures contradict each other, or spacing or gap are out of range.
        MeshingError: If a panel cannot be filled at this spacing.
    """
    if not 0.006 <= spacing <= 0.025:
        raise ValueError(f"spacing must be in [0.006, 0.025] m; got {spacing}")
    if not 0.0 <= layer_gap <= 0.03:
        raise ValueError(f"layer_gap must be in [0, 0.03] m; got {layer_gap}")
    pattern = TopPattern(parameters)
    seams = _cut_seams(pattern, parameters, spacing=spacing)
    surface = sew_panels(seams, _cut_panels(pattern, parameters), spacing=spacing)

    low, high = surface.flat.min(axis=0), surface.flat.max(axis=0)
    flat = (surface.flat - (low + high) / 2).astype(np.float32)
    height = _compute_heights(surface, seams, spacing=spacing, layer_gap=layer_gap)
    return Garment(
        name=name,
        category=CATEGORY,
        vertices=np.column_stack([flat, height]).astype(np.float32),
        faces=surface.faces,
        rest_vertices=flat,
        canonical=_compute_canonical(surface, pattern),
        face_panels=surface.face_panels,
        panels=surface.panels,
        landmarks=_collect_landmarks(surface),
        parameters={key: float(value) for key, value in asdict(parameters).items()},
    )


def _cut_seams(pattern: TopPattern, p: TopParameters, *, spacing: float) -> dict[str, Seam]:
    seams: dict[str, Seam] = {}

    def cut(name: str, start: str, end: str, curve: np.ndarray, *, is_even: bool = False) -> None:
        length = np.linalg.norm(np.diff(curve, axis=0), axis=1).sum()
        count = max(2, round(length / spacing))
        if is_even:  # a vertex at the centre
            count = max(2, 2 * round(length / spacing / 2))
        seams[name] = Seam(start=start, end=end, points=resample_polyline(curve, count))

    for hand, sign in (("left", -1.0), ("right", 1.0)):
        mirror = np.array([sign, 1.0])
        sleeve = pattern.left if sign < 0 else pattern.right
        shoulder, collar = pattern.cut_shoulder(sleeve)
        base = f"{hand}_neck_base" if p.collar_height > 0 else f"{hand}_neck"
        cut(f"{hand}_side", f"{hand}_hem_corner", f"{hand}_armpit", pattern.side * mirror)
        cut(f"{hand}_shoulder", f"{hand}_shoulder", base, shoulder * mirror)
        if p.collar_height > 0:
            cut(f"{hand}_collar", base, f"{hand}_neck", collar * mirror)
        cut(f"{hand}_upper", f"{hand}_shoulder", f"{hand}_cuff_upper", sleeve.upper * mirror)
        cut(f"{hand}_underarm", f"{hand}_armpit", f"{hand}_cuff_lower", sleeve.underarm * mirror)
        for face in _LAYERS:
            armhole = sleeve.armhole * mirror
            cut(f"{face}_{hand}_armhole", f"{hand}_shoulder", f"{hand}_armpit", armhole)
            cuff = sleeve.cuff * mirror
            cut(f"{face}_{hand}_cuff", f"{hand}_cuff_upper", f"{hand}_cuff_lower", cuff)
    for face, layer in _LAYERS.items():
        cut(f"{face}_hem", "left_hem_corner", "right_hem_corner", pattern.cut_hem(), is_even=True)
        cut(f"{face}_neck", "right_neck", "left_neck", pattern.cut_neck(layer), is_even=True)
    return seams


def _cut_panels(pattern: TopPattern, p: TopParameters) -> tuple[Panel, ...]:
    pins = {}
    for name, (u, v, side) in _PINNED.items():
        pins[name] = pattern.to_pattern(np.array([[u, v]]), layer=side)[0]
    panels = []
    for face, layer in _LAYERS.items():
        collars = ("right_collar",), ("-left_collar",)
        (right_collar, left_collar) = collars if p.collar_height > 0 else ((), ())
        body = (
            f"{face}_hem",
            "right_side",
            f"-{face}_right_armhole",
            "right_shoulder",
            *right_collar,
            f"{face}_neck",
            *left_collar,
            "-left_shoulder",
            f"{face}_left_armhole",
            "-left_side",
        )
        panels.append(
            Panel(name=f"{face}_body", layer=layer, edges=body, pins=_choose(pins, layer, "body"))
        )
        for hand in ("left", "right"):
            edges = (
                f"{hand}_underarm",
                f"-{face}_{hand}_cuff",
                f"-{hand}_upper",
                f"{face}_{hand}_armhole",
            )
            if hand == "left":  # mirrored, so walked the other way round
                edges = tuple(
                    edge.removeprefix("-") if edge.startswith("-") else f"-{edge}"
                    for edge in reversed(edges)
                )
            panel_pins = _choose(pins, layer, f"{hand}_sleeve")
            panels.append(
                Panel(name=f"{face}_{hand}_sleeve", layer=layer, edges=edges, pins=panel_pins)
            )
    return tuple(panels)


def _choose(pins: dict[str, np.ndarray], layer: int, part: str) -> dict[str, np.ndarray]:
    low, high = {"left_sleeve": (-2, -1), "body": (-1, 1), "right_sleeve": (1, 2)}[part]
    return {
        name: point
        for name, point in pins.items()
        if _PINNED[name][2] == layer and low < _PINNED[name][0] < high
    }


def _compute_heights(
    surface: SewnSurface, seams: dict[str, Seam], *, spacing: float, layer_gap: float
) -> np.ndarray:
    """Height of each vertex [m], shape (V,): smooth from 0 at the seams to half the gap inside."""
    joined = [seam.points for name, seam in seams.items() if not name.startswith(tuple(_LAYERS))]
    start = np.concatenate([points[:-1] for points in joined])
    end = np.concatenate([points[1:] for points in joined])
    distances = compute_segment_distances(surface.flat, start, end)
    share = np.clip(distances / (_BLEND_ROWS * spacing), 0.0, 1.0)
    return surface.layers * (layer_gap / 2) * share**2 * (3 - 2 * share)


def _compute_canonical(surface: SewnSurface, pattern: TopPattern) -> np.ndarray:
    canonical = np.zeros((len(surface.flat), 3))
    for part in ("left_sleeve", "right_sleeve", "body"):  # the body last: armholes are its own
        for face, layer in _LAYERS.items():
            index = surface.panels.index(f"{face}_{part}")
            ids = np.unique(surface.faces[surface.face_panels == index])
            canonical[ids, :2] = pattern.to_canonical(surface.flat[ids], part=part, layer=layer)
    # Resampled seams lie on chords, micrometres off their curves; their coordinate is known exactly.
    for name, ids in surface.seams.items():
        sign = -1.0 if "left" in name else 1.0
        if name.endswith("hem"):
            canonical[ids, 1] = 0.0
        elif name.endswith(("shoulder", "upper")):
            canonical[ids, 1] = 1.0
        elif name.endswith("underarm"):
            canonical[ids, 1] = V_ARMPIT
        if name.endswith(("armhole", "side")):
            canonical[ids, 0] = sign
        elif name.endswith("collar"):
            canonical[ids, 0] = sign * U_NECK
        elif name.endswith("cuff"):
            canonical[ids, 0] = 2 * sign
    canonical[:, 2] = surface.layers
    return canonical.astype(np.float32)


def _collect_landmarks(surface: SewnSurface) -> dict[str, int]:
    landmarks = {name: surface.pins[name] for name in _PINNED}
    for hand in ("left", "right"):
        for name in _JUNCTION_LANDMARKS:
            landmarks[f"{hand}_{name}"] = surface.junctions[f"{hand}_{name}"]
        # The highest point of the shoulder; with a collar it is not on the opening.
        landmarks[f"{hand}_neck_side"] = surface.seams[f"{hand}_shoulder"][-1].item()
    hem = surface.seams["front_hem"]
    landmarks["hem_centre"] = int(hem[len(hem) // 2])
    return landmarks
