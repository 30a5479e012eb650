"""Measures of a garment at rest: edges, angles, and its landmarks mapped to another garment."""

from dataclasses import dataclass

import numpy as np

from dgl_assets import Garment, correspond

__all__ = [
    "ANGLE_LIMIT",
    "EDGE_RANGE",
    "MeshFacts",
    "compute_smallest_angles",
    "describe_mesh",
    "find_edges",
    "measure_landmarks",
]

EDGE_RANGE = (0.008, 0.018)
"""Accepted lengths of edges [m], both included."""
ANGLE_LIMIT = 20.0
"""Accepted smallest angle of a triangle [degrees], included."""


@dataclass(frozen=True, kw_only=True)
class MeshFacts:
    """Shares and extremes of one mesh, as cut: unstrained."""

    vertices: int
    edges: int
    faces: int
    edge_mean: float
    """[m]."""
    edge_shortest: float
    """[m]."""
    edge_longest: float
    """[m]."""
    edge_share: float
    """Share of the edges within `EDGE_RANGE`, in [0, 1]."""
    angle_smallest: float
    """[degrees]."""
    angle_share: float
    """Share of the triangles whose smallest angle is at least `ANGLE_LIMIT`, in [0, 1]."""


def describe_mesh(rest: np.ndarray, faces: np.ndarray) -> MeshFacts:
    """Measure edges and angles.

    Args:
        rest: Unstrained positions [m], shape (V, 2) or (V, 3).
        faces: Vertex indices, shape (F, 3).
    """
    edges, length = _measure_edges(rest, faces)
    angle = compute_smallest_angles(rest, faces)
    # a length or angle that is the limit itself must not fail by the last bit of single precision
    slack = 1e-6
    is_even = (length >= EDGE_RANGE[0] - slack) & (length <= EDGE_RANGE[1] + slack)
    return MeshFacts(
        vertices=len(rest),
        edges=len(edges),
        faces=len(faces),
        edge_mean=float(length.mean()),
        edge_shortest=float(length.min()),
        edge_longest=float(length.max()),
        edge_share=float(is_even.mean()),
        angle_smallest=float(angle.min()),
        angle_share=float((angle >= ANGLE_LIMIT - slack).mean()),
    )


def find_edges(faces: np.ndarray) -> np.ndarray:
    """Find the edges of triangles, each once, shape (E, 2)."""
    half = np.concatenate([faces[:, [k, (k + 1) % 3]] for k in range(3)]).astype(np.int64)
    count = int(half.max()) + 1
    keys = np.unique(half.min(axis=1) * count + half.max(axis=1))
    return np.column_stack(np.divmod(keys, count))


def compute_smallest_angles(rest: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Compute the smallest angle of each triangle [degrees], shape (F,); 0 for one without area.

    Args:
        rest: Positions [m], shape (V, 2) or (V, 3).
        faces: Vertex indices, shape (F, 3).
    """
    corners = np.asarray(rest, dtype=np.float64)[faces]
    angles = []
    for k in range(3):
        a, b = corners[:, (k + 1) % 3] - corners[:, k], corners[:, (k + 2) % 3] - corners[:, k]
        norm = np.linalg.norm(a, axis=1) * np.linalg.norm(b, axis=1)
        cosine = np.divide((a * b).sum(axis=1), norm, out=np.ones(len(a)), where=norm > 0)
        angles.append(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))))
    return np.min(angles, axis=0)


def measure_landmarks(source: Garment, target: Garment) -> tuple[float, str, int]:
    """Map the landmarks that two garments share from one to the other, and measure the errors.

    Args:
        source: Where the landmarks come from.
        target: Another garment of the category.

    Returns:
        The largest distance, in the target's mean edge lengths; the landmark's name; and how many
        were mapped.
    """
    names = tuple(sorted(set(source.landmarks) & set(target.landmarks)))
    if not names:
        raise ValueError(f"{source.name} and {target.name} have no landmark in common")
    mapped = correspond(source, source.get_landmark_positions(names), target)
    miss = np.linalg.norm(mapped - target.get_landmark_positions(names), axis=1)
    edge = _measure_edges(target.rest_vertices, target.faces)[1].mean()
    worst = int(np.argmax(miss))
    return float(miss[worst] / edge), names[worst], len(names)


def _measure_edges(rest: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Find the edges, shape (E, 2), and their lengths [m], shape (E,)."""
    edges = find_edges(faces)
    ends = np.asarray(rest, dtype=np.float64)[edges]
    return edges, np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)
