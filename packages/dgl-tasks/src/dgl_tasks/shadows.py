"""Shadows on the floor, drawn as flat shapes.

Shadow maps cost as much as the rest of a picture on a processor. A parallel light throws the shadow
of a convex body onto a plane as a convex polygon, and that of a mesh as the flattened mesh; these
are drawn just above the floor and darken it.

Limitations: nothing but the floor receives a shadow; edges are sharp.
"""

from collections.abc import Sequence

import numpy as np
from sapien import physx

HEIGHT = 0.0008
"""Height of drawn shadows above the floor [m]."""
_OUTLINE = 14  # corners of a convex body's shadow
CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
"""Corners of a cube of side 2 about the origin, shape (8, 3)."""

_TURN = np.arange(16) * np.pi / 8
_RIM = np.column_stack([np.cos(_TURN), np.sin(_TURN)])  # of a cylinder of radius 1

Body = physx.PhysxRigidBaseComponent


class ShadowCaster:
    """The shadow of a garment and of rigid bodies on the ground z = 0, as triangles."""

    def __init__(
        self,
        bodies: Sequence[Body],
        *,
        faces: np.ndarray,
        direction: Sequence[float],
        fixed: Sequence[np.ndarray] = (),
    ) -> None:
        """Collect the shapes that throw shadows.

        Args:
            bodies: Rigid bodies; their convex shapes throw shadows.
            faces: Triangles of the garment, shape (F, 3).
            direction: Where the light goes, shape (3,), downward.
            fixed: Corners of boxes that never move [m], each of shape (8, 3), world frame.
        """
        self._slope = np.asarray(direction[:2], dtype=float) / direction[2]
        described = [(body, _describe(shape)) for body in bodies for shape in body.collision_shapes]
        convex = [(body, *found) for body, found in described if found is not None]
        convex += [(None, corners, 0.0) for corners in fixed]
        self._bodies = [body for body, _, _ in convex]
        self._points = _stack([points for _, points, _ in convex])
        self._radii = np.array([radius for *_, radius in convex])
        fan = np.arange(1, _OUTLINE - 1)
        polygon = np.stack([np.zeros_like(fan), fan, fan + 1], axis=1)
        first = faces.max() + 1 + np.arange(len(self._radii)) * _OUTLINE
        self.faces = np.concatenate([faces, (first[:, None, None] + polygon).reshape(-1, 3)])
        """Triangles of the shadow, shape (G, 3); counter-clockwise ones suffice."""

    def cast(self, positions: np.ndarray) -> np.ndarray:
        """Compute the vertices of the shadow as the bodies are now.

        Args:
            positions: Vertices of the garment [m], shape (V, 3), world frame.

        Returns:
            Places on the ground [m], shape (W, 2).
        """
        poses = [
            np.eye(4) if body is None else body.entity_pose.to_transformation_matrix()
            for body in self._bodies
        ]
        T = np.array(poses, dtype=float).reshape(-1, 4, 4)
        moved = self._points @ T[:, :3, :3].transpose(0, 2, 1) + T[:, None, :3, 3]
        outlines = outline(project(moved, self._slope), self._radii, self._slope)  # (S, K, 2)
        return np.concatenate([project(positions, self._slope), outlines.reshape(-1, 2)])


def project(points: np.ndarray, slope: np.ndarray) -> np.ndarray:
    """Move points [m], shape (..., 3), along the light to z = 0; returns (..., 2).

    What is below the ground stays where it is: it throws no shadow upwards.
    """
    return points[..., :2] - np.maximum(points[..., 2:], 0.0) * slope


def outline(flat: np.ndarray, radii: np.ndarray, slope: np.ndarray) -> np.ndarray:
    """Compute convex outlines of projected point sets that are thickened by spheres.

    Args:
        flat: Projected points [m], shape (S, P, 2).
        radii: Radius of the sphere about each point of a set [m], shape (S,).
        slope: Horizontal way of the light per way up, shape (2,).

    Returns:
        Polygons [m], shape (S, K, 2), counter-clockwise.
    """
    angles = np.arange(_OUTLINE) * 2 * np.pi / _OUTLINE
    normals = np.column_stack([np.cos(angles), np.sin(angles)])  # (K, 2)
    farthest = np.argmax(np.einsum("spd,kd->skp", flat, normals), axis=2)  # (S, K)
    corners = np.take_along_axis(flat, farthest[..., None], axis=1)
    # A sphere's shadow is the ellipse {p : p^T A^-1 p <= r^2} with A = 1 + slope slope^T.
    A = np.eye(2) + np.outer(slope, slope)
    reach = normals @ A / np.sqrt(np.einsum("kd,de,ke->k", normals, A, normals))[:, None]
    return corners + radii[:, None, None] * reach


def _describe(shape: physx.PhysxCollisionShape) -> tuple[np.ndarray, float] | None:
    """Give a convex shape as points [m], frame of its body, thickened by a sphere's radius."""
    radius = 0.0
    if isinstance(shape, physx.PhysxCollisionShapeBox):
        points = CORNERS * np.asarray(shape.half_size)
    elif isinstance(shape, physx.PhysxCollisionShapeCapsule):
        # SAPIEN's capsules and cylinders are along x
        points, radius = CORNERS * [shape.half_length, 0.0, 0.0], float(shape.radius)
    elif isinstance(shape, physx.PhysxCollisionShapeSphere):
        points, radius = CORNERS * 0.0, float(shape.radius)
    elif isinstance(shape, physx.PhysxCollisionShapeCylinder):
        rim = np.column_stack([np.zeros(len(_RIM)), _RIM * shape.radius])
        end = np.array([shape.half_length, 0.0, 0.0])
        points = np.concatenate([rim - end, rim + end])
    elif isinstance(shape, physx.PhysxCollisionShapeConvexMesh):
        points = np.asarray(shape.vertices) * np.asarray(shape.scale)
    else:
        return None
    T = shape.local_pose.to_transformation_matrix()
    return points @ T[:3, :3].T + T[:3, 3], radius


def _stack(sets: Sequence[np.ndarray]) -> np.ndarray:
    """Bring sets of points to one length P by repeating their first, shape (S, P, 3)."""
    count = max(map(len, sets), default=1)
    padded = [np.concatenate([s, np.repeat(s[:1], count - len(s), axis=0)]) for s in sets]
    return np.array(padded, dtype=float).reshape(-1, count, 3)
