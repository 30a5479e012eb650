"""Tell the front of a garment from its back by shape."""

from __future__ import annotations

import numpy as np
from scipy.spatial import KDTree

from dgl_assets.importing.errors import UnclearGarmentError
from dgl_assets.importing.openings import Openings

_FRONT_CLEAR = 0.015  # of the length that the neckline must be deeper in front
_FRONT_SURE = 0.05  # of the length beyond which hardly any garment is worn the other way round
_ALIGNED = 0.7  # cosine at which the up axis decides about a direction
_AROUND = 0.05  # of the length: the cloth around a vertex that tells in which layer it lies
_IN_LAYER = 0.2  # of half the local thickness off its middle
_SHARE_OPEN = 0.8  # of an opening's vertices on one side: it faces there, as that of a hood does


def turn_front_up(
    rotation: np.ndarray, vertices: np.ndarray, openings: Openings, towards: np.ndarray | None
) -> tuple[np.ndarray, list[str]]:
    """Make +z the front: where the neckline, or the waist, is lower, or a coat opens.

    Args:
        rotation: Rows are x, y, z of the garment, where x and z may both be reversed, shape (3, 3).
        vertices: Positions, shape (V, 3), axes of the file.
        openings: Its openings, with a pair.
        towards: Up axis of the file, if it is stated.

    Returns:
        The rotation, and what was assumed, with how sure it is.

    Raises:
        UnclearGarmentError: If a garment that opens in front has no front.
    """
    turned = rotation * np.array([[-1.0], [1.0], [-1.0]])
    placed = vertices @ rotation.T
    length = float(np.ptp(placed[:, 1]))
    loop = openings.main if openings.neck is None else openings.neck
    along = placed[loop, 1]
    layers = _find_layers(placed, loop, radius=_AROUND * length)
    if openings.neck is None and np.ptp(along) > 0.5 * length:
        low, high = along.min(), along.max()
        inside = np.abs(along - (low + high) / 2) < 0.3 * (high - low)
        if not inside.any():
            raise UnclearGarmentError("where the front opens cannot be told; give `category`")
        return (rotation if layers[inside].mean() > 0 else turned), ["front where it opens"]
    front, back = layers > _IN_LAYER, layers < -_IN_LAYER
    for side, frame in ((front, rotation), (back, turned)):
        if side.mean() > _SHARE_OPEN and np.ptp(along) > 0.1 * length:
            return frame, ["front on the side that the neckline or hood opens to, fairly sure"]
    if front.any() and back.any():
        deeper = (along[back].min() - along[front].min()) / length
        if abs(deeper) > _FRONT_CLEAR:
            how = "sure" if abs(deeper) > _FRONT_SURE else "not sure, see whether it is so"
            return (rotation if deeper > 0 else turned), [
                f"front where the neckline or waist is lower, by {abs(deeper):.1%} of the length: "
                f"{how}"
            ]
    if towards is not None and abs(rotation[2] @ towards) > _ALIGNED:
        return (rotation if rotation[2] @ towards > 0 else turned), [
            "front and back look alike; assumed that it lies on its back, a mere guess"
        ]
    # Standing bodies look along +z if y is up, along -y if z is up; others lie on their backs.
    if abs(rotation[1][1]) > _ALIGNED:
        ahead = np.array([0.0, 0, 1])
    elif rotation[1][2] > _ALIGNED:
        ahead = np.array([0.0, -1, 0])
    else:
        ahead = np.eye(3)[np.argmax(np.abs(rotation[2]))]
    side = rotation[2] @ ahead
    return (rotation if side >= 0 else turned), [
        "front and back look alike; the front is assumed as is usual for the axes of the file, a "
        "mere guess"
    ]


def _find_layers(placed: np.ndarray, ids: np.ndarray, *, radius: float) -> np.ndarray:
    """Height of vertices in the cloth around them, from -1 (undermost) to 1 (topmost), shape (N,).

    Normals do not tell it: those of a collar that is folded over look inward.
    """
    around = KDTree(placed[:, :2]).query_ball_point(placed[ids, :2], radius)
    limits = np.array([(placed[a, 2].min(), placed[a, 2].max()) for a in around])
    middle, half = limits.mean(axis=1), np.ptp(limits, axis=1) / 2
    return (placed[ids, 2] - middle) / np.maximum(half, 1e-300)
