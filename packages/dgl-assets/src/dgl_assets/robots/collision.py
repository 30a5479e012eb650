"""Collision shapes in link frames: capsules, boxes, spheres, cylinders and convex meshes."""

from dataclasses import dataclass
from typing import Literal

ShapeKind = Literal["capsule", "box", "sphere", "cylinder", "mesh"]
Vector3 = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]


@dataclass(frozen=True, kw_only=True)
class CollisionShape:
    """One convex shape fixed in a link.

    A capsule is the set of points within `radius` of a segment of length 2 `half_length` along
    the local z axis; a cylinder lies along the same axis; a mesh stands for its convex hull.
    """

    link: str
    """Link that carries the shape."""
    kind: ShapeKind
    radius: float = 0.0
    """Radius [m] of a capsule, cylinder or sphere; zero for others."""
    half_length: float = 0.0
    """Half length [m] of a capsule's segment, without its caps, or of a cylinder."""
    half_size: Vector3 = (0.0, 0.0, 0.0)
    """Half sizes [m] of a box along its local axes."""
    xyz: Vector3 = (0.0, 0.0, 0.0)
    """Centre [m] in the link frame."""
    wxyz: Quaternion = (1.0, 0.0, 0.0, 0.0)
    """Orientation in the link frame."""
    mesh: str = ""
    """File name of a mesh of the robot, in the link frame."""

    def __post_init__(self) -> None:
        sizes = {
            "capsule": (self.radius, self.half_length),
            "sphere": (self.radius,),
            "box": self.half_size,
            "cylinder": (self.radius, self.half_length),
            "mesh": (1.0 if self.mesh else 0.0,),
        }
        if self.kind not in sizes:
            raise ValueError(f"kind must be one of {sorted(sizes)}; got {self.kind!r}")
        if min(sizes[self.kind]) <= 0.0:
            raise ValueError(f"a {self.kind} needs positive sizes; got {sizes[self.kind]}")
