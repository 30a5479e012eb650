"""The steps of remeshing: split, collapse, flip and smooth, each on many edges at once.

Edges that are changed together are chosen so far apart that they do not disturb each other.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_matrix

from dgl_assets.importing.topology import EdgeTable, compute_edge_table, compute_normals

FREE, ON_CURVE, FIXED = 0, 1, 2
_KEPT_COSINE = 0.3  # a changed triangle may not turn further than this from where it faced
_FLATTEST = 0.05  # twice the area over the longest side squared: thinner triangles are not made


@dataclass(eq=False)
class MeshState:
    """A mesh while it is changed; only the functions of this module change it."""

    vertices: np.ndarray
    """Positions [m], shape (V, 3), float64."""
    faces: np.ndarray
    """Triangles, shape (F, 3), int64."""
    curve_pairs: np.ndarray
    """Edges that lie on curves, the smaller vertex id first, shape (K, 2)."""
    curve_labels: np.ndarray
    """Curve of each, shape (K,)."""
    fixed: np.ndarray
    """Vertices that stay, mask of shape (V,)."""

    def classify(self) -> np.ndarray:
        """FREE, ON_CURVE or FIXED for each vertex, shape (V,)."""
        kinds = np.zeros(len(self.vertices), dtype=np.int8)
        kinds[self.curve_pairs] = ON_CURVE
        kinds[self.fixed] = FIXED
        return kinds

    def label_vertices(self) -> np.ndarray:
        """Curve of each vertex, -1 for none, shape (V,)."""
        labels = np.full(len(self.vertices), -1, dtype=np.int64)
        labels[self.curve_pairs] = self.curve_labels[:, None]
        return labels

    def find_curve_edges(self, pairs: np.ndarray) -> np.ndarray:
        """Index into `curve_pairs` of each edge, -1 for none, shape (E,)."""
        span = len(self.vertices)
        own = self.curve_pairs[:, 0] * span + self.curve_pairs[:, 1]
        if not len(own):
            return np.full(len(pairs), -1, dtype=np.int64)
        order = np.argsort(own)
        wanted = pairs[:, 0] * span + pairs[:, 1]
        place = np.minimum(np.searchsorted(own[order], wanted), len(own) - 1)
        return np.where(own[order][place] == wanted, order[place], -1)


def split_long_edges(state: MeshState, longest: float) -> None:
    """Halve edges until none is longer than a limit [m]."""
    while True:
        edges = compute_edge_table(state.faces)
        lengths = _edge_lengths(state, edges)
        rank = np.empty(len(lengths), dtype=np.int64)
        rank[np.argsort(lengths, kind="stable")] = np.arange(len(lengths))
        top = np.argmax(rank[edges.face_edges], axis=1)  # the longest side of each face
        faces = np.arange(len(state.faces))
        is_top = np.bincount(edges.face_edges[faces, top], minlength=len(lengths))
        chosen = (lengths > longest) & (is_top == edges.counts)
        if not chosen.any():
            return
        _split(state, edges, chosen, faces[chosen[edges.face_edges[faces, top]]], top)


def collapse_short_edges(
    state: MeshState, *, shortest: float, longest: float, rng: np.random.Generator, rounds: int = 40
) -> None:
    """Merge the ends of short edges, where the surface keeps its shape and openings.

    Args:
        state: Changed in place.
        shortest: Edges below this are merged [m].
        longest: No edge beyond this may come to be [m].
        rng: Breaks ties, so that regular meshes collapse evenly.
        rounds: Most passes; each takes edges that are far apart.
    """
    for _ in range(rounds):
        edges = compute_edge_table(state.faces)
        lengths = _edge_lengths(state, edges)
        candidates = np.flatnonzero(lengths < shortest)
        target, place, allowed = _plan_collapses(state, edges, candidates)
        candidates, target, place = candidates[allowed], target[allowed], place[allowed]
        if not len(candidates):
            return
        fits = _keeps_shape(state, edges.pairs[candidates], place, longest)
        candidates, target, place = candidates[fits], target[fits], place[fits]
        if not len(candidates):
            return
        urgency = lengths[candidates] * (1 + 0.3 * rng.random(len(candidates)))
        chosen = _choose_apart(len(state.vertices), edges.pairs, edges.pairs[candidates], urgency)
        _collapse(state, edges.pairs[candidates[chosen]], target[chosen], place[chosen])


def flip_edges(state: MeshState, *, rounds: int = 8) -> None:
    """Swap diagonals until opposite angles sum to no more than 180 degrees (Delaunay)."""
    for _ in range(rounds):
        edges = compute_edge_table(state.faces)
        inner = (edges.counts == 2) & (state.find_curve_edges(edges.pairs) < 0)
        ids = np.flatnonzero(inner)
        f0, f1 = edges.faces[ids, 0], edges.faces[ids, 1]
        k0 = np.argmax(edges.face_edges[f0] == ids[:, None], axis=1)
        k1 = np.argmax(edges.face_edges[f1] == ids[:, None], axis=1)
        a, b = state.faces[f0, k0], state.faces[f0, (k0 + 1) % 3]
        c, d = state.faces[f0, (k0 + 2) % 3], state.faces[f1, (k1 + 2) % 3]
        excess = _angle(state, c, a, b) + _angle(state, d, a, b) - np.pi
        span = len(state.vertices)
        keys = np.minimum(c, d) * span + np.maximum(c, d)
        exists = np.isin(keys, edges.pairs[:, 0] * span + edges.pairs[:, 1])
        old = compute_normals(state.vertices, state.faces)[0]
        side = old[f0] + old[f1]
        side /= np.maximum(np.linalg.norm(side, axis=1), 1e-300)[:, None]
        new = (np.column_stack([a, d, c]), np.column_stack([d, b, c]))
        is_sound = ~exists & (c != d)
        for triangles in new:
            normals, _ = compute_normals(state.vertices, triangles)
            is_sound &= (normals * side).sum(axis=1) > _KEPT_COSINE
        wanted = np.flatnonzero(is_sound & (excess > 0.02))
        if not len(wanted):
            return
        rank = np.empty(len(wanted), dtype=np.int64)
        rank[np.argsort(excess[wanted], kind="stable")] = np.arange(len(wanted))
        best = np.full(len(state.faces), -1, dtype=np.int64)
        np.maximum.at(best, f0[wanted], rank)
        np.maximum.at(best, f1[wanted], rank)
        chosen = wanted[(best[f0[wanted]] == rank) & (best[f1[wanted]] == rank)]
        chosen = chosen[np.unique(keys[chosen], return_index=True)[1]]
        state.faces[f0[chosen]] = new[0][chosen]
        state.faces[f1[chosen]] = new[1][chosen]


def compute_smoothed(state: MeshState, *, strength: float) -> np.ndarray:
    """Compute positions that even out the triangles, shape (V, 3).

    Free vertices move in their tangent plane to the area-weighted mean of the triangles around.
    Vertices on a curve move along it to the middle of their neighbours. Fixed ones stay.
    """
    vertices, faces = state.vertices, state.faces
    normals, areas = compute_normals(vertices, faces)
    centres = vertices[faces].mean(axis=1)
    count = len(vertices)
    corner = faces.ravel()
    weight = np.bincount(corner, np.repeat(areas, 3), minlength=count)
    mean, normal = np.empty((count, 3)), np.empty((count, 3))
    for axis in range(3):
        mean[:, axis] = np.bincount(corner, np.repeat(areas * centres[:, axis], 3), minlength=count)
        normal[:, axis] = np.bincount(
            corner, np.repeat(areas * normals[:, axis], 3), minlength=count
        )
    mean /= np.maximum(weight, 1e-300)[:, None]
    normal /= np.maximum(np.linalg.norm(normal, axis=1), 1e-300)[:, None]
    move = mean - vertices
    move -= normal * (move * normal).sum(axis=1)[:, None]
    kinds = state.classify()
    ends = np.concatenate([state.curve_pairs, state.curve_pairs[:, ::-1]])
    degree = np.maximum(np.bincount(ends[:, 0], minlength=count), 1)
    between = np.column_stack(
        [np.bincount(ends[:, 0], vertices[ends[:, 1], k], minlength=count) for k in range(3)]
    )
    on_curve = kinds == ON_CURVE
    move[on_curve] = (between / degree[:, None] - vertices)[on_curve]
    move[kinds == FIXED] = 0.0
    return vertices + strength * move


def move_vertices(state: MeshState, positions: np.ndarray) -> None:
    """Move the vertices, except those whose triangles would turn over or collapse."""
    old, _ = compute_normals(state.vertices, state.faces)
    positions = positions.copy()
    for _ in range(6):
        turned = ~_is_sound(positions[state.faces], old)
        if not turned.any():
            break
        stay = np.unique(state.faces[turned])
        positions[stay] = state.vertices[stay]
    else:
        return
    state.vertices = positions


def _edge_lengths(state: MeshState, edges: EdgeTable) -> np.ndarray:
    ends = state.vertices[edges.pairs]
    return np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)


def _angle(state: MeshState, at: np.ndarray, left: np.ndarray, right: np.ndarray) -> np.ndarray:
    first = state.vertices[left] - state.vertices[at]
    second = state.vertices[right] - state.vertices[at]
    cross = np.linalg.norm(np.cross(first, second), axis=1)
    return np.arctan2(cross, (first * second).sum(axis=1))


def _is_sound(corners: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Tell which triangles still face as they did and have some height, shape (F,)."""
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    double = np.linalg.norm(cross, axis=1)
    longest = ((corners - np.roll(corners, -1, axis=1)) ** 2).sum(axis=2).max(axis=1)
    turned = (cross * normals).sum(axis=1) < _KEPT_COSINE * double
    had_area = (normals**2).sum(axis=1) > 0.5
    return ~(turned & had_area) & (double > _FLATTEST * longest)


def _split(
    state: MeshState, edges: EdgeTable, chosen: np.ndarray, faces: np.ndarray, top: np.ndarray
) -> None:
    ids = np.flatnonzero(chosen)
    number = np.full(len(chosen), -1, dtype=np.int64)
    number[ids] = len(state.vertices) + np.arange(len(ids))
    on_curve = state.find_curve_edges(edges.pairs[ids])
    middles = state.vertices[edges.pairs[ids]].mean(axis=1)
    k = top[faces]
    a, b, c = (state.faces[faces, (k + shift) % 3] for shift in range(3))
    middle = number[edges.face_edges[faces, k]]
    state.faces[faces] = np.column_stack([a, middle, c])
    state.faces = np.concatenate([state.faces, np.column_stack([middle, b, c])])
    state.vertices = np.concatenate([state.vertices, middles])
    state.fixed = np.concatenate([state.fixed, np.zeros(len(ids), dtype=bool)])
    cut = np.flatnonzero(on_curve >= 0)
    old = on_curve[cut]
    pairs, labels = state.curve_pairs[old], state.curve_labels[old]
    halves = [np.column_stack([pairs[:, side], number[ids[cut]]]) for side in range(2)]
    state.curve_pairs = np.concatenate([np.delete(state.curve_pairs, old, axis=0), *halves])
    state.curve_labels = np.concatenate([np.delete(state.curve_labels, old), labels, labels])


def _plan_collapses(
    state: MeshState, edges: EdgeTable, candidates: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Find the end that stays, its new position, and the edges that may be collapsed."""
    pairs = edges.pairs[candidates]
    kinds = state.classify()
    first, second = kinds[pairs[:, 0]], kinds[pairs[:, 1]]
    on_curve = state.find_curve_edges(pairs) >= 0
    allowed = (first == FREE) | (second == FREE)
    allowed |= on_curve & ((first != FIXED) | (second != FIXED))
    target = np.where(second > first, pairs[:, 1], pairs[:, 0])
    place = state.vertices[target]
    is_even = first == second
    place[is_even] = state.vertices[pairs[is_even]].mean(axis=1)
    adjacency = _adjacency(len(state.vertices), edges.pairs)
    if len(pairs):
        common = adjacency[pairs[:, 0]].multiply(adjacency[pairs[:, 1]]).sum(axis=1)
        allowed &= np.asarray(common).ravel() == edges.counts[candidates]
    return target, place, allowed


def _keeps_shape(
    state: MeshState, pairs: np.ndarray, place: np.ndarray, longest: float
) -> np.ndarray:
    """Tell which collapses turn no triangle over and make no long edge, shape (N,)."""
    count = len(state.vertices)
    corner = state.faces.ravel()
    order = np.argsort(corner, kind="stable")
    start = np.concatenate([[0], np.cumsum(np.bincount(corner, minlength=count))])
    normals, _ = compute_normals(state.vertices, state.faces)
    good = np.ones(len(pairs), dtype=bool)
    for side in range(2):
        moved, other = pairs[:, side], pairs[:, 1 - side]
        sizes = start[moved + 1] - start[moved]
        owner = np.repeat(np.arange(len(pairs)), sizes)
        ordinal = np.arange(len(owner)) - np.repeat(np.cumsum(sizes) - sizes, sizes)
        faces = order[start[moved][owner] + ordinal] // 3
        triangles = state.faces[faces]
        stays = ~(triangles == other[owner][:, None]).any(axis=1)
        owner, faces, triangles = owner[stays], faces[stays], triangles[stays]
        corners = state.vertices[triangles]
        is_moved = triangles == moved[owner][:, None]
        reach = np.linalg.norm(corners - place[owner][:, None], axis=2)
        reach[is_moved] = 0.0
        corners[is_moved] = place[owner]
        bad = ~_is_sound(corners, normals[faces]) | (reach.max(axis=1) > longest)
        good[owner[bad]] = False
    return good


def _choose_apart(
    count: int, edges: np.ndarray, pairs: np.ndarray, urgency: np.ndarray
) -> np.ndarray:
    """Choose edges of locally lowest urgency value, no two within one edge of each other."""
    rank = np.empty(len(pairs), dtype=np.int64)
    rank[np.argsort(urgency, kind="stable")] = np.arange(len(pairs))
    best = np.full(count, len(pairs), dtype=np.int64)
    for side in range(2):
        np.minimum.at(best, pairs[:, side], rank)
    around = best.copy()
    for side in range(2):
        np.minimum.at(around, edges[:, side], best[edges[:, 1 - side]])
    return np.flatnonzero((around[pairs[:, 0]] == rank) & (around[pairs[:, 1]] == rank))


def _collapse(state: MeshState, pairs: np.ndarray, target: np.ndarray, place: np.ndarray) -> None:
    gone = np.where(target == pairs[:, 0], pairs[:, 1], pairs[:, 0])
    state.vertices[target] = place
    state.fixed[target] |= state.fixed[gone]
    number = np.arange(len(state.vertices))
    number[gone] = target
    faces = number[state.faces]
    faces = faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)]
    curves = np.sort(number[state.curve_pairs], axis=1)
    keep = curves[:, 0] != curves[:, 1]
    curves, first = np.unique(curves[keep], axis=0, return_index=True)
    labels = state.curve_labels[keep][first]
    used = np.ones(len(state.vertices), dtype=bool)
    used[gone] = False
    number = np.cumsum(used) - 1
    state.vertices, state.fixed = state.vertices[used], state.fixed[used]
    state.faces = number[faces]
    state.curve_pairs, state.curve_labels = number[curves], labels


def _adjacency(count: int, pairs: np.ndarray) -> csr_matrix:
    both = np.concatenate([pairs, pairs[:, ::-1]])
    weights = np.ones(len(both), dtype=np.int32)
    return csr_matrix((weights, (both[:, 0], both[:, 1])), shape=(count, count))
