"""Views of garments in pictures: cloth from above as it lies, shells obliquely from the front."""

from __future__ import annotations

import math

import numpy as np

from dgl_assets.garments.garment import Garment

_FLAT = 0.25  # height over width below which a shell lies rather than stands
_AZIMUTH = {"lying": math.radians(15), "standing": math.radians(35)}
_ELEVATION = {"lying": math.radians(58), "standing": math.radians(28)}
"""Direction to the viewer: from the front (-y) towards the right, and above the ground [rad]."""


def project(garment: Garment) -> np.ndarray:
    """Turn a garment to the viewer, in parallel projection.

    Args:
        garment: A sheet of cloth, or an elastic shell.

    Returns:
        Positions [m], shape (V, 3), float64: x to the right and y up in the picture, z towards the
        viewer; the bounding box centred.
    """
    turned = garment.vertices.astype(np.float64) @ _make_rotation(garment).T
    return turned - (turned.min(axis=0) + turned.max(axis=0)) / 2


def _make_rotation(garment: Garment) -> np.ndarray:
    """Rows are the picture's right, up, and the direction to the viewer, shape (3, 3)."""
    if garment.wall_thickness is None:
        return np.eye(3)
    kind = "lying" if garment.extent[2] < _FLAT * garment.extent[:2].max() else "standing"
    azimuth, elevation = _AZIMUTH[kind], _ELEVATION[kind]
    toward = np.array([math.sin(azimuth), -math.cos(azimuth), math.tan(elevation)])
    toward /= np.linalg.norm(toward)
    right = np.array([math.cos(azimuth), math.sin(azimuth), 0.0])
    return np.stack([right, np.cross(toward, right), toward])
