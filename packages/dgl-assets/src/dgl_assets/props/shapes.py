"""Collision shapes of props: primitives and convex pieces in the prop's frame."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from scipy.spatial import ConvexHull, KDTree

from dgl_assets.robots._frames import rotation_from_quaternion

ShapeKind = Literal["box", "capsule", "cylinder", "convex", "mesh"]
Vector3 = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]

_NEAR_FACES = 12  # of a mesh, in which the nearest is looked for


@dataclass(frozen=True, kw_only=True, eq=False)
class PropShape:
    """One solid fixed to a prop. Capsules and cylinders lie along their local z axis."""

    kind: ShapeKind
    radius: float = 0.0
    """Radius [m] of a capsule or cylinder."""
    half_length: float = 0.0
    """Half length [m] of a cylinder, or of a capsule without its caps."""
    half_size: Vector3 = (0.0, 0.0, 0.0)
    """Half sizes [m] of a box along its local axes."""
    points: np.ndarray | None = None
    """Vertices of a mesh, or points whose hull is a convex [m], shape (N, 3), local frame."""
    faces: np.ndarray | None = None
    """Triangles of a closed mesh, counter-clockwise from outside, shape (F, 3)."""
    xyz: Vector3 = (0.0, 0.0, 0.0)
    """Centre [m] in the prop's frame."""
    wxyz: Quaternion = (1.0, 0.0, 0.0, 0.0)
    """Orientation in the prop's frame."""

    def __post_init__(self) -> None:
        round_ = (self.radius, self.half_length)
        sizes = {
            "capsule": round_,
            "cylinder": round_,
            "box": self.half_size,
            "convex": (),
            "mesh": (),
        }
        if self.kind not in sizes:
            raise ValueError(f"kind must be one of {sorted(sizes)}; got {self.kind!r}")
        if any(not s > 0.0 for s in sizes[self.kind]):
            raise ValueError(f"a {self.kind} needs positive sizes; got {sizes[self.kind]}")
        if (self.points is not None) != (self.kind in ("convex", "mesh")):
            raise ValueError(f"points must be given for convex and mesh; kind is {self.kind!r}")
        if (self.faces is not None) != (self.kind == "mesh"):
            raise ValueError(f"faces must be given for a mesh alone; kind is {self.kind!r}")
        if self.points is not None and (self.points.ndim != 2 or self.points.shape[1] != 3):
            raise ValueError(f"points must have shape (N, 3); got {self.points.shape}")

    def compute_distance(self, points: np.ndarray) -> np.ndarray:
        """Compute signed distances, negative inside.

        Args:
            points: Positions [m], shape (N, 3), prop's frame.

        Returns:
            Distances [m], shape (N,). Outside of a convex, beside its edges and corners, they are
            those to the farthest plane, which is too small.
        """
        R = rotation_from_quaternion(np.array(self.wxyz))
        local = (np.asarray(points, dtype=float) - self.xyz) @ R
        if self.kind == "mesh":
            return self._compute_mesh_distance(local)
        if self.kind == "convex":
            assert self.points is not None
            planes = ConvexHull(self.points).equations
            return (local @ planes[:, :3].T + planes[:, 3]).max(axis=1)
        if self.kind == "capsule":
            local[:, 2] -= np.clip(local[:, 2], -self.half_length, self.half_length)
            return np.linalg.norm(local, axis=1) - self.radius
        if self.kind == "cylinder":
            across = np.hypot(local[:, 0], local[:, 1]) - self.radius
            beyond = np.stack([across, np.abs(local[:, 2]) - self.half_length], axis=1)
        else:
            beyond = np.abs(local) - self.half_size
        outside = np.linalg.norm(np.maximum(beyond, 0.0), axis=1)
        return outside + np.minimum(beyond.max(axis=1), 0.0)

    def _compute_mesh_distance(self, local: np.ndarray) -> np.ndarray:
        """Signed distance to the nearest triangle among those of the nearest middles."""
        from trimesh.triangles import closest_point  # takes a second to import

        corners, middles = self._triangles
        near = min(_NEAR_FACES, len(corners))
        _, found = middles.query(local, k=near)
        found = found.reshape(len(local), near)
        asked = np.repeat(local, near, axis=0)
        closest = closest_point(corners[found.ravel()], asked)
        away = np.linalg.norm(asked - closest, axis=1).reshape(len(local), near)
        rows = np.arange(len(local))
        best = away.argmin(axis=1)
        chosen = corners[found[rows, best]]
        normals = np.cross(chosen[:, 1] - chosen[:, 0], chosen[:, 2] - chosen[:, 0])
        offset = local - closest.reshape(len(local), near, 3)[rows, best]
        side = np.einsum("nk,nk->n", offset, normals)
        return np.where(side < 0, -1.0, 1.0) * away[rows, best]

    @cached_property
    def _triangles(self) -> tuple[np.ndarray, KDTree]:
        """Corners of a mesh's triangles [m], shape (F, 3, 3), and their middles."""
        assert self.points is not None
        corners = self.points[self.faces].astype(float)
        return corners, KDTree(corners.mean(axis=1))


def make_box(low: Vector3, high: Vector3) -> PropShape:
    """Make an upright box from its corners [m]."""
    x, y, z = ((np.array(low) + high) / 2).tolist()
    half_x, half_y, half_z = ((np.array(high) - low) / 2).tolist()
    return PropShape(kind="box", half_size=(half_x, half_y, half_z), xyz=(x, y, z))


def make_cylinder(radius: float, low: float, high: float) -> PropShape:
    """Make an upright cylinder about the z axis between two heights [m]."""
    middle, half = (low + high) / 2, (high - low) / 2
    return PropShape(kind="cylinder", radius=radius, half_length=half, xyz=(0.0, 0.0, middle))


def make_capsules(path: np.ndarray, radii: np.ndarray | float) -> tuple[PropShape, ...]:
    """Cover a thick line with capsules.

    Args:
        path: Corners of the line [m], shape (N, 3).
        radii: Radius at each corner, shape (N,), or one for all [m].
    """
    radii = np.broadcast_to(np.asarray(radii, dtype=float), len(path))
    shapes = []
    for a, b, r, s in zip(path[:-1], path[1:], radii[:-1], radii[1:], strict=True):
        length = np.linalg.norm(b - a)
        x, y, z = ((a + b) / 2).tolist()
        q0, q1, q2, q3 = _turn_z_onto((b - a) / length).tolist()
        shapes.append(
            PropShape(
                kind="capsule",
                radius=float((r + s) / 2),
                half_length=float(length / 2),
                xyz=(x, y, z),
                wxyz=(q0, q1, q2, q3),
            )
        )
    return tuple(shapes)


def _turn_z_onto(axis: np.ndarray) -> np.ndarray:
    """Find the shortest rotation of z onto a unit vector, wxyz."""
    x, y, z = axis
    if z < -1.0 + 1e-9:
        return np.array([0.0, 1.0, 0.0, 0.0])
    q = np.array([1.0 + z, -y, x, 0.0])
    return q / np.linalg.norm(q)
