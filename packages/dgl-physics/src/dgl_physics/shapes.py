"""Rigid shapes that cloth collides with."""

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from dgl_physics.collision_mesh import CollisionMesh

ShapeKind = Literal["plane", "sphere", "capsule", "box", "cylinder", "convex", "mesh"]

KIND_CODES: dict[str, int] = {
    "plane": 0, "sphere": 1, "capsule": 2, "box": 3, "cylinder": 4, "convex": 5, "mesh": 6,
}  # fmt: skip
_SIZES = {"sphere": 1, "capsule": 1, "box": 3, "cylinder": 2}
"""Number of sizes that must be positive."""


def _identity() -> np.ndarray:
    return np.array([0, 0, 0, 1, 0, 0, 0], dtype=np.float32)


@dataclass(frozen=True, kw_only=True)
class Shape:
    """One rigid primitive or mesh, fixed to a body.

    The plane is the half space z <= 0 of its frame; the axis of capsules and cylinders is their z
    axis. Distances are exact, those of "convex" and "mesh" are interpolated in a grid.
    """

    kind: ShapeKind
    size: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """[m] sphere (radius, -, -); capsule, cylinder (radius, half length, -); box: half sizes."""
    mesh: CollisionMesh | None = None
    """Surface of a "mesh" or a "convex", such as `CollisionMesh.hull`."""
    pose: np.ndarray = field(default_factory=_identity)
    """Pose in the body's frame, xyz [m] + quaternion wxyz, shape (7,)."""
    friction: float = 1.0
    """Factor on the garment's friction; >= 0."""
    is_measured: bool = True
    """Add the impulse of cloth on it to `State.impulse`."""

    def __post_init__(self) -> None:
        if self.kind not in KIND_CODES:
            raise ValueError(f"kind must be one of {sorted(KIND_CODES)}; got {self.kind!r}")
        needed = _SIZES.get(self.kind, 0)
        if any(not s > 0 for s in self.size[:needed]) or any(not s >= 0 for s in self.size):
            raise ValueError(f"size of a {self.kind} must be positive; got {self.size}")
        if (self.mesh is not None) != (self.kind in ("convex", "mesh")):
            raise ValueError(f"mesh must be given for kinds convex and mesh; kind is {self.kind!r}")
        if self.mesh is not None and self.kind == "convex" and not self.mesh.is_convex:
            raise ValueError(
                "mesh of a convex must be convex; use CollisionMesh.hull, or kind='mesh'"
            )
        if np.shape(self.pose) != (7,):
            raise ValueError(f"pose must have shape (7,); got {np.shape(self.pose)}")
        if not self.friction >= 0:
            raise ValueError(f"friction must be >= 0; got {self.friction}")

    def bounding_radius(self) -> float:
        """Radius [m] of the sphere around the shape's or mesh's centre that contains it."""
        if self.kind == "plane":
            return np.inf
        if self.kind == "sphere":
            return self.size[0]
        if self.kind == "capsule":
            return self.size[0] + self.size[1]
        if self.kind == "cylinder":
            return float(np.hypot(self.size[0], self.size[1]))
        if self.mesh is not None:
            return self.mesh.radius
        return float(np.linalg.norm(self.size))
