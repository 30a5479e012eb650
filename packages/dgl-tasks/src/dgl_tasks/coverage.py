"""The surface of a mesh that is visible from straight above, without rendering."""

import numpy as np


def sample_visible_surface(
    vertices: np.ndarray, faces: np.ndarray, *, cell: float = 0.01
) -> np.ndarray:
    """Find the top of a mesh over a horizontal grid.

    Each cell that the mesh covers gives one point, so shares of points are shares of the visible
    area. Equal to what an orthographic camera above sees.

    Args:
        vertices: [m], shape (V, 3), world frame.
        faces: Vertex indices, shape (F, 3).
        cell: Side of a grid cell [m]; > 0.

    Returns:
        The highest point in each covered cell [m], shape (N, 3).
    """
    if not cell > 0:
        raise ValueError(f"cell must be positive; got {cell}")
    corners = np.asarray(vertices, dtype=np.float32)[faces]  # (F, 3, 3)
    # Barycentric samples about a cell apart. The few longer triangles may leave cells out where
    # nothing else lies, far less than one in a thousand.
    edge = np.quantile(np.linalg.norm(corners[:, 0] - corners[:, 1], axis=1), 0.95)
    n = max(2, int(np.ceil(1.25 * float(edge) / cell)))
    i, j = np.meshgrid(np.arange(n + 1), np.arange(n + 1), indexing="ij")
    keep = i + j <= n
    weights = np.stack([i[keep], j[keep], n - i[keep] - j[keep]], axis=1) / n  # (S, 3)
    points = (weights.astype(np.float32) @ corners).reshape(-1, 3)  # (F * S, 3)
    keys = np.floor(points[:, :2] / cell).astype(np.int64)
    keys -= keys.min(axis=0)
    width = int(keys[:, 1].max()) + 1
    code = keys[:, 0] * width + keys[:, 1]
    top = np.full((int(keys[:, 0].max()) + 1) * width, -np.inf, dtype=np.float32)
    np.maximum.at(top, code, points[:, 2])
    # of the samples of a cell, one that is its top
    index = np.full(len(top), -1, dtype=np.int64)
    is_top = np.flatnonzero(points[:, 2] == top[code])
    index[code[is_top]] = is_top
    return points[index[index >= 0]]
