"""Triangle meshes to draw, and the look of their surfaces."""

from dataclasses import dataclass

import numpy as np

SHADOW = -1
"""Segment of a shadow, which darkens the pixels behind it."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Image:
    """A texture; its first row is at v = 0."""

    pixels: np.ndarray
    """Shape (H, W, 3), uint8, sRGB."""
    is_repeated: bool = True
    """Repeat the picture; otherwise its edge is extended."""

    def build_levels(self) -> list[np.ndarray]:
        """Build mipmaps, shapes (H, W, 3), uint8.

        By the mean of sRGB values, as in SAPIEN, which darkens distant patterns.
        """
        levels = [self.pixels]
        while min(levels[-1].shape[:2]) > 1:
            height, width = (n // 2 * 2 for n in levels[-1].shape[:2])
            fine = levels[-1][:height, :width].astype(np.uint16)
            rows = fine[::2] + fine[1::2]
            levels.append(((rows[:, ::2] + rows[:, 1::2] + 2) // 4).astype(np.uint8))
        return levels


@dataclass(frozen=True, kw_only=True, eq=False)
class SurfaceLook:
    """Look of a surface, as in glTF: a blend of plastic and metal."""

    colour: tuple[float, float, float] = (1.0, 1.0, 1.0)
    """Linear, each in [0, 1]; unused with an image."""
    roughness: float = 1.0
    """0 for a mirror, 1 for chalk."""
    metallic: float = 0.0
    """0 for plastic, 1 for bare metal."""
    specular: float = 0.0
    """Share of perpendicular light that is reflected, metal aside; 0.04 for most plastics."""
    image: Image | None = None
    inside_shade: float = 0.0
    """Brightness of the back, a factor on the linear colour; 0 to cull it."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Mesh:
    """Triangles of one surface on one body."""

    vertices: np.ndarray
    """[m], shape (V, 3), frame of the body."""
    normals: np.ndarray
    """Of the vertices, shape (V, 3), frame of the body."""
    faces: np.ndarray
    """Vertex indices, counter-clockwise from outside, shape (F, 3)."""
    surface: SurfaceLook
    segment: int
    """Number in the segmentation; `SHADOW` for a shadow."""
    body: int | None = None
    """Number of its body; None for a fixed mesh, in the world frame."""
    uvs: np.ndarray | None = None
    """Texture coordinates, shape (V, 2)."""
