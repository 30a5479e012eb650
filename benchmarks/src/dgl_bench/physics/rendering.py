"""Pictures of triangles for figures, seen from far away: flat colours under one lamp."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dgl_bench.physics.figures import ClothView
from dgl_physics.drawing.camera import PinholeCamera
from dgl_physics.drawing.mesh import Mesh, SurfaceLook
from dgl_physics.drawing.rasteriser import Rasteriser, weigh_corners
from dgl_physics.topology import compute_vertex_normals

__all__ = ["compute_value_limit", "measure_extent", "project", "render"]

OUTSIDE, INSIDE = np.array([0.36, 0.55, 0.76]), np.array([0.90, 0.71, 0.47])
"""Colours of cloth seen from outside and from inside, sRGB."""
SOLID = np.array([0.66, 0.66, 0.68])
LIGHT = np.array([-0.42, 0.50, 0.76])
"""Direction to the light: left, above, behind the viewer."""
LIFT = 0.002
"""Cloth is drawn this far outwards [m], so that of two layers that touch the outer one is seen."""

_FINER = 3  # times that the picture is drawn finer than it becomes
_DISTANCE = 200.0  # of the camera, times the size of what is seen

ColourMap = Callable[[np.ndarray], np.ndarray]


def project(points: np.ndarray, *, azimuth: float, elevation: float) -> np.ndarray:
    """Turn points into the frame of an orthographic camera.

    Args:
        points: [m], shape (..., 3).
        azimuth: Direction from which is looked [deg], from +x towards +y.
        elevation: Height from which is looked [deg].

    Returns:
        Right, up and towards the viewer [m], shape (..., 3).
    """
    return points @ _make_axes(azimuth, elevation).T


def _make_axes(azimuth: float, elevation: float) -> np.ndarray:
    """Rows are right, up and towards the viewer, shape (3, 3)."""
    a, e = np.radians(azimuth), np.radians(elevation)
    towards = np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
    right = np.array([-np.sin(a), np.cos(a), 0.0])
    return np.stack([right, np.cross(towards, right), towards])


def measure_extent(picture: ClothView) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest corner of what a picture shows, right and up [m], shape (2,)."""
    points = np.concatenate([picture.vertices, *(s.vertices for s in picture.solids)])
    seen = project(points, azimuth=picture.azimuth, elevation=picture.elevation)[:, :2]
    return seen.min(axis=0), seen.max(axis=0)


def compute_value_limit(picture: ClothView) -> float:
    """Largest value of a picture's colour scale."""
    if picture.values is None:
        raise ValueError("the picture has no values")
    if picture.value_limit is not None:
        return picture.value_limit
    return max(float(np.percentile(picture.values, 99.9)), 1e-12)


def render(
    picture: ClothView,
    *,
    centre: np.ndarray,
    half: tuple[float, float],
    width: int,
    colour_map: ColourMap | None = None,
) -> np.ndarray:
    """Draw a picture.

    Args:
        picture: What is seen.
        centre: Middle of the image, right and up [m], shape (2,).
        half: Half of its width and height [m].
        width: Its width in pixels.
        colour_map: Turns values in [0, 1], shape (N,), into colours, shape (N, 4); for pictures
            with values.

    Returns:
        sRGB and opacity in [0, 1], shape (H, W, 4).
    """
    right, up, towards = _make_axes(picture.azimuth, picture.elevation)
    parts = _collect(picture, colour_map)
    reach = max(np.ptp(part.vertices, axis=0).max() for part in parts)
    size = (_FINER * width, _FINER * round(width * half[1] / half[0]))
    camera = PinholeCamera.aim(
        np.stack([right, up]).T @ centre + towards * (picture.vertices.mean(axis=0) @ towards),
        towards,
        right,
        distance=_DISTANCE * reach,
        half_width=half[0],
        size=size,
    )
    seen = Rasteriser([part.make_mesh() for part in parts]).find_triangles(camera)
    image = np.zeros((size[1], size[0], 4))
    for number, part in enumerate(parts):
        is_own = seen.meshes == number
        image[is_own, :3] = part.shade(
            seen.faces[is_own], seen.points[is_own], np.stack([right, up, towards])
        )
        image[is_own, 3] = 1.0
    small = image.reshape(size[1] // _FINER, _FINER, width, _FINER, 4).mean(axis=(1, 3))
    small[..., :3] /= np.maximum(small[..., 3:], 1e-9)
    return small


@dataclass(frozen=True, kw_only=True, eq=False)
class _Part:
    """A mesh with the colours of its triangles' two sides, sRGB, shape (F, 3)."""

    vertices: np.ndarray
    faces: np.ndarray
    front: np.ndarray
    back: np.ndarray

    def make_mesh(self) -> Mesh:
        return Mesh(
            vertices=self.vertices,
            normals=np.zeros_like(self.vertices),
            faces=self.faces,
            surface=SurfaceLook(inside_shade=1.0),
            segment=1,
        )

    def shade(self, faces: np.ndarray, points: np.ndarray, axes: np.ndarray) -> np.ndarray:
        """Colours of places on triangles, sRGB, shape (P, 3), seen along the last of the axes."""
        corners = self.faces[faces]
        weights = weigh_corners(self.vertices[corners], points)
        normals = compute_vertex_normals(self.vertices, self.faces)[corners]
        normal = (weights[..., None] * normals).sum(axis=1) @ axes.T
        normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
        a, b, c = (self.vertices[corners[:, k]] for k in range(3))
        is_front = (np.cross(b - a, c - a) @ axes[2] > 0)[:, None]
        shade = 0.45 + 0.55 * np.clip(np.where(is_front, normal, -normal) @ LIGHT, 0, 1)
        colour = np.where(is_front, self.front[faces], self.back[faces])
        return np.clip(colour * shade[:, None], 0, 1)


def _collect(picture: ClothView, colour_map: ColourMap | None) -> list[_Part]:
    """Cloth and solids."""
    faces = picture.faces
    if picture.values is None:
        front, back = np.tile(OUTSIDE, (len(faces), 1)), np.tile(INSIDE, (len(faces), 1))
    elif colour_map is None:
        raise ValueError("a picture with values must come with a colour map")
    else:
        share = np.clip(picture.values / compute_value_limit(picture), 0, 1)
        front = back = np.asarray(colour_map(share))[:, :3]
    lifted = picture.vertices + LIFT * compute_vertex_normals(picture.vertices, faces)
    parts = [_Part(vertices=lifted, faces=faces, front=front, back=back)]
    for solid in picture.solids:
        grey = np.tile(SOLID, (len(solid.faces), 1))
        vertices = np.asarray(solid.vertices, dtype=float)
        parts.append(_Part(vertices=vertices, faces=solid.faces, front=grey, back=grey))
    return parts
