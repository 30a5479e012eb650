"""Keep two layers apart next to their common seam.

A triangle with three vertices on the seam, as at the tip of a finger, is the same in both layers:
the shell would have no inside there. Turning its inner edge joins the tip to a vertex of its own
layer.
"""

from __future__ import annotations

import numpy as np

from dgl_assets.errors import MeshingError


def open_seams(faces: np.ndarray, layers: np.ndarray) -> np.ndarray:
    """Turn edges that run inside of a layer from seam to seam.

    Args:
        faces: Triangles, shape (F, 3), int32.
        layers: +1 or -1 for vertices of one layer, 0 on the seam, shape (V,).

    Returns:
        Triangles, shape (F, 3), int32, each in its former place or that of its neighbour.

    Raises:
        MeshingError: If a layer is so narrow that both ends of a turned edge would be on the seam.
    """
    faces = faces.copy()
    flat = set(np.flatnonzero((layers[faces] == 0).all(axis=1)).tolist())
    while flat:
        turned = False
        for index in sorted(flat):
            for corner in range(3):
                tip, start, end = np.roll(faces[index], -corner)
                across = _find_across(faces, start, end)
                # Beyond the edge lies a triangle of each layer; take the one not on the seam.
                for other, apex in across:
                    if other in flat or layers[apex] == 0:
                        continue
                    faces[index] = (tip, start, apex)
                    faces[other] = (tip, apex, end)
                    turned = True
                    break
                if turned:
                    break
            if turned:
                flat.discard(index)
                break
        if not turned:
            raise MeshingError(
                f"{len(flat)} triangles lie on the seam with all corners, the first is "
                f"{min(flat)}; a finger is too narrow for the spacing"
            )
    return faces


def _find_across(faces: np.ndarray, start: int, end: int) -> list[tuple[int, int]]:
    """Triangles that walk from `end` to `start`, and their third vertices."""
    found = []
    for k in range(3):
        match = (faces[:, k] == end) & (faces[:, (k + 1) % 3] == start)
        found += [(int(i), int(faces[i, (k + 2) % 3])) for i in np.flatnonzero(match)]
    return found
