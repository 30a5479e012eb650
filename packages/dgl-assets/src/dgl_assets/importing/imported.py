"""A garment that was imported, as arrays."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from dgl_assets.importing.topology import compute_normals


@dataclass(frozen=True, kw_only=True, eq=False)
class ImportedGarment:
    """A garment from a file.

    It has the fields of `dgl_assets.Garment` that simulation and tasks need, under the same names.
    It has neither panels nor canonical coordinates: points on it are found by its landmarks or by a
    trained matcher.

    Garment frame: z up, neck or waist towards +y, front up, "left" at -x, centred by its bounding
    box. Hats stand on
    their rim.
    """

    name: str
    """Name of its folder."""
    category: str
    """Catalogue category, for example "Tops_LongSleeve"."""
    vertices: np.ndarray
    """Positions [m], shape (V, 3), float32, garment frame."""
    faces: np.ndarray
    """Triangles, shape (F, 3), int32, normals outward."""
    rest_vertices: np.ndarray
    """Unstrained positions as in the file, before it was laid flat [m], (V, 3), float32."""
    landmarks: Mapping[str, int] = field(default_factory=dict)
    """Vertex id of each named point."""
    uvs: np.ndarray | None = None
    """Texture coordinates of each corner, v upwards, shape (F, 3, 2), float32."""
    texture: Path | None = None
    """Picture on the cloth, PNG or JPEG."""
    wall_thickness: float | None = None
    """Thickness of the wall around the mesh [m] of hats and gloves; None for a sheet of cloth."""
    meta: Mapping[str, Any] = field(default_factory=dict)
    """Content of meta.json: source, licence, assumptions."""

    def __post_init__(self) -> None:
        count = len(self.vertices)
        for name in ("vertices", "rest_vertices"):
            array = getattr(self, name)
            if (
                array.shape != (count, 3)
                or array.dtype != np.float32
                or not np.isfinite(array).all()
            ):
                raise ValueError(
                    f"{name} must be finite, of shape ({count}, 3) and dtype float32; got "
                    f"{array.shape} and "
                    f"{array.dtype}"
                )
        if self.faces.ndim != 2 or self.faces.shape[1] != 3 or self.faces.dtype != np.int32:
            raise ValueError(
                f"faces must have shape (F, 3) and dtype int32; got {self.faces.shape} and "
                f"{self.faces.dtype}"
            )
        if not len(self.faces) or not 0 <= self.faces.min() <= self.faces.max() < count:
            raise ValueError(f"faces must index {count} vertices, and there must be some")
        if self.uvs is not None and self.uvs.shape != (len(self.faces), 3, 2):
            raise ValueError(f"uvs must have shape ({len(self.faces)}, 3, 2); got {self.uvs.shape}")
        wrong = {name: vertex for name, vertex in self.landmarks.items() if not 0 <= vertex < count}
        if wrong:
            raise ValueError(f"landmarks must index {count} vertices; got {wrong}")

    @property
    def extent(self) -> np.ndarray:
        """Size of the bounding box [m], shape (3,)."""
        return np.ptp(self.vertices, axis=0)

    @property
    def area(self) -> float:
        """Area of the unstrained cloth, all layers [m^2]."""
        return float(compute_normals(self.rest_vertices.astype(np.float64), self.faces)[1].sum())

    def get_landmark_positions(self, names: tuple[str, ...]) -> np.ndarray:
        """Positions of named points [m], shape (K, 3), garment frame.

        Raises:
            KeyError: If a name is unknown; the message lists the valid ones.
        """
        unknown = [name for name in names if name not in self.landmarks]
        if unknown:
            raise KeyError(
                f"unknown landmarks {unknown}; expected some of {sorted(self.landmarks)}"
            )
        return self.vertices[[self.landmarks[name] for name in names]]
