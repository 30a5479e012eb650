"""The surface of a mesh that is visible from straight above, without rendering."""

import numpy as np


def sample_visible_surface(
    vertices: np.ndarray, faces: np.ndarray, *, cell: float = 0.005
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
    corners = np.asarray(vertices, dtype=np.float64)[faces]  # (F, 3, 3)
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max()
    # barycentric samples closer together than a cell, so that no covered cell is missed
    n = max(2, int(np.ceil(1.5 * longest / cell)))
    i, j = np.meshgrid(np.arange(n + 1), np.arange(n + 1), indexing="ij")
    keep = i + j <= n
    weights = np.stack([i[keep], j[keep], n - i[keep] - j[keep]], axis=1) / n  # (S, 3)
    points = np.einsum("sk,fkd->fsd", weights, corners).reshape(-1, 3)
    keys = np.floor(points[:, :2] / cell).astype(np.int64)
    code = (keys[:, 0] - keys[:, 0].min()) * (np.ptp(keys[:, 1]) + 1) + keys[:, 1] - keys[:, 1].min()
    order = np.lexsort((-points[:, 2], code))
    first = np.unique(code[order], return_index=True)[1]
    return points[order[first]]
