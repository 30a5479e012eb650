"""Sew panels to a garment: lay it flat in layers, add canonical coordinates and landmarks."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial import KDTree

from dgl_assets.errors import MeshingError
from dgl_assets.garments.garment import Garment
from dgl_assets.garments.measures import flatten_measures
from dgl_assets.garments.meshing import resample_polyline
from dgl_assets.garments.sewing import (
    Curve,
    Panel,
    SewnSurface,
    divide_curves,
    measure_area,
    sew_panels,
)

DEFAULT_SPACING = 0.013
"""Edge length of garments of usual size [m]."""
SPACING_LIMITS = (0.0112, 0.0141)
"""Range of `choose_spacing` [m], which keeps edges in 8 to 18 mm."""
_SPACINGS = (1.0, 0.98, 1.02, 0.96, 1.04)
"""Factors tried in turn where a mesh loses an edge of its outline."""
_VERTEX_LIMITS = (1650, 7700)  # aimed at, within the 1,500 to 8,000 that a garment may have
_COUNT_LIMITS = (1620, 7850)  # of the estimate from the area, which errs by a few per cent
_LAYER_GAP = 0.012  # distance of the two layers while it lies flat, 0 at the seams [m]
_BLEND_ROWS = 3.5  # spacings from a seam over which a layer rises to its height
_UNTANGLING_ROUNDS = 20
# Moves of a vertex, in spreads of its neighbours: none; three lengths in eight directions.
_UNTANGLING_MOVES = np.array(
    [
        (length * math.cos(k * math.pi / 4), length * math.sin(k * math.pi / 4))
        for length in (0.0, 0.1, 0.3, 0.8)
        for k in range(8)
    ]
)[7:]
_LEAST_CANONICAL_AREA = 2e-6  # twice the area of a triangle in (u, v); usual ones have some 1e-3
_FLAP_BLEND = 0.06  # distance from its seam over which a flap rises above the front [m]
_OVERLAP_BLEND = 0.10  # distance from a seam over which one front rises above the other [m]


@dataclass(frozen=True, kw_only=True)
class Cut:
    """Seams, panels and maps of one garment."""

    curves: dict[str, Curve]
    """Seam lines by name."""
    panels: tuple[Panel, ...]
    """Later panels decide the canonical coordinates of common vertices."""
    to_canonical: Callable[[str, np.ndarray], np.ndarray]
    """From a panel's name and its points [m], shape (N, 2), to (u, v), shape (N, 2)."""
    exact: Sequence[tuple[str, int, float]]
    """Coordinates that are known along whole seams: (seam, 0 for u or 1 for v, value)."""
    landmarks: Callable[[SewnSurface], dict[str, int]]
    """Vertices by landmark, beyond the pins of the panels."""
    compute_raise: Callable[[np.ndarray, str], np.ndarray] | None = None
    """From points [m], shape (N, 2), and a panel's name to the layers by which the panel is raised
    there, shape (N,); None if no panel lies over another one of its side."""


def choose_spacing(area: float) -> float:
    """Choose the edge length for an area of cloth, all layers [m^2].

    It is 13 mm, adapted within `SPACING_LIMITS` so that garments have about 1,650 to 7,700
    vertices.
    """
    low, high = (math.sqrt(area / (math.sqrt(0.75) * count)) for count in reversed(_VERTEX_LIMITS))
    return float(np.clip(np.clip(DEFAULT_SPACING, low, high), *SPACING_LIMITS))


def check_size(cut: Cut) -> None:
    """Refuse a cut that gives too few or too many vertices at its chosen spacing.

    Raises:
        ValueError: If the estimate is outside of `_COUNT_LIMITS`.
    """
    area = measure_area(cut.curves, cut.panels)
    count = area / (math.sqrt(0.75) * choose_spacing(area) ** 2)
    if not _COUNT_LIMITS[0] <= count <= _COUNT_LIMITS[1]:
        raise ValueError(
            f"a garment must have about {_COUNT_LIMITS[0]} to {_COUNT_LIMITS[1]} vertices; got "
            f"{count:.0f} from {area:.2f} m^2 of cloth"
        )


def assemble(
    cut: Cut, category: str, parameters: Any, *, spacing: float | None, name: str
) -> Garment:
    """Sew a cut garment and lay it flat.

    Args:
        cut: Seams, panels and maps.
        category: Its category.
        parameters: Dataclass of its measures.
        spacing: Target edge length [m]; None for `choose_spacing`.
        name: Name of the garment.

    Returns:
        The garment.

    Raises:
        MeshingError: If a panel cannot be filled, at this spacing or one within 4 % of it.
    """
    if spacing is None:
        spacing = choose_spacing(measure_area(cut.curves, cut.panels))
    surface, spacing = _sew(cut, spacing)
    low, high = surface.flat.min(axis=0), surface.flat.max(axis=0)
    flat = (surface.flat - (low + high) / 2).astype(np.float32)
    height = _compute_heights(surface, cut, spacing=spacing)
    return Garment(
        name=name,
        category=category,
        vertices=np.column_stack([flat, height]).astype(np.float32),
        faces=surface.faces,
        rest_vertices=flat,
        canonical=_compute_canonical(surface, cut),
        face_panels=surface.face_panels,
        panels=surface.panels,
        landmarks=dict(sorted({**surface.pins, **cut.landmarks(surface)}.items())),
        parameters=flatten_measures(parameters),
    )


def _sew(cut: Cut, spacing: float) -> tuple[SewnSurface, float]:
    """Sew at a spacing [m], or at the first one near it at which all panels can be filled."""
    refused: MeshingError | None = None
    for near in (factor * spacing for factor in _SPACINGS):
        seams = divide_curves(cut.curves, spacing=near)
        try:
            return sew_panels(seams, cut.panels, spacing=near), near
        except MeshingError as err:
            refused = refused or err
    assert refused is not None
    raise refused


def _compute_heights(surface: SewnSurface, cut: Cut, *, spacing: float) -> np.ndarray:
    """Height of each vertex [m], shape (V,): smooth from 0 at the seams to half the gap inside."""
    sides: dict[str, set[int]] = {}
    for panel in cut.panels:
        for edge in panel.edges:
            sides.setdefault(edge.removeprefix("-"), set()).add(panel.layer)
    joined = [name for name, layers in sides.items() if -1 in layers and len(layers) > 1]
    if not any(panel.layer < 0 for panel in cut.panels):
        return np.zeros(len(surface.flat))
    from_seams = _measure_distances(surface, cut, joined)
    share = _rise(from_seams, _BLEND_ROWS * spacing)
    heights = surface.layers * (_LAYER_GAP / 2) * share
    raised = np.zeros(len(heights))
    for index, panel in enumerate(cut.panels):
        ids = np.unique(surface.faces[surface.face_panels == index])
        if panel.layer == 2:
            hinges = [e.removeprefix("-") for e in panel.edges]
            hinges = [name for name in hinges if len(sides[name]) > 1]
            distance = _measure_distances(surface, cut, hinges)
            heights[ids] += _LAYER_GAP * _rise(distance[ids], _FLAP_BLEND)
        if cut.compute_raise is not None:
            raised[ids] = np.maximum(raised[ids], cut.compute_raise(surface.flat[ids], panel.name))
    return heights + _LAYER_GAP * raised * _rise(from_seams, _OVERLAP_BLEND)


def _measure_distances(surface: SewnSurface, cut: Cut, names: list[str]) -> np.ndarray:
    dense = []
    for name in names:
        points = surface.flat[surface.seams[name]]
        dense.append(resample_polyline(points, 8 * (len(points) - 1)))
    return KDTree(np.concatenate(dense)).query(surface.flat)[0]


def _rise(distance: np.ndarray, reach: float) -> np.ndarray:
    share = np.clip(distance / reach, 0.0, 1.0)
    # A hair's breadth from a seam is on the seam: dense samples are not the seam itself.
    return np.where(distance < 1e-9, 0.0, share**2 * (3 - 2 * share))


def _compute_canonical(surface: SewnSurface, cut: Cut) -> np.ndarray:
    canonical = np.zeros((len(surface.flat), 3))
    for index, panel in enumerate(cut.panels):
        ids = np.unique(surface.faces[surface.face_panels == index])
        canonical[ids, :2] = cut.to_canonical(panel.name, surface.flat[ids])
    # Resampled seams lie on chords, micrometres off their curves; their exact coordinate is known.
    for seam, axis, value in cut.exact:
        canonical[surface.seams[seam], axis] = value
    _untangle(canonical, surface)
    canonical[:, 2] = surface.layers
    return canonical.astype(np.float32)


def _untangle(canonical: np.ndarray, surface: SewnSurface) -> None:
    """Even out (u, v), in place, where the mesh is too coarse for the map.

    The map is injective, but where it is steep, as beside the corner of a square neckline, a
    triangle of straight edges may be turned over.
    """
    is_fixed = np.zeros(len(canonical), dtype=bool)
    for ids in surface.seams.values():
        is_fixed[ids] = True
    is_fixed[list(surface.pins.values())] = True
    faces = surface.faces
    sign = np.sign(surface.layers[faces].sum(axis=1))

    def measure(chosen: np.ndarray) -> np.ndarray:
        corners = canonical[faces[chosen], :2]
        first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
        return (first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]) * sign[chosen]

    for _ in range(_UNTANGLING_ROUNDS):
        turned = np.unique(faces[measure(np.arange(len(faces))) < _LEAST_CANONICAL_AREA])
        turned = turned[~is_fixed[turned]]
        if not len(turned):
            return
        for vertex in turned.tolist():
            touching = np.flatnonzero((faces == vertex).any(axis=1))
            neighbours = np.setdiff1d(faces[touching], vertex)
            around = canonical[neighbours, :2]
            here, size = canonical[vertex, :2].copy(), around.std(axis=0)
            moves = np.concatenate([_UNTANGLING_MOVES * size, [around.mean(axis=0) - here]])
            smallest = []
            for move in moves:
                canonical[vertex, :2] = here + move
                smallest.append(measure(touching).min())
            canonical[vertex, :2] = here + moves[int(np.argmax(smallest))]
