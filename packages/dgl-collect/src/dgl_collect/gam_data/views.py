"""What a camera sees of a surface: each visible point with the triangle that was hit and its nearest vertex."""

from dataclasses import dataclass

import numpy as np

__all__ = ["DISTANCE", "POINTS", "TOLERANCE", "View", "make_direction", "see_surface"]

POINTS = 2048
DISTANCE = 6.75
"""Of the camera from the middle of the garment [m]: as high as the tasks' garment camera hangs."""
TOLERANCE = 0.006
"""What shows its inside is hidden by an outside so little below it [m]: the layers of a seam are closer than that."""
_SPARE = 3  # visible pixels for each point that is drawn from them
_FINER = 5  # times that the picture is made finer, at most
_FIRST_PIXELS = 16_000  # of the picture's rectangle, to begin with


@dataclass(frozen=True, kw_only=True, eq=False)
class View:
    """Points of a surface that one camera sees."""

    points: np.ndarray
    """[m], shape (N, 3), float64, in the frame of the surface."""
    vertices: np.ndarray
    """Nearest corner of the triangle that was hit, shape (N,), int32."""
    faces: np.ndarray
    """Triangle that was hit, shape (N,), int32."""
    direction: np.ndarray
    """Unit vector from the middle of the surface towards the camera, shape (3,)."""


def make_direction(azimuth: float, elevation: float) -> np.ndarray:
    """Make a unit vector, shape (3,).

    Args:
        azimuth: Turn about the vertical from the front, which is -y, towards +x [rad].
        elevation: Above the horizon [rad]; pi / 2 is straight above.
    """
    flat = np.cos(elevation)
    return np.array([flat * np.sin(azimuth), -flat * np.cos(azimuth), np.sin(elevation)])


def see_surface(
    vertices: np.ndarray,
    faces: np.ndarray,
    direction: np.ndarray,
    rng: np.random.Generator,
    *,
    count: int = POINTS,
    distance: float = DISTANCE,
    tolerance: float = TOLERANCE,
) -> View:
    """Draw points of what a camera sees, by a depth buffer of the triangles.

    Args:
        vertices: [m], shape (V, 3).
        faces: Triangles, counter-clockwise seen from outside, shape (F, 3).
        direction: From the middle towards the camera, of any length, shape (3,).
        rng: Source of randomness.
        count: How many points.
        distance: Of the camera from the middle of the bounding box [m].
        tolerance: How far behind the inside of a triangle an outside hides it [m]; 0 for a single layer, whose two
            sides are alike.

    Returns:
        The view; fewer pixels than points are never seen: the picture is made finer until there are enough.

    Raises:
        ValueError: If the surface cannot be seen at all, as when it is seen edge on.
    """
    direction = np.asarray(direction, dtype=np.float64) / np.linalg.norm(direction)
    eye = (vertices.min(axis=0) + vertices.max(axis=0)) / 2 + distance * direction
    reference = np.array([0.0, 1.0, 0.0]) if abs(direction[2]) > 0.99 else np.array([0.0, 0.0, 1.0])
    right = np.cross(reference, direction)
    right /= np.linalg.norm(right)
    up = np.cross(direction, right)
    offset = vertices.astype(np.float64) - eye
    depth = -offset @ direction
    if depth.min() <= 0:
        raise ValueError(f"the camera must be outside of the garment; got distance {distance}")
    image = np.column_stack([offset @ right, offset @ up]) / depth[:, None]
    low, high = image.min(axis=0), image.max(axis=0)
    pixel = float(np.sqrt(np.prod(high - low) / _FIRST_PIXELS))
    if not pixel > 0:
        raise ValueError("the surface is seen edge on: no point of it is visible")
    needed = _SPARE * count
    hit, weights = _rasterise((image - low) / pixel + rng.random(2), depth, faces, tolerance)
    for _ in range(_FINER):
        if len(hit) >= needed:
            break
        pixel *= max(0.25, 0.9 * np.sqrt(max(len(hit), 1) / needed))
        hit, weights = _rasterise((image - low) / pixel + rng.random(2), depth, faces, tolerance)
    if len(hit) < count:
        raise ValueError(f"{count} points must be visible; got {len(hit)}")
    chosen = np.sort(rng.choice(len(hit), count, replace=False))
    hit, weights = hit[chosen], weights[chosen]
    corners = vertices[faces[hit]].astype(np.float64)  # (N, 3, 3)
    points = (corners * weights[..., None]).sum(axis=1)
    nearest = np.linalg.norm(corners - points[:, None], axis=2).argmin(axis=1)
    return View(
        points=points,
        vertices=faces[hit, nearest].astype(np.int32),
        faces=hit.astype(np.int32),
        direction=direction,
    )


def _rasterise(
    image: np.ndarray, depth: np.ndarray, faces: np.ndarray, tolerance: float
) -> tuple[np.ndarray, np.ndarray]:
    """Find what each pixel shows.

    Args:
        image: Where the vertices are in the picture [pixels], shape (V, 2).
        depth: How far they are in front of the camera [m], shape (V,).
        faces: Shape (F, 3).
        tolerance: See `see_surface` [m].

    Returns:
        Triangle of each pixel that shows one, shape (P,), and the weights of its corners there, shape (P, 3).
    """
    a, b, c = (image[faces[:, k]] for k in range(3))
    area = _cross(b - a, c - a)  # positive: the outside is seen
    first = np.ceil(np.minimum(np.minimum(a, b), c)).astype(np.int64)
    size = np.floor(np.maximum(np.maximum(a, b), c)).astype(np.int64) - first + 1
    size = np.where((np.abs(area) > 1e-9)[:, None], np.maximum(size, 0), 0)
    number = size.prod(axis=1)
    face = np.repeat(np.arange(len(faces)), number)
    place = np.arange(len(face)) - np.repeat(np.cumsum(number) - number, number)
    x = first[face] + np.column_stack([place % size[face, 0], place // size[face, 0]])
    in_picture = [
        _cross(p[face] - x, q[face] - x) / area[face] for p, q in ((b, c), (c, a), (a, b))
    ]
    weights = np.column_stack(in_picture)
    inside = (weights >= 0).all(axis=1)
    face, x, weights = face[inside], x[inside], weights[inside]
    # What is linear in the picture is the inverse of the depth.
    weights /= depth[faces[face]]
    z = 1.0 / weights.sum(axis=1)
    weights *= z[:, None]
    key = x[:, 1] * (x[:, 0].max(initial=0) + 1) + x[:, 0]
    order = np.lexsort((z, key))
    _, start = np.unique(key[order], return_index=True)
    nearest = order[start]
    is_outside = area[face] > 0
    outside = order[is_outside[order]]
    keys, start = np.unique(key[outside], return_index=True)
    below = np.searchsorted(keys, key[nearest])
    has_below = below < len(keys)
    has_below[has_below] = keys[below[has_below]] == key[nearest][has_below]
    other = nearest.copy()
    other[has_below] = outside[start[below[has_below]]]
    is_hidden = ~is_outside[nearest] & (z[other] < z[nearest] + tolerance)
    shown = np.where(is_hidden, other, nearest)
    return face[shown], weights[shown]


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
