"""The lines of a surface that remeshing must keep: openings and sharp folds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from dgl_assets.importing.topology import compute_edge_table, compute_normals, label_components

_CREASE_COSINE = 0.5  # normals that differ by more than 60 degrees are a fold
_SHORTEST_CREASE = 6.0  # spacings; shorter folds are noise of the surface
_CORNER_COSINE = 0.64  # a line that turns by more than 50 degrees has a corner there
_BETWEEN_CURVES = 100.0  # of the longest extent: keeps the curves apart in one search tree


@dataclass(frozen=True, kw_only=True, eq=False)
class CurveNetwork:
    """Lines along edges of a mesh. Where lines meet, end or turn sharply, a vertex is fixed."""

    pairs: np.ndarray
    """Edges of the lines, shape (K, 2), int64, the smaller vertex id first."""
    labels: np.ndarray
    """Curve of each edge, shape (K,): a line between two fixed vertices, or a closed line."""
    fixed: np.ndarray
    """Vertices that must stay, mask of shape (V,)."""


def find_curves(vertices: np.ndarray, faces: np.ndarray, *, spacing: float) -> CurveNetwork:
    """Find openings, folds and their corners.

    Args:
        vertices: Positions [m], shape (V, 3).
        faces: Oriented manifold triangles, shape (F, 3), int.
        spacing: Length at which corners are judged [m].
    """
    edges = compute_edge_table(faces)
    normals, areas = compute_normals(vertices, faces)
    inner = edges.counts == 2
    first, second = edges.faces[:, 0], edges.faces[:, 1]
    cosine = (normals[first] * normals[second]).sum(axis=1)
    has_area = np.minimum(areas[first], areas[second]) > 1e-3 * np.median(areas)
    is_crease = inner & (cosine < _CREASE_COSINE) & has_area
    creases = _drop_short(vertices, edges.pairs[is_crease], _SHORTEST_CREASE * spacing)
    pairs = np.concatenate([edges.pairs[edges.counts == 1], creases])
    degree = np.bincount(pairs.ravel(), minlength=len(vertices))
    fixed = (degree > 0) & (degree != 2)
    fixed[_find_corners(vertices, pairs, degree, spacing)] = True
    return CurveNetwork(pairs=pairs, labels=_label_curves(pairs, fixed), fixed=fixed)


class CurveProjector:
    """Moves points onto the curves that they belong to.

    Args:
        vertices: Positions of the mesh of the curves [m], shape (V, 3).
        curves: The curves.
        spacing: Distance between samples of the search [m].
    """

    def __init__(self, vertices: np.ndarray, curves: CurveNetwork, *, spacing: float) -> None:
        self._start, self._end = vertices[curves.pairs[:, 0]], vertices[curves.pairs[:, 1]]
        lengths = np.linalg.norm(self._end - self._start, axis=1)
        counts = np.maximum(np.ceil(lengths / spacing), 1).astype(int)
        self._owner = np.repeat(np.arange(len(counts)), counts)
        ordinal = np.arange(len(self._owner)) - np.repeat(np.cumsum(counts) - counts, counts)
        share = ((ordinal + 0.5) / counts[self._owner])[:, None]
        points = self._start[self._owner] * (1 - share) + self._end[self._owner] * share
        self._apart = _BETWEEN_CURVES * float(np.ptp(vertices, axis=0).max())
        self._tree = (
            KDTree(np.column_stack([points, curves.labels[self._owner] * self._apart]))
            if len(points)
            else None
        )

    def project(self, points: np.ndarray, labels: np.ndarray) -> np.ndarray:
        """Find the nearest point of a curve.

        Args:
            points: Queries [m], shape (N, 3).
            labels: Curve of each, shape (N,).

        Returns:
            Positions [m], shape (N, 3).
        """
        if self._tree is None or not len(points):
            return points
        count = min(4, len(self._owner))
        query = np.column_stack([points, labels * self._apart])
        owner = self._owner[self._tree.query(query, k=count)[1].reshape(-1, count)]
        start, along = self._start[owner], (self._end - self._start)[owner]
        length = np.maximum((along**2).sum(axis=2), 1e-300)
        share = np.clip(((points[:, None] - start) * along).sum(axis=2) / length, 0.0, 1.0)
        found = start + share[..., None] * along
        best = np.argmin(((found - points[:, None]) ** 2).sum(axis=2), axis=1)
        return found[np.arange(len(points)), best]


def _drop_short(vertices: np.ndarray, pairs: np.ndarray, shortest: float) -> np.ndarray:
    if not len(pairs):
        return pairs
    _, labels = label_components(len(vertices), pairs)
    lengths = np.linalg.norm(vertices[pairs[:, 0]] - vertices[pairs[:, 1]], axis=1)
    total = np.bincount(labels[pairs[:, 0]], lengths, minlength=labels.max() + 1)
    return pairs[total[labels[pairs[:, 0]]] >= shortest]


def _label_curves(pairs: np.ndarray, fixed: np.ndarray) -> np.ndarray:
    """Edges that meet at a vertex that is not fixed are of one curve."""
    owner = np.tile(np.arange(len(pairs)), 2)
    ends = pairs.T.ravel()
    order = np.argsort(ends, kind="stable")
    ends, owner = ends[order], owner[order]
    same = (ends[1:] == ends[:-1]) & ~fixed[ends[1:]]
    links = np.column_stack([owner[:-1][same], owner[1:][same]])
    return label_components(len(pairs), links)[1]


def _find_corners(
    vertices: np.ndarray, pairs: np.ndarray, degree: np.ndarray, spacing: float
) -> np.ndarray:
    """Vertices at which a line turns sharply, seen from one spacing before and behind."""
    neighbours = np.full((len(vertices), 2), -1, dtype=np.int64)
    owner = np.concatenate([pairs[:, 0], pairs[:, 1]])
    other = np.concatenate([pairs[:, 1], pairs[:, 0]])
    order = np.argsort(owner, kind="stable")
    owner, other = owner[order], other[order]
    plain = degree[owner] == 2
    neighbours[np.unique(owner[plain])] = other[plain].reshape(-1, 2)
    middle = np.flatnonzero(degree == 2)
    if not len(middle):
        return middle
    arms = [
        vertices[_walk(vertices, neighbours, middle, neighbours[middle, k], spacing)]
        - vertices[middle]
        for k in range(2)
    ]
    lengths = np.linalg.norm(arms[0], axis=1) * np.linalg.norm(arms[1], axis=1)
    cosine = -(arms[0] * arms[1]).sum(axis=1) / np.maximum(lengths, 1e-300)  # 1 is straight on
    corners: list[int] = []
    for candidate in np.argsort(cosine, kind="stable"):
        if cosine[candidate] >= _CORNER_COSINE:
            break
        place = vertices[middle[candidate]]
        if all(np.linalg.norm(place - vertices[other]) > spacing for other in corners):
            corners.append(int(middle[candidate]))
    return np.array(corners, dtype=np.int64)


def _walk(
    vertices: np.ndarray,
    neighbours: np.ndarray,
    start: np.ndarray,
    step: np.ndarray,
    distance: float,
) -> np.ndarray:
    """Vertices that a walk along the lines reaches after a distance, shape (N,)."""
    before, here = start.copy(), step.copy()
    walked = np.linalg.norm(vertices[here] - vertices[before], axis=1)
    for _ in range(64):
        pair = neighbours[here]
        following = np.where(pair[:, 0] == before, pair[:, 1], pair[:, 0])
        going = (walked < distance) & (following >= 0) & (following != start)
        if not going.any():
            break
        walked[going] += np.linalg.norm(vertices[following] - vertices[here], axis=1)[going]
        before[going], here[going] = here[going], following[going]
    return here
