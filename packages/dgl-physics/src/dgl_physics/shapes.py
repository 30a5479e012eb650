"""Rigid shapes that cloth collides with."""

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

ShapeKind = Literal["plane", "sphere", "capsule", "box"]

KIND_CODES: dict[str, int] = {"plane": 0, "sphere": 1, "capsule": 2, "box": 3}


def _identity() -> np.ndarray:
    return np.array([0, 0, 0, 1, 0, 0, 0], dtype=np.float32)


@dataclass(frozen=True, kw_only=True)
class Shape:
    """One rigid primitive, fixed to a body.

    The plane is the half space z <= 0 of its frame; the capsule's axis is its z axis.
    """

    kind: ShapeKind
    size: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """[m] sphere (radius, -, -); capsule (radius, half length, -); box: half sizes."""
    pose: np.ndarray = field(default_factory=_identity)
    """Pose in the body's frame, xyz [m] + quaternion wxyz, shape (7,)."""
    friction: float = 1.0
    """Factor on the garment's friction; >= 0."""
    is_measured: bool = True
    """Whether the impulse that cloth gives to it is added up in `State.impulse`."""

    def __post_init__(self) -> None:
        if self.kind not in KIND_CODES:
            raise ValueError(f"kind must be one of {sorted(KIND_CODES)}; got {self.kind!r}")
        needed = {"plane": 0, "sphere": 1, "capsule": 1, "box": 3}[self.kind]
        if any(not s > 0 for s in self.size[:needed]) or any(not s >= 0 for s in self.size):
            raise ValueError(f"size of a {self.kind} must be positive; got {self.size}")
        if np.shape(self.pose) != (7,):
            raise ValueError(f"pose must have shape (7,); got {np.shape(self.pose)}")
        if not self.friction >= 0:
            raise ValueError(f"friction must be >= 0; got {self.friction}")

    def bounding_radius(self) -> float:
        """Radius [m] of the sphere around the shape's origin that contains it."""
        if self.kind == "plane":
            return np.inf
        if self.kind == "sphere":
            return self.size[0]
        if self.kind == "capsule":
            return self.size[0] + self.size[1]
        return float(np.linalg.norm(self.size))
