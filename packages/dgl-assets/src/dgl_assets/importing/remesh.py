"""Cover a surface with even triangles of the size of the particles.

Isotropic remeshing after M. Botsch and L. Kobbelt, "A Remeshing Approach to Multiresolution
Modeling", 2004: long edges are split, short ones collapsed, diagonals flipped, vertices smoothed.
Openings and sharp folds stay in place, and vertices return to the surface.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dgl_assets.importing._remesh_steps import (
    FREE,
    ON_CURVE,
    MeshState,
    collapse_short_edges,
    compute_smoothed,
    flip_edges,
    move_vertices,
    split_long_edges,
)
from dgl_assets.importing.curves import CurveProjector, find_curves
from dgl_assets.importing.errors import BrokenMeshError
from dgl_assets.importing.surface import SurfaceIndex
from dgl_assets.importing.topology import (
    compute_edge_table,
    compute_vertex_normals,
    find_loops,
    label_pieces,
)

_ROUNDS = 7
_FINAL_ROUNDS = 5  # without splits and collapses
_LONGEST, _SHORTEST = 1.30, 0.78  # of the spacing
_STRENGTH = 0.8
_PIN_REACH = 0.9  # spacings that a vertex may be moved to a pinned point
_OTHER_SIDE = 3.0  # makes vertices of the other layer of cloth count as farther away
_PIN_BESIDE = (
    0.25  # spacings beside a line, a corner or another pin below which a point is taken to be there
)
_PIN_CANDIDATES = 8  # vertices that are tried
_PIN_STEPS = 4


@dataclass(frozen=True, kw_only=True, eq=False)
class Remeshed:
    """An even mesh of a surface."""

    vertices: np.ndarray
    """Positions [m], shape (V, 3), float64, on the surface."""
    faces: np.ndarray
    """Triangles, shape (F, 3), int64, oriented as the surface."""
    pins: np.ndarray
    """Vertex of each pinned point, shape (K,), int64."""


def remesh_surface(
    vertices: np.ndarray,
    faces: np.ndarray,
    *,
    spacing: float,
    pins: np.ndarray | None = None,
    pin_normals: np.ndarray | None = None,
) -> Remeshed:
    """Remesh an oriented manifold surface evenly.

    Args:
        vertices: Positions [m], shape (V, 3).
        faces: Triangles, shape (F, 3), int.
        spacing: Target edge length [m].
        pins: Points on the surface that should become vertices [m], shape (K, 3).
        pin_normals: Unit normals of the surface there, shape (K, 3).

    Returns:
        The mesh. It has the openings of the surface.

    Raises:
        BrokenMeshError: If an opening or a piece was lost because it is too small for the spacing.

    Limitations:
        Folds below 60 degrees are rounded within one edge length. A pinned point within a quarter
        of the spacing of a kept line, a corner or another pin is moved there.
    """
    vertices, faces = np.asarray(vertices, np.float64), np.asarray(faces, np.int64)
    curves = find_curves(vertices, faces, spacing=spacing)
    surface = SurfaceIndex(vertices, faces, spacing=spacing / 2)
    projector = CurveProjector(vertices, curves, spacing=spacing / 8)
    state = MeshState(
        vertices=vertices.copy(),
        faces=faces.copy(),
        curve_pairs=curves.pairs.copy(),
        curve_labels=curves.labels.copy(),
        fixed=curves.fixed.copy(),
    )
    rng = np.random.default_rng(0)  # the same mesh each time
    for _ in range(_ROUNDS):
        split_long_edges(state, _LONGEST * spacing)
        collapse_short_edges(
            state, shortest=_SHORTEST * spacing, longest=_LONGEST * spacing, rng=rng
        )
        flip_edges(state)
        _smooth(state, surface, projector)
    found = _pin(state, projector, pins, pin_normals, spacing=spacing)
    for _ in range(_FINAL_ROUNDS):
        flip_edges(state)
        _smooth(state, surface, projector)
    flip_edges(state)
    _check_openings(faces, state.faces, spacing=spacing)
    return Remeshed(vertices=state.vertices, faces=state.faces, pins=found)


def _smooth(state: MeshState, surface: SurfaceIndex, projector: CurveProjector) -> None:
    positions = compute_smoothed(state, strength=_STRENGTH)
    kinds = state.classify()
    normals = compute_vertex_normals(state.vertices, state.faces)
    free = np.flatnonzero(kinds == FREE)
    places = surface.locate(positions[free], normals[free])
    positions[free] = surface.evaluate(*places)
    lying = np.flatnonzero(kinds == ON_CURVE)
    positions[lying] = projector.project(positions[lying], state.label_vertices()[lying])
    move_vertices(state, positions)


def _pin(
    state: MeshState,
    projector: CurveProjector,
    pins: np.ndarray | None,
    normals: np.ndarray | None,
    *,
    spacing: float,
) -> np.ndarray:
    """Move a vertex onto each pinned point and fix it."""
    if pins is None or not len(pins):
        return np.empty(0, dtype=np.int64)
    found = np.empty(len(pins), dtype=np.int64)
    for index, pin in enumerate(np.asarray(pins, dtype=np.float64)):
        distances = np.linalg.norm(state.vertices - pin, axis=1)
        if normals is not None:
            vertex_normals = compute_vertex_normals(state.vertices, state.faces)
            distances *= 1 + _OTHER_SIDE * np.maximum(0.3 - vertex_normals @ normals[index], 0.0)
        nearest = np.argsort(distances, kind="stable")[:_PIN_CANDIDATES]
        found[index] = nearest[0]
        near = nearest[distances[nearest] < _PIN_REACH * spacing]
        for vertex, place in _choose_pinned(state, projector, pin, near, spacing=spacing):
            if _move_to(state, vertex, place):
                found[index] = vertex
                state.fixed[vertex] = True
                break
    return found


def _choose_pinned(
    state: MeshState,
    projector: CurveProjector,
    pin: np.ndarray,
    near: np.ndarray,
    *,
    spacing: float,
) -> list[tuple[int, np.ndarray]]:
    """List vertices that may take a pinned point, best first, each with its new position.

    A point on or beside a kept line goes to a vertex of that line, which may only move along it: a
    free vertex there would leave a sliver. Any other point goes to a free vertex.
    """
    kinds, labels = state.classify(), state.label_vertices()
    held: list[tuple[int, np.ndarray]] = []
    free: list[tuple[int, np.ndarray]] = []
    for vertex in near.tolist():
        if kinds[vertex] == FREE:
            free.append((vertex, pin))
            continue
        place = state.vertices[vertex]
        if kinds[vertex] == ON_CURVE:
            place = projector.project(pin[None], labels[[vertex]])[0]
        if np.linalg.norm(place - pin) < _PIN_BESIDE * spacing:
            held.append((vertex, place))
    return held or free


def _move_to(state: MeshState, vertex: int, place: np.ndarray) -> bool:
    """Move one vertex to a position, around others if needed.

    Where the whole way would turn a triangle over, it goes a part of the way, and diagonals are
    flipped before the rest.
    """
    for _ in range(_PIN_STEPS):
        for share in (1.0, 0.5, 0.25):
            positions = state.vertices.copy()
            positions[vertex] += share * (place - positions[vertex])
            move_vertices(state, positions)
            if np.array_equal(state.vertices[vertex], positions[vertex]):
                break
        if np.linalg.norm(state.vertices[vertex] - place) < 1e-12:
            return True
        flip_edges(state)
    return False


def _check_openings(before: np.ndarray, after: np.ndarray, *, spacing: float) -> None:
    facts = []
    for faces in (before, after):
        edges = compute_edge_table(faces)
        euler = len(np.unique(faces)) - len(edges.pairs) + len(faces)
        facts.append((label_pieces(faces)[0], len(find_loops(faces)), euler))
    if facts[0] != facts[1]:
        raise BrokenMeshError(
            f"the surface cannot be meshed at spacing {spacing} m: (pieces, openings, Euler "
            "number) were "
            f"{facts[0]} and became {facts[1]}; parts narrower than the spacing are lost, choose a "
            "smaller `spacing`"
        )
