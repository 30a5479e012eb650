"""Camera views of a surface: visible points with their triangle and nearest vertex."""

from dataclasses import dataclass, replace

import numpy as np

from dgl_physics.drawing.camera import PinholeCamera
from dgl_physics.drawing.mesh import Mesh, SurfaceLook
from dgl_physics.drawing.rasteriser import Rasteriser, weigh_corners

__all__ = ["DISTANCE", "POINTS", "TOLERANCE", "View", "make_direction", "see_surface"]

POINTS = 2048
DISTANCE = 6.75
"""Distance of the camera from the middle of the garment, as in the tasks [m]."""
TOLERANCE = 0.006
"""Depth below an inside within which an outside hides it [m]; layers of a seam are closer."""
_SPARE = 3  # visible pixels for each point that is drawn from them
_FINER = 5  # times that the picture is made finer, at most
_FIRST_PIXELS = 16_000  # of the picture's rectangle, to begin with


@dataclass(frozen=True, kw_only=True, eq=False)
class View:
    """Points of a surface that one camera sees."""

    points: np.ndarray
    """Points [m], shape (N, 3), float64, in the frame of the surface."""
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
    """Draw visible points of a surface, by a depth buffer of its triangles.

    Args:
        vertices: Positions [m], shape (V, 3).
        faces: Triangles, counter-clockwise seen from outside, shape (F, 3).
        direction: From the middle towards the camera, of any length, shape (3,).
        rng: Source of randomness.
        count: Number of points.
        distance: Distance of the camera from the middle of the bounding box [m].
        tolerance: Depth behind the inside of a triangle within which an outside hides it [m]; 0 for
            a single layer, whose two sides are alike.

    Returns:
        The view. The picture is made finer until it shows at least `count` pixels.

    Raises:
        ValueError: If the surface is not visible at all, such as edge on.
    """
    direction = np.asarray(direction, dtype=np.float64) / np.linalg.norm(direction)
    vertices = vertices.astype(np.float64)
    reference = np.array([0.0, 1.0, 0.0]) if abs(direction[2]) > 0.99 else np.array([0.0, 0.0, 1.0])
    right = np.cross(reference, direction)
    right /= np.linalg.norm(right)
    middle = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    offset = vertices - middle
    depth = distance - offset @ direction
    if depth.min() <= 0:
        raise ValueError(f"the camera must be outside of the garment; got distance {distance}")
    image = np.column_stack([offset @ right, offset @ np.cross(direction, right)]) / depth[:, None]
    half = np.abs(image).max(axis=0)
    pixel = float(np.sqrt(np.prod(np.ptp(image, axis=0)) / _FIRST_PIXELS))
    if not pixel > 0:
        raise ValueError("the surface is seen edge on: no point of it is visible")
    sides = _Sides(vertices, faces, tolerance)
    needed, hit, points = _SPARE * count, np.zeros(0, np.int32), np.zeros((0, 3))
    for _ in range(_FINER + 1):
        width, height = (2 * np.ceil(half / pixel).astype(int) + 2).tolist()
        aside = pixel * distance * (rng.random(2) - 0.5)  # random offset of the pixel grid
        camera = PinholeCamera.aim(
            middle + aside @ [right, np.cross(direction, right)],
            direction,
            right,
            distance=distance,
            half_width=width / 2 * pixel * distance,
            size=(width, height),
        )
        hit, points = sides.see(replace(camera, near=0.9 * depth.min(), far=1.1 * depth.max()))
        if len(hit) >= needed:
            break
        pixel *= max(0.25, 0.9 * np.sqrt(max(len(hit), 1) / needed))
    if len(hit) < count:
        raise ValueError(f"{count} points must be visible; got {len(hit)}")
    chosen = np.sort(rng.choice(len(hit), count, replace=False))
    hit = hit[chosen]
    corners = vertices[faces[hit]]  # (N, 3, 3)
    points = (corners * weigh_corners(corners, points[chosen])[..., None]).sum(axis=1)
    nearest = np.linalg.norm(corners - points[:, None], axis=2).argmin(axis=1)
    return View(
        points=points,
        vertices=faces[hit, nearest].astype(np.int32),
        faces=hit,
        direction=direction,
    )


class _Sides:
    """A surface whose inside is visible unless an outside lies just behind it."""

    def __init__(self, vertices: np.ndarray, faces: np.ndarray, tolerance: float) -> None:
        corners = vertices[faces]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        self._planes = np.column_stack([normals, (normals * corners[:, 0]).sum(axis=1)])
        self._tolerance = tolerance
        mesh = Mesh(
            vertices=vertices,
            normals=np.zeros_like(vertices),
            faces=faces,
            surface=SurfaceLook(inside_shade=1.0),
            segment=1,
        )
        outside = replace(mesh, surface=SurfaceLook())
        self._both, self._outside = Rasteriser([mesh]), Rasteriser([outside])

    def see(self, camera: PinholeCamera) -> tuple[np.ndarray, np.ndarray]:
        """Find the triangles that the pixels show.

        Returns:
            Triangle of each covered pixel, shape (P,), int32, and its point [m], shape (P, 3).
        """
        eye, forward = np.array(camera.position), np.array(camera.axes[2])
        both, outside = (r.find_triangles(camera) for r in (self._both, self._outside))
        planes = self._planes[both.faces]
        shows_inside = planes[..., :3] @ eye < planes[..., 3]
        behind = (outside.points - both.points) @ forward  # NaN where no outside is
        is_hidden = shows_inside & (behind < self._tolerance)
        hit = np.where(is_hidden, outside.faces, both.faces)
        points = np.where(is_hidden[..., None], outside.points, both.points)
        return hit[hit >= 0], points[hit >= 0]
