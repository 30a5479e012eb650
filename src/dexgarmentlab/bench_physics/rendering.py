"""Shaded triangles as polygons, from the back to the front: pictures that need no renderer."""

from dataclasses import dataclass

import numpy as np

from dexgarmentlab.bench_physics.figures import Picture

__all__ = ["Polygons", "project", "render"]

OUTSIDE, INSIDE = np.array([0.33, 0.52, 0.72]), np.array([0.86, 0.66, 0.42])
"""Colours of cloth seen from outside and from inside, sRGB."""
SOLID = np.array([0.62, 0.62, 0.64])


@dataclass(frozen=True, kw_only=True)
class Polygons:
    """Triangles in the plane of the picture, those in front last."""

    corners: np.ndarray
    """[m], shape (N, 3, 2)."""
    colours: np.ndarray
    """sRGB, shape (N, 3)."""


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


def render(picture: Picture, colour_map: object = None) -> Polygons:
    """Shade and sort the triangles of a picture.

    Args:
        picture: What is seen.
        colour_map: Function of values in [0, 1], shape (N,), to colours, shape (N, 4), for pictures
            with values.
    """
    parts, colours = [], []
    cloth = picture.vertices[picture.faces]
    if picture.values is not None:
        if not callable(colour_map):
            raise ValueError("a picture with values must come with a colour map")
        base = np.asarray(colour_map(np.clip(picture.values / value_limit(picture), 0, 1)))[:, :3]
        both = (base, base)
    else:
        both = (np.tile(OUTSIDE, (len(cloth), 1)), np.tile(INSIDE, (len(cloth), 1)))
    for corners, (front, back) in [
        (cloth, both),
        *(
            (s.vertices[s.faces], (np.tile(SOLID, (len(s.faces), 1)),) * 2)
            for s in picture.solids
        ),
    ]:
        seen = project(corners, azimuth=picture.azimuth, elevation=picture.elevation)
        normal = np.cross(seen[:, 1] - seen[:, 0], seen[:, 2] - seen[:, 0])
        normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
        is_front = normal[:, 2] > 0
        facing = np.where(is_front[:, None], normal, -normal)
        light = np.array([-0.35, 0.55, 0.76])
        shade = 0.52 + 0.48 * np.clip(facing @ light, 0, 1)
        parts.append(seen)
        colours.append(np.where(is_front[:, None], front, back) * shade[:, None])
    seen, colour = np.concatenate(parts), np.concatenate(colours)
    order = np.argsort(seen[:, :, 2].mean(axis=1), kind="stable")
    return Polygons(corners=seen[order][:, :, :2], colours=np.clip(colour[order], 0, 1))


def value_limit(picture: Picture) -> float:
    """Largest value of a picture's colour scale."""
    if picture.values is None:
        raise ValueError("the picture has no values")
    if picture.value_limit is not None:
        return picture.value_limit
    return max(float(np.percentile(picture.values, 99.9)), 1e-12)
