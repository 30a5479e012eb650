"""A garment as arrays."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np


@dataclass(frozen=True, kw_only=True, eq=False)
class Garment:
    """A garment that lies flat in two layers.

    Garment frame: z up, neck towards +y, "left" at -x, centred in x and y by its bounding box, the
    seams at z = 0.
    """

    name: str
    """Catalogue id or a name of the caller's choice."""
    category: str
    """Catalogue category, for example "Tops_LongSleeve"."""
    vertices: np.ndarray
    """Positions [m], shape (V, 3), float32, garment frame. The front layer is uppermost."""
    faces: np.ndarray
    """Triangles, shape (F, 3), int32, normals outward: up in front, down on the back layer."""
    rest_vertices: np.ndarray
    """Positions at rest [m], float32, for rest lengths.

    Cloth: in the flat panels, shape (V, 2); seams have one position, so every edge has one rest
    length. Elastic shell: of the mid surface, shape (V, 3).
    """
    canonical: np.ndarray
    """(u, v, side), shape (V, 3), float32, equal at corresponding points of a category's garments;
    side is +1 on the front, -1 on the back, 0 on a seam of both."""
    face_panels: np.ndarray
    """Index into `panels` per face, shape (F,), int8."""
    panels: tuple[str, ...]
    """Names of the panels."""
    landmarks: dict[str, int]
    """Vertex id of each named point."""
    parameters: dict[str, float | str] = field(default_factory=dict)
    """Measures that it was made from [m, rad]."""
    wall_thickness: float | None = None
    """None for a sheet of cloth; thickness of the wall of an elastic shell [m]."""

    def __post_init__(self) -> None:
        count = len(self.vertices)
        if self.wall_thickness is not None and not (
            math.isfinite(self.wall_thickness) and self.wall_thickness > 0
        ):
            raise ValueError(
                f"wall_thickness must be None or a positive length [m]; got {self.wall_thickness}"
            )
        for name, columns, dtype in (
            ("vertices", 3, np.float32),
            ("rest_vertices", 2 if self.wall_thickness is None else 3, np.float32),
            ("canonical", 3, np.float32),
        ):
            array = getattr(self, name)
            if array.shape != (count, columns) or array.dtype != dtype:
                raise ValueError(
                    f"{name} must have shape ({count}, {columns}) and dtype {np.dtype(dtype)}; "
                    f"got {array.shape} and {array.dtype}"
                )
            if not np.isfinite(array).all():
                raise ValueError(f"{name} must be finite; got NaN or infinity")
        if self.faces.ndim != 2 or self.faces.shape[1] != 3 or self.faces.dtype != np.int32:
            raise ValueError(
                f"faces must have shape (F, 3) and dtype int32; got {self.faces.shape} and "
                f"{self.faces.dtype}"
            )
        if self.face_panels.shape != (len(self.faces),):
            raise ValueError(
                f"face_panels must have shape ({len(self.faces)},); got {self.face_panels.shape}"
            )
        if len(self.faces) and not 0 <= self.faces.min() <= self.faces.max() < count:
            raise ValueError(
                f"faces must index {count} vertices; got {self.faces.min()} to {self.faces.max()}"
            )
        wrong = {k: v for k, v in self.landmarks.items() if not 0 <= v < count}
        if wrong:
            raise ValueError(f"landmarks must index {count} vertices; got {wrong}")

    @property
    def face_layers(self) -> np.ndarray:
        """+1 for faces of the front layer, -1 for the back layer, shape (F,), int8."""
        side = np.sign(self.canonical[self.faces, 2].sum(axis=1))
        return side.astype(np.int8)

    @property
    def extent(self) -> np.ndarray:
        """Size of the bounding box while it lies flat [m], shape (3,)."""
        return np.ptp(self.vertices, axis=0)

    @property
    def area(self) -> float:
        """Area of the cloth, all layers, or of the mid surface of a shell [m^2]."""
        flat = np.zeros((len(self.vertices), 3))
        flat[:, : self.rest_vertices.shape[1]] = self.rest_vertices
        corners = flat[self.faces]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        return float(np.linalg.norm(normals, axis=1).sum() / 2)

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
