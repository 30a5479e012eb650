"""Correspondence of vertices between garments, and distances of places."""

import numpy as np

from dgl_gam.data.garment_file import GarmentData

__all__ = ["compute_places", "find_vertices", "mirror_places"]

SIDE_WEIGHT = 0.3
"""Distance in canonical coordinates that one step of the side counts as."""
SIDE_DISTANCE = 0.1
"""Distance between front and back, as a share of the garment's diagonal."""
MAX_CANONICAL_DISTANCE = 0.15
"""A place farther than this from every vertex, in canonical coordinates, is missing on a
garment."""


def find_vertices(source: GarmentData, vertices: np.ndarray, target: GarmentData) -> np.ndarray:
    """Find the same places on another garment, or on the same one.

    Args:
        source: Garment that the vertices belong to.
        vertices: Their ids, shape (n,).
        target: Garment to find them on. If it is the source, its vertices are the answer, whatever
            its state: that is the correspondence traced through a deformation.

    Returns:
        Vertex ids of the target, shape (n,), int64; -1 where it lacks the place.

    Raises:
        ValueError: If they are different garments and one has no canonical coordinates, or their
            categories differ.
    """
    vertices = np.asarray(vertices, dtype=np.int64)
    if source is target or source.header.garment_id == target.header.garment_id:
        return vertices
    if source.header.category != target.header.category:
        raise ValueError(
            f"both garments must be of one category; got {source.header.category} and "
            f"{target.header.category}"
        )
    for garment in (source, target):
        if not garment.has_canonical:
            raise ValueError(f"{garment.header.path} has no canonical coordinates")
    weight = np.array([1.0, 1.0, SIDE_WEIGHT])
    wanted, there = source.canonical[vertices] * weight, target.canonical * weight
    squared = (wanted**2).sum(axis=1)[:, None] - 2 * wanted @ there.T + (there**2).sum(axis=1)[None]
    nearest = squared.argmin(axis=1)
    is_lacking = squared[np.arange(len(nearest)), nearest] > MAX_CANONICAL_DISTANCE**2
    return np.where(is_lacking, -1, nearest)


def compute_places(garment: GarmentData) -> np.ndarray:
    """Place of each vertex on the garment as it lies flat, shape (V, 4), float32.

    Position by the horizontal diagonal, and the side times 0.1: distances between rows are
    distances between places, as shares of the diagonal. A left cuff is far from a right one, and
    the front from the back.
    """
    flat = garment.states[0]
    side = garment.canonical[:, 2:] if garment.has_canonical else np.zeros((len(flat), 1))
    centre = (flat.min(axis=0) + flat.max(axis=0)) / 2
    places = np.concatenate([(flat - centre) / garment.diagonal, side * SIDE_DISTANCE], axis=1)
    return places.astype(np.float32)


def mirror_places(places: np.ndarray) -> np.ndarray:
    """Swap left and right of places, shape (n, 4)."""
    return places * np.array([-1, 1, 1, 1], dtype=places.dtype)
