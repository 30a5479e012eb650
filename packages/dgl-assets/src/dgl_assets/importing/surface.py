"""Nearest points of a surface, on the side that faces as the query does."""

from __future__ import annotations

import numpy as np
from scipy.spatial import KDTree

from dgl_assets.importing.topology import compute_normals

_CANDIDATES = 8  # samples whose triangles are compared
_BLOCK = 50_000  # queries that are answered at once: of each, eight triangles are held
_MOST_SAMPLES = 4_000_000  # garments take up to 500,000
_NORMAL_WEIGHT = 2.0  # of a turned-over normal, in sample spacings: layers that touch stay apart


class SurfaceIndex:
    """A triangle mesh that answers which of its places is nearest.

    The mesh is sampled densely, so that long thin triangles are found as well as small ones.
    Samples carry their normal: of two layers of cloth on each other, a query finds the one that
    faces the same way.

    Args:
        vertices: Positions [m], shape (V, 3).
        faces: Oriented triangles, shape (F, 3), int.
        spacing: Distance between samples [m].
    """

    def __init__(self, vertices: np.ndarray, faces: np.ndarray, *, spacing: float) -> None:
        self.vertices = np.asarray(vertices, dtype=np.float64)
        self.faces = np.asarray(faces, dtype=np.int64)
        self.normals, areas = compute_normals(self.vertices, self.faces)
        corners = self.vertices[self.faces]
        longest = np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2).max(axis=1)
        # Needles without number would take samples without number.
        spacing = max(spacing, float(np.sqrt((longest**2).sum() / (2 * _MOST_SAMPLES))))
        self._weight = _NORMAL_WEIGHT * spacing
        owner, weights = _sample(self.vertices[self.faces], spacing)
        points = (self.vertices[self.faces[owner]] * weights[:, :, None]).sum(axis=1)
        keep = areas[owner] > 0
        self._owner = owner[keep]
        self._tree = KDTree(self._lift(points[keep], self.normals[self._owner]))

    def locate(
        self,
        points: np.ndarray,
        normals: np.ndarray | None = None,
        *,
        faces: np.ndarray | None = None,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Find the nearest places.

        Args:
            points: Queries [m], shape (N, 3).
            normals: Unit normals there, shape (N, 3); any side when None.
            faces: Mask of the faces that may answer, shape (F,), bool; all when None.

        Returns:
            Face ids, shape (N,), and barycentric weights, shape (N, 3), within the face.
        """
        points = np.asarray(points, dtype=np.float64)
        tree, owner = self._tree, self._owner
        if faces is not None:
            keep = faces[owner]
            tree, owner = KDTree(self._tree.data[keep]), owner[keep]
        if normals is None:
            tree = KDTree(tree.data[:, :3])
        count = min(_CANDIDATES, len(owner))
        found, weights = np.empty(len(points), np.int64), np.empty((len(points), 3))
        for start in range(0, len(points), _BLOCK):
            block = slice(start, start + _BLOCK)
            found[block], weights[block] = self._locate(
                tree, owner, points[block], None if normals is None else normals[block], count
            )
        return found, weights

    def _locate(
        self,
        tree: KDTree,
        owner: np.ndarray,
        points: np.ndarray,
        normals: np.ndarray | None,
        count: int,
    ) -> tuple[np.ndarray, np.ndarray]:
        query = points if normals is None else self._lift(points, normals)
        candidates = owner[tree.query(query, k=count)[1].reshape(-1, count)]  # (N, C)
        weights = _project(points[:, None], self.vertices[self.faces[candidates]])
        found = (self.vertices[self.faces[candidates]] * weights[..., None]).sum(axis=2)
        cost = ((found - points[:, None]) ** 2).sum(axis=2)
        if normals is not None:
            away = 1.0 - (self.normals[candidates] * normals[:, None]).sum(axis=2)
            cost += self._weight**2 * np.maximum(away - 0.5, 0.0)
        best = np.argmin(cost, axis=1)
        rows = np.arange(len(points))
        return candidates[rows, best], weights[rows, best]

    def evaluate(self, faces: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """Positions of places [m], shape (N, 3)."""
        return (self.vertices[self.faces[faces]] * weights[:, :, None]).sum(axis=1)

    def _lift(self, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
        return np.column_stack([points, self._weight * normals])


def _sample(corners: np.ndarray, spacing: float) -> tuple[np.ndarray, np.ndarray]:
    """Make barycentric grids on triangles: face, (S,), and weights, (S, 3), of each sample."""
    longest = np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2).max(axis=1)
    steps = np.clip(np.ceil(longest / spacing), 1, 400).astype(int)
    owners, weights = [], []
    for step in np.unique(steps):
        i, j = np.meshgrid(np.arange(step), np.arange(step), indexing="ij")
        inside = i + j < step
        first, second = (i[inside] + 1 / 3) / step, (j[inside] + 1 / 3) / step
        grid = np.column_stack([1 - first - second, first, second])
        ids = np.flatnonzero(steps == step)
        owners.append(np.repeat(ids, len(grid)))
        weights.append(np.tile(grid, (len(ids), 1)))
    return np.concatenate(owners), np.concatenate(weights)


def _project(points: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Compute barycentric weights of the nearest point of each triangle.

    Args:
        points: Shape (N, 1, 3).
        corners: Shape (N, C, 3, 3).

    Returns:
        Shape (N, C, 3), none below zero.
    """
    a, b, c = corners[..., 0, :], corners[..., 1, :], corners[..., 2, :]
    ab, ac, ap = b - a, c - a, points - a
    d00, d01, d11 = (ab * ab).sum(-1), (ab * ac).sum(-1), (ac * ac).sum(-1)
    d20, d21 = (ap * ab).sum(-1), (ap * ac).sum(-1)
    area = np.maximum(d00 * d11 - d01 * d01, 1e-300)
    v, w = (d11 * d20 - d01 * d21) / area, (d00 * d21 - d01 * d20) / area
    weights = np.stack([1 - v - w, v, w], axis=-1)
    best = np.full(weights.shape[:-1], np.inf)
    result = weights.copy()
    outside = (weights < 0).any(axis=-1)
    best[~outside] = -1.0
    for first, second in ((0, 1), (1, 2), (2, 0)):  # else the nearest point of an edge
        start, along = corners[..., first, :], corners[..., second, :] - corners[..., first, :]
        length = np.maximum((along * along).sum(-1), 1e-300)
        share = np.clip(((points - start) * along).sum(-1) / length, 0.0, 1.0)
        distance = ((start + share[..., None] * along - points) ** 2).sum(-1)
        closer = distance < best
        best = np.where(closer, distance, best)
        edge = np.zeros_like(weights)
        edge[..., first], edge[..., second] = 1 - share, share
        result = np.where(closer[..., None], edge, result)
    return result
