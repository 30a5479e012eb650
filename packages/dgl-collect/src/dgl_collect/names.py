"""Names of a stage's formulas: the garment as seen, the objects' frames, the points found."""

from collections.abc import Mapping

import numpy as np

from dgl_collect.formula import Value

__all__ = ["Frames", "describe_cloud", "list_anchors", "name_scene"]

Frames = Mapping[str, Mapping[str, np.ndarray]]
"""Frames of the objects by object and name [m], shape (3,), world frame."""


def name_scene(
    cloud: np.ndarray, frames: Frames, points: Mapping[str, np.ndarray]
) -> dict[str, Value]:
    """Build the names that the formulas of a stage may use.

    Args:
        cloud: Seen points of the garment [m], shape (N, 3), world frame.
        frames: Frames of the objects.
        points: Points of the demonstration, as found on the garment [m], shape (3,).
    """
    return {"garment": describe_cloud(cloud), **frames, **points}


def describe_cloud(cloud: np.ndarray) -> dict[str, Value]:
    """Compute the corners and the centre of a garment's cloud [m], shape (N, 3)."""
    low, high = cloud.min(axis=0).astype(float), cloud.max(axis=0).astype(float)
    return {"min": low, "max": high, "centre": (low + high) / 2}


def list_anchors(names: Mapping[str, Value]) -> dict[str, np.ndarray]:
    """List the positions among the names of a stage [m], shape (3,), such as `garment.min`."""
    anchors: dict[str, np.ndarray] = {}
    for name, value in names.items():
        if isinstance(value, Mapping):
            inner = list_anchors(value)
            anchors |= {f"{name}.{part}": place for part, place in inner.items()}
        elif np.shape(value) == (3,):
            anchors[name] = np.asarray(value, dtype=float)
    return anchors
