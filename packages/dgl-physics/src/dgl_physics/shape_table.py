"""Rigid shapes as arrays for the kernels."""

# What wp.struct returns is no class to pyright.
# pyright: reportGeneralTypeIssues=false
from collections.abc import Sequence

import numpy as np
import warp as wp

from dgl_physics._kernels.types import Grid, ShapeTable
from dgl_physics.collision_mesh import CollisionMesh
from dgl_physics.distance_grid import FINE_NODES
from dgl_physics.shapes import KIND_CODES, Shape


def build_shape_table(
    shapes: Sequence[tuple[int, Shape]], contact_gap: float, device: str
) -> tuple[ShapeTable, tuple[Grid, ...]]:
    """Build the table of pairs of a body and its shape.

    `contact_gap` is the largest distance of a particle from a surface that acts on it [m].

    Returns:
        The table, and the grids of its meshes, which must be kept as long as the table: it points
        to their arrays without owning them.

    Raises:
        ValueError: If a mesh's grid has a smaller reach.
    """
    meshes = list({id(s.mesh): s.mesh for _, s in shapes if s.mesh is not None}.values())
    for mesh in meshes:
        if mesh.reach < contact_gap:
            raise ValueError(
                f"reach of a CollisionMesh must be >= {contact_gap} m, the largest rest_offset + "
                f"adhesion_radius of the garments; got {mesh.reach}"
            )
    number = {id(mesh): k for k, mesh in enumerate(meshes)}
    poses = np.array([s.pose for _, s in shapes], dtype=np.float64).reshape(-1, 7)
    for pose, (_, shape) in zip(poses, shapes, strict=True):
        if shape.mesh is not None:  # its grid is around its centre
            pose[:3] += _rotate(pose[3:], shape.mesh.centre)
    poses = poses[:, [0, 1, 2, 4, 5, 6, 3]]  # Warp stores quaternions as xyzw

    def to_device(values: list | np.ndarray, dtype: type) -> wp.array:
        return wp.array(values, dtype=dtype, device=device)

    table = ShapeTable()
    table.kind = to_device([KIND_CODES[s.kind] for _, s in shapes], wp.int32)
    table.size = to_device([s.size for _, s in shapes], wp.vec3)
    table.pose = to_device(poses.astype(np.float32), wp.transform)
    table.body = to_device([b for b, _ in shapes], wp.int32)
    table.friction = to_device([s.friction for _, s in shapes], wp.float32)
    table.radius = to_device([s.bounding_radius() for _, s in shapes], wp.float32)
    table.is_moving = to_device([int(b > 0) for b, _ in shapes], wp.int32)
    table.is_measured = to_device([int(s.is_measured) for _, s in shapes], wp.int32)
    table.grid = to_device([number.get(id(s.mesh), -1) for _, s in shapes], wp.int32)
    grids = tuple(_to_struct(mesh, device) for mesh in meshes)
    table.grids = wp.array(list(grids), dtype=Grid, device=device)
    return table, grids


def _to_struct(mesh: CollisionMesh, device: str) -> Grid:
    grid = mesh.grid
    index = grid.fine_index.reshape(-1)
    first_fine = np.where(index >= 0, grid.coarse.size + index * FINE_NODES, -1)
    value = np.concatenate([grid.coarse.reshape(-1), grid.fine.reshape(-1)])
    s = Grid()
    s.lower = wp.vec3(*grid.lower)
    s.spacing = grid.spacing
    s.blocks = wp.vec3i(*grid.fine_index.shape)
    s.reach = grid.reach
    s.first_fine = wp.array(first_fine.astype(np.int32), dtype=wp.int32, device=device)
    s.value = wp.array(value.astype(np.float32), dtype=wp.float32, device=device)
    return s


def _rotate(q: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Rotate a vector by a quaternion wxyz."""
    t = 2 * np.cross(q[1:], x)
    return x + q[0] * t + np.cross(q[1:], t)
