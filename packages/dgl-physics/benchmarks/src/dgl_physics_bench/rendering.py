"""Pictures of triangles without a renderer: a depth buffer in numpy, seen from far away."""

from collections.abc import Callable

import numpy as np

from dgl_physics_bench.figures import Picture

__all__ = ["compute_value_limit", "measure_extent", "project", "render"]

OUTSIDE, INSIDE = np.array([0.36, 0.55, 0.76]), np.array([0.90, 0.71, 0.47])
"""Colours of cloth seen from outside and from inside, sRGB."""
SOLID = np.array([0.66, 0.66, 0.68])
LIGHT = np.array([-0.42, 0.50, 0.76])
"""Where light comes from: left, above, behind the viewer."""
LIFT = 0.002
"""Cloth is drawn this far outwards [m], so that of two layers that touch the outer one is seen."""

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
    a, e = np.radians(azimuth), np.radians(elevation)
    towards = np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
    right = np.array([-np.sin(a), np.cos(a), 0.0])
    return points @ np.stack([right, np.cross(towards, right), towards], axis=1)


def measure_extent(picture: Picture) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest corner of what a picture shows, right and up [m], shape (2,)."""
    points = np.concatenate([picture.vertices, *(s.vertices for s in picture.solids)])
    seen = project(points, azimuth=picture.azimuth, elevation=picture.elevation)[:, :2]
    return seen.min(axis=0), seen.max(axis=0)


def compute_value_limit(picture: Picture) -> float:
    """Largest value of a picture's colour scale."""
    if picture.values is None:
        raise ValueError("the picture has no values")
    if picture.value_limit is not None:
        return picture.value_limit
    return max(float(np.percentile(picture.values, 99.9)), 1e-12)


def render(
    picture: Picture,
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
        colour_map: Turns values in [0, 1], shape (N,), into colours, shape (N, 4); for pictures with values.

    Returns:
        sRGB and opacity in [0, 1], shape (H, W, 4).
    """
    scale = width / (2 * half[0])  # pixels a metre
    height = round(2 * half[1] * scale)
    image = np.zeros((height * width, 4))
    depth = np.full(height * width, -np.inf)
    for vertices, faces, front, back in _collect(picture, colour_map):
        seen = project(vertices, azimuth=picture.azimuth, elevation=picture.elevation)
        normals = _compute_normals(seen, faces)
        seen[:, :2] = (seen[:, :2] - centre + np.array(half)) * scale
        lengths = np.linalg.norm(
            seen[faces][:, [0, 1, 2], :2] - seen[faces][:, [1, 2, 0], :2], axis=2
        )
        # samples 0.8 of a pixel apart; triangles of similar size together, as a group shares them
        counts = 3 * np.ceil(1.25 / 3 * lengths.max(axis=1)).astype(int) + 1
        for n in np.unique(counts):
            chosen = np.flatnonzero(counts == n)
            for part in np.array_split(chosen, max(1, len(chosen) * n * n // 4_000_000)):
                _splat(seen, normals, faces[part], front[part], back[part], int(n), image, depth, width)  # fmt: skip
    return image.reshape(height, width, 4)[::-1]


def _collect(
    picture: Picture, colour_map: ColourMap | None
) -> list[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]]:
    """Vertices, faces, and colours of the faces' front and back, of cloth and of solids."""
    faces = picture.faces
    if picture.values is None:
        front, back = np.tile(OUTSIDE, (len(faces), 1)), np.tile(INSIDE, (len(faces), 1))
    elif colour_map is None:
        raise ValueError("a picture with values must come with a colour map")
    else:
        share = np.clip(picture.values / compute_value_limit(picture), 0, 1)
        front = back = np.asarray(colour_map(share))[:, :3]
    lifted = picture.vertices + LIFT * _compute_normals(picture.vertices, faces)
    parts = [(lifted, faces, front, back)]
    for solid in picture.solids:
        grey = np.tile(SOLID, (len(solid.faces), 1))
        parts.append((np.asarray(solid.vertices, dtype=float), solid.faces, grey, grey))
    return parts


def _compute_normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    normals = np.zeros(vertices.shape)
    np.add.at(normals, faces, np.cross(b - a, c - a)[:, None])
    return normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-15)


def _splat(
    seen: np.ndarray,
    normals: np.ndarray,
    faces: np.ndarray,
    front: np.ndarray,
    back: np.ndarray,
    n: int,
    image: np.ndarray,
    depth: np.ndarray,
    width: int,
) -> None:
    """Put samples of triangles into the image where they are nearer than what is there."""
    i, j = np.meshgrid(np.arange(n + 1), np.arange(n + 1), indexing="ij")
    keep = i + j <= n
    weights = np.stack([i[keep], j[keep], n - i[keep] - j[keep]], axis=1) / n  # (S, 3)
    points = weights @ seen[faces]  # (F, S, 3)
    column, row = np.floor(points[..., 0]).astype(int), np.floor(points[..., 1]).astype(int)
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < len(depth) // width)
    face, sample = np.nonzero(inside)
    pixel = (row * width + column)[inside]
    z = points[..., 2][inside]
    before = depth[pixel]
    np.maximum.at(depth, pixel, z)
    best = np.flatnonzero((z > before) & (z == depth[pixel]))
    corner = normals[faces[face[best]]]  # (P, 3, 3)
    normal = (weights[sample[best]][:, :, None] * corner).sum(axis=1)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    a, b, c = (seen[faces[face[best], k], :2] for k in range(3))
    is_front = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0] > 0
    facing = np.where(is_front[:, None], normal, -normal)
    shade = 0.45 + 0.55 * np.clip(facing @ LIGHT, 0, 1)
    colour = np.where(is_front[:, None], front[face[best]], back[face[best]])
    image[pixel[best], :3] = np.clip(colour * shade[:, None], 0, 1)
    image[pixel[best], 3] = 1.0
