"""Exact correspondence between garments of a category, by canonical coordinates."""

from __future__ import annotations

import numpy as np
from scipy.spatial import KDTree

from dgl_assets.garments.garment import Garment

_CANDIDATES = 24  # triangles with the nearest centroids that are searched for the containing one
_MAX_DISTANCE = 0.05  # of a source point from the lying-flat garment [m]


def correspond(source: Garment, places: np.ndarray, target: Garment) -> np.ndarray:
    """Map points of one garment to the corresponding points of another one.

    Args:
        source: Garment that the points belong to.
        places: Vertex ids, shape (N,), integer; or points on the lying-flat source [m], shape (N,
            3), float, garment frame.
        target: Garment of the same category.

    Returns:
        For ids: the nearest vertex ids of the target, shape (N,), int32. For points: points on the
        lying-flat target [m], shape (N, 3), float32.

    Raises:
        ValueError: If the categories differ, `places` has another shape or dtype, or a point is
            farther than 0.05 m from the source.

    Limitations:
        Points of a part that the target lacks, such as a collar, map to the edge nearest in
        canonical coordinates.
    """
    if source.category != target.category:
        raise ValueError(
            f"both garments must be of one category; got {source.category} and {target.category}"
        )
    places = np.asarray(places)
    if places.ndim == 1 and np.issubdtype(places.dtype, np.integer):
        if len(places) and not 0 <= places.min() <= places.max() < len(source.vertices):
            raise ValueError(
                f"vertex ids must be in [0, {len(source.vertices)}); got {places.min()} to "
                f"{places.max()}"
            )
        canonical = source.canonical[places]
        layers = np.where(canonical[:, 2] < 0, -1, 1)  # a seam belongs to both; take the front
        corners, weights = _locate(target.canonical[:, :2], target, canonical[:, :2], layers)
        position = _interpolate(target.vertices, corners, weights)
        distance = np.linalg.norm(target.vertices[corners] - position[:, None], axis=2)
        nearest = np.argmin(distance, axis=1)
        return corners[np.arange(len(places)), nearest].astype(np.int32)
    if places.ndim == 2 and places.shape[1] == 3 and np.issubdtype(places.dtype, np.floating):
        corners, weights, layers = _project(source, places)
        on_source = _interpolate(source.vertices, corners, weights)
        distance = np.linalg.norm(on_source - places, axis=1)
        if len(places) and distance.max() > _MAX_DISTANCE:
            raise ValueError(
                f"points must be within {_MAX_DISTANCE} m of the lying-flat source; got "
                f"{distance.max():.3f} m"
            )
        canonical = _interpolate(source.canonical, corners, weights)
        corners, weights = _locate(target.canonical[:, :2], target, canonical[:, :2], layers)
        return _interpolate(target.vertices, corners, weights).astype(np.float32)
    raise ValueError(
        "places must be integer ids of shape (N,) or float points of shape (N, 3); got shape "
        f"{places.shape} and dtype {places.dtype}"
    )


def _project(garment: Garment, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Nearest points on the flat garment: vertex ids and weights, (N, 3), and layers, (N,)."""
    # Slow to import, and needed here only.
    from trimesh.triangles import closest_point, points_to_barycentric

    triangles = garment.vertices[garment.faces].astype(np.float64)
    count = min(_CANDIDATES, len(triangles))
    candidates = KDTree(triangles.mean(axis=1)).query(points, k=count)[1].reshape(-1, count)
    repeated = np.repeat(points.astype(np.float64), count, axis=0)
    chosen = triangles[candidates.ravel()]
    closest = closest_point(chosen, repeated)
    distance = np.linalg.norm(closest - repeated, axis=1).reshape(-1, count)
    best = np.argmin(distance, axis=1) if len(points) else np.zeros(0, dtype=int)
    rows = np.arange(len(points))
    faces = candidates[rows, best]
    weights = points_to_barycentric(triangles[faces], closest.reshape(-1, count, 3)[rows, best])
    weights = np.clip(weights, 0.0, None)
    weights /= weights.sum(axis=1, keepdims=True)
    return garment.faces[faces], weights, np.where(garment.face_layers[faces] < 0, -1, 1)


def _locate(
    plane: np.ndarray, garment: Garment, queries: np.ndarray, layers: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Find the triangle of a layer that contains each query, in a plane that the layer covers once.

    Args:
        plane: Coordinates of the garment's vertices in that plane, shape (V, 2).
        garment: Garment whose faces are searched.
        queries: Shape (N, 2).
        layers: +1 or -1, shape (N,).

    Returns:
        Vertex ids, shape (N, 3), and barycentric weights, shape (N, 3), clipped to the triangle.
    """
    corners = np.zeros((len(queries), 3), dtype=np.int64)
    weights = np.zeros((len(queries), 3))
    for layer in (1, -1):
        wanted = np.flatnonzero(layers == layer)
        if not len(wanted):
            continue
        faces = garment.faces[garment.face_layers == layer]
        triangles = plane[faces].astype(np.float64)
        points = queries[wanted].astype(np.float64)
        count = min(_CANDIDATES, len(faces))
        candidates = KDTree(triangles.mean(axis=1)).query(points, k=count)[1].reshape(-1, count)
        bary = _compute_barycentric(points, triangles[candidates])
        best = np.argmax(bary.min(axis=2), axis=1)
        rows = np.arange(len(wanted))
        clipped = np.clip(bary[rows, best], 0.0, None)
        corners[wanted] = faces[candidates[rows, best]]
        weights[wanted] = clipped / clipped.sum(axis=1, keepdims=True)
    return corners, weights


def _compute_barycentric(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Weights of points, shape (N, 2), in their candidates, shape (N, C, 3, 2): (N, C, 3)."""
    first = triangles[..., 1, :] - triangles[..., 0, :]
    second = triangles[..., 2, :] - triangles[..., 0, :]
    offset = points[:, None] - triangles[..., 0, :]
    area = first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0]
    # A triangle on a line holds its first corner only.
    area = np.where(np.abs(area) < 1e-15, np.inf, area)
    b1 = (offset[..., 0] * second[..., 1] - offset[..., 1] * second[..., 0]) / area
    b2 = (first[..., 0] * offset[..., 1] - first[..., 1] * offset[..., 0]) / area
    return np.stack([1 - b1 - b2, b1, b2], axis=-1)


def _interpolate(values: np.ndarray, corners: np.ndarray, weights: np.ndarray) -> np.ndarray:
    return (values[corners].astype(np.float64) * weights[..., None]).sum(axis=1)
