"""Garments as arrays."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np


@dataclass(frozen=True, kw_only=True, eq=False)
class GarmentShape:
    """Shape of a garment, made in code or imported.

    Garment frame: z up, neck or waist towards +y, front up, "left" at -x, centred in x and y by its
    bounding box.
    """

    name: str
    """Catalogue id, name of a folder, or a name of the caller's choice."""
    category: str
    """Catalogue category, for example "Tops_LongSleeve"."""
    vertices: np.ndarray
    """Positions [m], shape (V, 3), float32, garment frame. The front layer is uppermost."""
    faces: np.ndarray
    """Triangles, shape (F, 3), int32, normals outward: up in front, down on the back layer."""
    rest_vertices: np.ndarray
    """Unstrained positions [m], shape (V, 2) or (V, 3), float32, for rest lengths."""
    landmarks: Mapping[str, int] = field(default_factory=dict)
    """Vertex id of each named point."""
    wall_thickness: float | None = None
    """None for a sheet of cloth; thickness of the wall of an elastic shell [m]."""

    def __post_init__(self) -> None:
        count, thickness = len(self.vertices), self.wall_thickness
        if thickness is not None and not (math.isfinite(thickness) and thickness > 0):
            raise ValueError(
                f"wall_thickness must be None or a positive length [m]; got {thickness}"
            )
        self._check_array("vertices", 3)
        self._check_array("rest_vertices", self.rest_vertices.shape[-1])
        if self.faces.ndim != 2 or self.faces.shape[1] != 3 or self.faces.dtype != np.int32:
            raise ValueError(
                f"faces must have shape (F, 3) and dtype int32; got {self.faces.shape} and "
                f"{self.faces.dtype}"
            )
        if len(self.faces) and not 0 <= self.faces.min() <= self.faces.max() < count:
            raise ValueError(
                f"faces must index {count} vertices; got {self.faces.min()} to {self.faces.max()}"
            )
        wrong = {name: vertex for name, vertex in self.landmarks.items() if not 0 <= vertex < count}
        if wrong:
            raise ValueError(f"landmarks must index {count} vertices; got {wrong}")

    def _check_array(self, name: str, columns: int) -> None:
        array, shape = getattr(self, name), (len(self.vertices), columns)
        if array.shape != shape or array.dtype != np.float32:
            raise ValueError(
                f"{name} must have shape {shape} and dtype float32; got {array.shape} and "
                f"{array.dtype}"
            )
        if not np.isfinite(array).all():
            raise ValueError(f"{name} must be finite; got NaN or infinity")

    @property
    def extent(self) -> np.ndarray:
        """Size of the bounding box [m], shape (3,)."""
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


@dataclass(frozen=True, kw_only=True, eq=False)
class Garment(GarmentShape):
    """A garment that lies flat in two layers, the seams at z = 0.

    `rest_vertices` of cloth are in the flat panels, shape (V, 2); seams have one position, so every
    edge has one rest length. Those of an elastic shell are of the mid surface, shape (V, 3).
    """

    canonical: np.ndarray
    """(u, v, side), shape (V, 3), float32, equal at corresponding points of a category's garments;
    side is +1 on the front, -1 on the back, 0 on a seam of both."""
    face_panels: np.ndarray
    """Index into `panels` per face, shape (F,), int8."""
    panels: tuple[str, ...]
    """Names of the panels."""
    parameters: dict[str, float | str] = field(default_factory=dict)
    """Measures that it was made from [m, rad]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self._check_array("rest_vertices", 2 if self.wall_thickness is None else 3)
        self._check_array("canonical", 3)
        if self.face_panels.shape != (len(self.faces),):
            raise ValueError(
                f"face_panels must have shape ({len(self.faces)},); got {self.face_panels.shape}"
            )

    @property
    def face_layers(self) -> np.ndarray:
        """+1 for faces of the front layer, -1 for the back layer, shape (F,), int8."""
        side = np.sign(self.canonical[self.faces, 2].sum(axis=1))
        return side.astype(np.int8)
