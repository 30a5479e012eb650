"""Maps of a material, made from colour, height and roughness."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

GAMMA = 2.2
"""sRGB is close to this power law."""
DEFAULT_SIZE = 512
"""Pixels along a side of a tile."""
_SIZES = (32, 2048)


@dataclass(frozen=True, kw_only=True, eq=False)
class MaterialMaps:
    """One square tile of a surface. It repeats without a seam in both directions.

    Columns follow u, rows follow v; the first row is at v = 0, as graphics libraries load it.
    """

    name: str
    base_colour: np.ndarray
    """Shape (H, H, 3), uint8, sRGB."""
    roughness: np.ndarray
    """Shape (H, H), uint8: 0 is a mirror, 255 chalk."""
    normal: np.ndarray
    """Unit normals n as (n + 1) / 2, x along u, y along v, z outward; (H, H, 3), uint8, linear."""
    tile_size: float
    """Side of the tile on the surface [m]."""

    @property
    def mean_colour(self) -> tuple[float, float, float]:
        """Mean base colour, linear, each in [0, 1]."""
        r, g, b = ((self.base_colour.reshape(-1, 3) / 255.0) ** GAMMA).mean(axis=0)
        return float(r), float(g), float(b)

    @property
    def mean_roughness(self) -> float:
        """Mean roughness in [0, 1]."""
        return float(self.roughness.mean() / 255.0)

    def compute_uvs(self, positions: np.ndarray) -> np.ndarray:
        """Lay the material on flat panels at its real scale.

        Args:
            positions: On the flat surface [m], shape (V, 2), such as a garment's `rest_vertices`.

        Returns:
            Texture coordinates in tiles, shape (V, 2), float32.
        """
        positions = np.asarray(positions)
        if positions.ndim != 2 or positions.shape[1] != 2:
            raise ValueError(f"positions must have shape (V, 2); got {positions.shape}")
        return (positions / self.tile_size).astype(np.float32)

    def sample_colour(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Interpolate the base colour between pixels.

        Args:
            x: Positions along u [m], any shape.
            y: Positions along v [m], of the same shape.

        Returns:
            sRGB in [0, 255], shape (..., 3), float64.
        """
        size = len(self.base_colour)
        column, row = (np.asarray(p) / self.tile_size * size - 0.5 for p in (x, y))
        c, r = np.floor(column).astype(int), np.floor(row).astype(int)
        s, t = (column - c)[..., None], (row - r)[..., None]
        c0, c1, r0, r1 = c % size, (c + 1) % size, r % size, (r + 1) % size
        image = self.base_colour
        return (1 - t) * ((1 - s) * image[r0, c0] + s * image[r0, c1]) + t * (
            (1 - s) * image[r1, c0] + s * image[r1, c1]
        )


def check_size(size: int) -> None:
    """Refuse sizes of pictures that cannot be made."""
    low, high = _SIZES
    if not isinstance(size, int | np.integer) or not low <= size <= high:
        raise ValueError(f"size must be a whole number in [{low}, {high}]; got {size!r}")


def get_fine_size(size: int) -> int:
    """Size to compute at: a multiple of `size` that resolves single yarns."""
    check_size(size)
    return size * -(-DEFAULT_SIZE // size)


def make_maps(
    *,
    name: str,
    size: int,
    tile_size: float,
    colour: np.ndarray,
    height: np.ndarray,
    roughness: np.ndarray,
) -> MaterialMaps:
    """Turn fields at the fine size into maps.

    Args:
        name: Of the material.
        size: Pixels along a side of the maps.
        tile_size: Side of the tile [m].
        colour: sRGB in [0, 255], shape (N, N, 3), N a multiple of `size`.
        height: Relief [m], shape (N, N).
        roughness: In [0, 1], shape (N, N).
    """
    spacing = 2 * tile_size / len(height)
    slope_u = (np.roll(height, -1, axis=1) - np.roll(height, 1, axis=1)) / spacing
    slope_v = (np.roll(height, -1, axis=0) - np.roll(height, 1, axis=0)) / spacing
    normal = _reduce(np.stack([-slope_u, -slope_v, np.ones_like(height)], axis=2), size)
    normal /= np.linalg.norm(normal, axis=2, keepdims=True)
    return MaterialMaps(
        name=name,
        base_colour=_quantise(_reduce(colour, size)),
        roughness=_quantise(255 * _reduce(roughness, size)),
        normal=_quantise(127.5 * (normal + 1)),
        tile_size=tile_size,
    )


def _reduce(field: np.ndarray, size: int) -> np.ndarray:
    """Average squares of pixels down to `size` x `size`."""
    k = len(field) // size
    return field.reshape(size, k, size, k, *field.shape[2:]).mean(axis=(1, 3))


def _quantise(values: np.ndarray) -> np.ndarray:
    return np.clip(values + 0.5, 0, 255).astype(np.uint8)
