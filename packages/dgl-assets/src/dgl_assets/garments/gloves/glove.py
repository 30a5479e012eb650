"""Make five-fingered gloves: cut the pattern, sew it, give it its round cross-section.

Landmarks are exact correspondences: `thumb_tip`, `index_tip`, `middle_tip`, `ring_tip`,
`little_tip`; `thumb_crotch`, `index_middle_crotch`, `middle_ring_crotch`, `ring_little_crotch`;
`index_knuckle` and `little_knuckle` at the sides of the hand, `thumb_heel` at the wrist side of the
thumb; `wrist_thumb_side`, `wrist_little_side` (the corners of the opening), `wrist_back`,
`wrist_palm` (the middles of its edges); `back_centre`, `palm_centre`.
"""

from __future__ import annotations

from dataclasses import asdict, replace

import numpy as np

from dgl_assets.errors import MeshingError
from dgl_assets.garments.garment import Garment
from dgl_assets.garments.gloves.parameters import GloveParameters
from dgl_assets.garments.gloves.pattern import (
    DIGITS,
    FINGERS,
    V_THUMB,
    V_WEB,
    V_WRIST,
    GlovePattern,
)
from dgl_assets.garments.gloves.relief import GloveRelief
from dgl_assets.garments.gloves.seam_edges import open_seams
from dgl_assets.garments.meshing import resample_polyline
from dgl_assets.garments.sewing import Panel, Seam, SewnSurface, sew_panels
from dgl_assets.garments.wall import find_folds

CATEGORY = "Glove"
SPACING = 0.0118
"""Default edge length [m]; the reason is in the README."""

_LAYERS = {"back": 1, "palm": -1}
"""The back of the hand is the upper layer."""
_CORNERS = {  # ends of each digit's base: little side of fingers, wrist side of the thumb first
    "thumb": ("thumb_heel", "thumb_crotch"),
    "index": ("index_inner", "index_knuckle"),
    "middle": ("middle_inner", "index_middle_crotch"),
    "ring": ("ring_inner", "middle_ring_crotch"),
    "little": ("little_knuckle", "ring_little_crotch"),
}
_WEBS = (("little", "ring"), ("ring", "middle"), ("middle", "index"))
_NO_LANDMARKS = ("thumb_inner", "index_inner", "middle_inner", "ring_inner")
_SPACINGS = (1.0, 0.98, 1.02, 0.96, 1.04, 0.94)
"""Factors tried in turn where a triangle is too flat for a wall."""
_SMOOTHING_ROUNDS = 8
_SMOOTHING_SHARE = 0.8
_CENTRE = np.array([[0.0, 0.55]])


def make_glove(parameters: GloveParameters, *, spacing: float, name: str) -> Garment:
    """Make a glove.

    Args:
        parameters: Measures.
        spacing: Target edge length [m].
        name: Name of the garment.

    Returns:
        An elastic shell of two layers, back (+1) and palm (-1), open at the wrist. A left glove
        mirrors a right one; equal canonical coordinates are the same finger.

    Raises:
        MeshingError: If no spacing within 6 % gives a mesh with room for the wall.
    """
    p = parameters
    failure = ""
    for factor in _SPACINGS:
        try:
            surface, pattern, vertices = _sew(p, spacing=factor * spacing)
        except MeshingError as error:
            failure = str(error)
            continue
        folds = find_folds(vertices, surface.faces, p.wall_thickness)
        if not len(folds):
            return _finish(surface, pattern, vertices, p, name=name)
        failure = f"a wall of {p.wall_thickness} m folds behind {len(folds)} triangles"
    raise MeshingError(
        f"no glove within 6 % of spacing {spacing} m has a wall that fits; last: {failure}"
    )


def _sew(p: GloveParameters, *, spacing: float) -> tuple[SewnSurface, GlovePattern, np.ndarray]:
    """Sew a right glove: surface, pattern, and vertices as it lies [m], shape (V, 3)."""
    pattern = GlovePattern(p)
    relief = _make_relief(pattern, p)
    seams = _cut_seams(pattern, relief, spacing=spacing)
    surface = sew_panels(seams, _cut_panels(pattern), spacing=spacing)
    surface = replace(surface, faces=open_seams(surface.faces, surface.layers))
    flat, vertices = _even_out(surface, relief, spacing=spacing)
    return replace(surface, flat=flat), pattern, vertices


def _finish(
    surface: SewnSurface,
    pattern: GlovePattern,
    vertices: np.ndarray,
    p: GloveParameters,
    *,
    name: str,
) -> Garment:
    faces = surface.faces
    if p.hand == "left":
        vertices, faces = vertices * [-1, 1, 1], faces[:, ::-1]
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    vertices[:, :2] -= (low + high)[:2] / 2
    vertices = vertices.astype(np.float32)
    values = {key: float(value) for key, value in asdict(p).items() if key != "hand"}
    canonical = _compute_canonical(surface, pattern)
    panels, face_panels = _part_wrists(surface, canonical)
    return Garment(
        name=name,
        category=CATEGORY,
        vertices=vertices,
        faces=np.ascontiguousarray(faces),
        rest_vertices=vertices,
        canonical=canonical,
        face_panels=face_panels,
        panels=panels,
        landmarks=_collect_landmarks(surface),
        parameters=values | {"hand": p.hand},
        wall_thickness=p.wall_thickness,
    )


def _make_relief(pattern: GlovePattern, p: GloveParameters) -> GloveRelief:
    finger = (p.hand_width - 3 * p.web_width) / (3 + p.little_width_ratio)
    strip = 0.97 * finger * p.little_width_ratio * p.finger_taper / 2  # the narrowest is a tube
    side = np.linspace(0, 2, 60)
    runs = [pattern.side(side[::-1], -1)]
    for finger in reversed(FINGERS):
        runs += [pattern.digits[finger].outline(-1), pattern.digits[finger].outline(1)[::-1]]
    low, high = V_THUMB
    runs.append(pattern.side(np.array([0.0, V_WEB, low]), 1))
    runs += [pattern.digits["thumb"].outline(1), pattern.digits["thumb"].outline(-1)[::-1]]
    runs.append(pattern.side(np.linspace(high, 2, 40), 1))
    return GloveRelief(
        np.concatenate(runs),
        strip=strip,
        puff=p.finger_puff,
        rise=p.palm_puff,
        rise_width=max(p.wrist_ratio * p.hand_width / 2 - strip, strip),
    )


def _cut_seams(pattern: GlovePattern, relief: GloveRelief, *, spacing: float) -> dict[str, Seam]:
    seams: dict[str, Seam] = {}

    def cut(name: str, start: str, end: str, curve: np.ndarray, *, is_even: bool = False) -> None:
        curve = resample_polyline(curve, 48)
        steps = np.linalg.norm(np.diff(relief.lift(curve), axis=0), axis=1)  # as it will lie
        arc = np.concatenate([[0.0], np.cumsum(steps)])
        count = max(1, round(arc[-1] / spacing))
        if is_even:  # a vertex at the centre
            count = max(2, 2 * round(arc[-1] / spacing / 2))
        targets = np.linspace(0.0, arc[-1], count + 1)
        points = np.stack([np.interp(targets, arc, curve[:, k]) for k in range(2)], axis=1)
        points[0], points[-1] = curve[0], curve[-1]
        seams[name] = Seam(start=start, end=end, points=points)

    low, high = V_THUMB
    for name, start, end, first, last in (
        ("side_index", "index_knuckle", "thumb_inner", 0.0, V_WEB),
        ("thumb_web", "thumb_inner", "thumb_crotch", V_WEB, low),
        ("side_wrist", "thumb_heel", "wrist_thumb_side", high, 2.0),
    ):
        cut(name, start, end, pattern.side(np.linspace(first, last, 200), 1))
    left = pattern.side(np.linspace(0, 2, 200), -1)
    cut("side_little", "little_knuckle", "wrist_little_side", left)
    for digit in DIGITS:
        shape = pattern.digits[digit]
        corners = dict(zip((-1, 1), _CORNERS[digit], strict=True))
        for sign, corner in corners.items():
            cut(f"{digit}_{sign:+d}", corner, f"{digit}_tip", shape.outline(sign))
    for first, second in _WEBS:
        ends = [pattern.digits[first].outline(1)[0], pattern.digits[second].outline(-1)[0]]
        cut(f"{first}_web", _CORNERS[first][1], _CORNERS[second][0], np.stack(ends))
    for layer in _LAYERS:
        for digit in DIGITS:
            shape = pattern.digits[digit]
            base = np.stack([shape.base - shape.half_base, shape.base + shape.half_base])
            cut(f"{layer}_{digit}_base", *_CORNERS[digit], base)
        opening = np.concatenate([pattern.side(np.array([2.0]), s) for s in (-1, 1)])
        cut(f"{layer}_wrist", "wrist_little_side", "wrist_thumb_side", opening, is_even=True)
    return seams


def _cut_panels(pattern: GlovePattern) -> tuple[Panel, ...]:
    centre = pattern.to_pattern_palm(_CENTRE)[0]
    panels = []
    for name, layer in _LAYERS.items():
        hand = (
            f"{name}_little_base",
            *(edge for pair in _WEBS for edge in (f"{pair[0]}_web", f"{name}_{pair[1]}_base")),
            "side_index",
            "thumb_web",
            f"-{name}_thumb_base",
            "side_wrist",
            f"-{name}_wrist",
            "-side_little",
        )
        pins = {f"{name}_centre": centre}
        panels.append(Panel(name=f"{name}_hand", layer=layer, edges=hand, pins=pins))
        for digit in DIGITS:
            edges = (f"{digit}_-1", f"-{digit}_+1", f"-{name}_{digit}_base")
            if digit == "thumb":  # its sides are named the other way round
                edges = (f"{name}_thumb_base", "thumb_+1", "-thumb_-1")
            panels.append(Panel(name=f"{name}_{digit}", layer=layer, edges=edges, pins={}))
    return tuple(panels)


def _even_out(
    surface: SewnSurface, relief: GloveRelief, *, spacing: float
) -> tuple[np.ndarray, np.ndarray]:
    """Lift the pattern, and move its inner vertices until lying edges are near `spacing`.

    Args:
        surface: Sewn pattern.
        relief: Its cross-section.
        spacing: Target edge length [m].

    Returns:
        Positions in the pattern [m], shape (V, 2), and as a right glove lies [m], shape (V, 3).
    """
    fixed = np.concatenate([*surface.seams.values(), list(surface.pins.values())])
    is_free = np.ones(len(surface.flat), dtype=bool)
    is_free[fixed] = False
    flat = surface.flat.copy()
    start, end = surface.faces.ravel(), surface.faces[:, [1, 2, 0]].ravel()

    def lift() -> np.ndarray:
        lying = relief.lift(flat)
        lying[:, 2] *= surface.layers
        return lying

    for _ in range(_SMOOTHING_ROUNDS):
        lying = lift()
        length = np.linalg.norm(lying[end] - lying[start], axis=1)
        pull = (flat[end] - flat[start]) * (1 - spacing / length)[:, None]
        count = np.bincount(start, minlength=len(flat))
        total = [np.bincount(start, pull[:, k], minlength=len(flat)) for k in range(2)]
        move = np.stack(total, axis=1) / count[:, None]
        flat[is_free] += _SMOOTHING_SHARE * move[is_free]
    return flat, lift()


def _compute_canonical(surface: SewnSurface, pattern: GlovePattern) -> np.ndarray:
    canonical = np.zeros((len(surface.flat), 3))
    for part in (*DIGITS, "hand"):  # the hand last: the bases of the digits are its own
        for layer in _LAYERS:
            index = surface.panels.index(f"{layer}_{part}")
            ids = np.unique(surface.faces[surface.face_panels == index])
            region = "palm" if part == "hand" else part
            canonical[ids, :2] = pattern.to_canonical(surface.flat[ids], region)
    canonical[:, 2] = surface.layers
    return canonical.astype(np.float32)


def _part_wrists(surface: SewnSurface, canonical: np.ndarray) -> tuple[tuple[str, ...], np.ndarray]:
    """Take wrist and cuff, which belong to the panels of the hand, for panels of their own.

    Returns:
        Names of the panels, and the panel of each triangle, shape (F,).
    """
    panels, face_panels = list(surface.panels), surface.face_panels.copy()
    v = canonical[surface.faces, 1].mean(axis=1)
    for layer in _LAYERS:
        is_hand = face_panels == panels.index(f"{layer}_hand")
        for part, (low, high) in {"wrist": V_WRIST, "cuff": (V_WRIST[1], 2.0)}.items():
            face_panels[is_hand & (v > low) & (v <= high)] = len(panels)
            panels.append(f"{layer}_{part}")
    return tuple(panels), face_panels


def _collect_landmarks(surface: SewnSurface) -> dict[str, int]:
    landmarks = {k: v for k, v in surface.junctions.items() if k not in _NO_LANDMARKS}
    landmarks |= surface.pins
    for layer in _LAYERS:
        edge = surface.seams[f"{layer}_wrist"]
        landmarks[f"wrist_{layer}"] = int(edge[len(edge) // 2])
    return {name: int(vertex) for name, vertex in landmarks.items()}
