"""What can be drawn: triangle meshes and how their surfaces look."""

from dataclasses import dataclass

import numpy as np

SHADOW = -1
"""Segment of a mesh that is no surface but a shadow: it darkens what is behind it."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Image:
    """A picture that is laid on a surface; its first row is at v = 0."""

    pixels: np.ndarray
    """Shape (H, W, 3), uint8, sRGB."""
    is_repeated: bool = True
    """Whether it repeats; otherwise its edge goes on."""

    def build_levels(self) -> list[np.ndarray]:
        """Halve the picture again and again, shapes (H, W, 3), uint8.

        By the mean of sRGB values, as SAPIEN does: patterns from afar are darker than by that of linear ones.
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
    """How a surface looks, as in glTF: a blend of plastic and metal."""

    colour: tuple[float, float, float] = (1.0, 1.0, 1.0)
    """Linear, each in [0, 1]; unused with an image."""
    roughness: float = 1.0
    """0 for a mirror, 1 for chalk."""
    metallic: float = 0.0
    """0 for plastic, 1 for bare metal."""
    specular: float = 0.0
    """Share of the light that falls straight on it and is reflected, metal aside; 0.04 for most plastics."""
    image: Image | None = None
    inside_shade: float = 0.0
    """Brightness of its back, a factor on the linear colour; 0 where the back is not seen."""


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
    """What the segmentation picture shows of it; `SHADOW` for a shadow."""
    body: int | None = None
    """Number of the body it moves with; None for what never moves, whose frame is the world's."""
    uvs: np.ndarray | None = None
    """Places in the surface's image, shape (V, 2)."""
