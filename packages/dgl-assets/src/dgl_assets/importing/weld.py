"""Join vertices that are one point of the cloth."""

from __future__ import annotations

import numpy as np
from scipy.spatial import KDTree

from dgl_assets.importing.errors import BrokenMeshError
from dgl_assets.importing.topology import compute_edge_table, label_components

RELATIVE_TOLERANCE = 1e-4
"""Share of the bounding box's diagonal below which vertices are one; 0.15 mm on a top."""
_OF_AN_EDGE = 0.2  # but never more than this share of the median edge

_OF_A_RIM = 0.5  # of the median open edge, that a given tolerance may be


def weld_vertices(
    vertices: np.ndarray, faces: np.ndarray, *, tolerance: float | None = None
) -> tuple[np.ndarray, float]:
    """Find vertices that are one point.

    Only vertices on open edges are joined: vertices split at texture seams, panels that touch, and
    triangles that share nothing (STL). Layers that lie on each other stay apart.

    Args:
        vertices: Positions, shape (V, 3).
        faces: Triangles, shape (F, 3), int.
        tolerance: Distance below which vertices are one, in the units of the vertices; found from
            the size when None.

    Raises:
        BrokenMeshError: If the tolerance would join neighbours along an edge.

    Returns:
        Representative of each vertex, shape (V,), and the tolerance, in the units of the vertices.

    Limitations:
        Openings whose two edges touch within the tolerance are sewn up.
    """
    edges = compute_edge_table(faces)
    used = vertices[np.unique(faces)]
    diagonal = float(np.linalg.norm(np.ptp(used, axis=0)))
    lengths = np.linalg.norm(vertices[edges.pairs[:, 0]] - vertices[edges.pairs[:, 1]], axis=1)
    if tolerance is None:
        tolerance = min(RELATIVE_TOLERANCE * diagonal, _OF_AN_EDGE * float(np.median(lengths)))
    elif (edges.counts == 1).any():
        most = _OF_A_RIM * float(np.median(lengths[edges.counts == 1]))
        if tolerance > most:
            raise BrokenMeshError(
                f"`weld` of {tolerance:.3g} units would join neighbours along the open edges; at "
                f"most {most:.3g} units "
                "are possible with edges of this length"
            )
    rim = np.unique(edges.pairs[edges.counts == 1])
    stands_for = np.arange(len(vertices))
    if not len(rim) or tolerance <= 0:
        return stands_for, tolerance
    # Exact copies first: a corner of a triangle soup has six, whose pairs would be fifteen.
    _, first, place = np.unique(vertices[rim], axis=0, return_index=True, return_inverse=True)
    pairs = KDTree(vertices[rim[first]]).query_pairs(tolerance, output_type="ndarray")
    _, labels = label_components(len(first), pairs.reshape(-1, 2))
    labels = labels[place.reshape(-1)]
    least = np.full(labels.max() + 1, len(vertices), dtype=np.int64)
    np.minimum.at(least, labels, rim)
    stands_for[rim] = least[labels]
    return stands_for, tolerance
