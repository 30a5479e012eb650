"""Props: parts for pictures, shapes for collisions, and landmarks."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from dgl_assets.materials import WoodMaterial
from dgl_assets.props.shapes import PropShape
from dgl_assets.robots._frames import rotation_from_quaternion

Colour = tuple[float, float, float]


@dataclass(frozen=True, kw_only=True)
class Finish:
    """Surface of a part."""

    name: str
    colour: Colour
    """Base colour, linear, each in [0, 1]; the mean of the wood's where there is one."""
    roughness: float
    """0 for a mirror, 1 for chalk."""
    metallic: float = 0.0
    """0 for wood and paint, 1 for bare metal."""
    density: float
    """[kg/m^3]."""
    wood: WoodMaterial | None = None
    """Grain, to be laid on by the part's texture coordinates."""


@dataclass(frozen=True, kw_only=True, eq=False)
class PropPart:
    """A triangle mesh of one finish: closed, or closed together with the other parts."""

    name: str
    vertices: np.ndarray
    """Positions [m], shape (V, 3), float32, prop's frame; split where edges are sharp."""
    faces: np.ndarray
    """Shape (F, 3), int32, counter-clockwise from outside."""
    normals: np.ndarray
    """Unit normals, shape (V, 3), float32."""
    uvs: np.ndarray
    """Texture coordinates [m], shape (V, 2), float32, u along the grain; divide them by the
    material's tile size."""
    finish: Finish
    is_solid: bool = True
    """Covered by collision shapes; other parts are for pictures only."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Prop:
    """An object that garments are hung on, laid on or put on.

    Its frame has z up, z = 0 on the ground, and the target at x = y = 0, so that a pose on the
    ground is where the target is.
    """

    kind: str
    parts: tuple[PropPart, ...]
    shapes: tuple[PropShape, ...]
    """Collision shapes for cloth and robots."""
    landmarks: Mapping[str, np.ndarray]
    """Named points [m], shape (3,), prop's frame; motions are relative to "target"."""
    mass: float
    """[kg], of the solid parts."""
    parameters: Mapping[str, object] = field(default_factory=dict)

    @property
    def extent(self) -> np.ndarray:
        """Lower and upper corner of the solid parts [m], shape (2, 3)."""
        points = np.concatenate([part.vertices for part in self.parts if part.is_solid])
        return np.stack([points.min(axis=0), points.max(axis=0)])

    def compute_landmarks(self, pose: np.ndarray) -> dict[str, np.ndarray]:
        """Compute the landmarks of a prop at a pose.

        Args:
            pose: xyz [m] + quaternion wxyz, shape (7,).

        Returns:
            Positions by name [m], shape (3,), frame of the pose.
        """
        pose = np.asarray(pose, dtype=float)
        if pose.shape != (7,):
            raise ValueError(f"pose must have shape (7,); got {pose.shape}")
        R = rotation_from_quaternion(pose[3:])
        return {name: R @ point + pose[:3] for name, point in self.landmarks.items()}

    def compute_distance(self, points: np.ndarray) -> np.ndarray:
        """Distances to the nearest collision shape [m], shape (N,), negative inside."""
        return np.min([shape.compute_distance(points) for shape in self.shapes], axis=0)
