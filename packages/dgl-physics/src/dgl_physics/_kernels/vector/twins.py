"""The twins of all kernels that have one."""

from collections.abc import Callable

from dgl_physics._kernels import bending, cloth, coarse, rigid, selfcontact
from dgl_physics._kernels.vector import bending as vector_bending
from dgl_physics._kernels.vector import cloth as vector_cloth
from dgl_physics._kernels.vector import coarse as vector_coarse
from dgl_physics._kernels.vector import near_shapes as vector_near_shapes
from dgl_physics._kernels.vector import rigid as vector_rigid
from dgl_physics._kernels.vector import selfcontact as vector_selfcontact

__all__ = ["TWINS"]

TWINS: dict[Callable[..., None], Callable[..., None]] = {
    cloth.integrate: vector_cloth.integrate,
    cloth.solve_distances: vector_cloth.solve_distances,
    bending.solve_bending: vector_bending.solve_bending,
    coarse.gather_nodes: vector_coarse.gather_nodes,
    coarse.solve_limits: vector_coarse.solve_limits,
    coarse.move_with_nodes: vector_coarse.move_with_nodes,
    selfcontact.find_neighbours: vector_selfcontact.find_neighbours,
    selfcontact.solve_self_contact: vector_selfcontact.solve_self_contact,
    selfcontact.apply_corrections: vector_selfcontact.apply_corrections,
    rigid.find_near_shapes: vector_near_shapes.find_near_shapes,
    rigid.solve_rigid_contact: vector_rigid.solve_rigid_contact,
}
"""Vector code by the kernel that it replaces on a CPU."""
