"""Contact of the middles of edges with rigid shapes."""

# What wp.struct returns is no class to pyright.
# pyright: reportGeneralTypeIssues=false
from itertools import pairwise

import warp as wp

from dgl_physics._kernels import edge_contact
from dgl_physics._kernels.types import SolverLimits
from dgl_physics.model import Model
from dgl_physics.near_shapes import NearShapes
from dgl_physics.state import State

__all__ = ["EdgeContact"]


class EdgeContact:
    """The edges near rigid shapes, and their contact.

    On a CPU they are listed once a frame: few edges are near a shape.
    """

    def __init__(self, model: Model, limits: SolverLimits, near: NearShapes) -> None:
        self._model, self._limits, self._near = model, limits, near
        self._is_listed = model.device == "cpu"
        count = len(model.pairs) if self._is_listed else 0
        self._listed = wp.zeros(count, dtype=wp.int32, device=model.device)
        self._listed_count = wp.zeros(1, dtype=wp.int32, device=model.device)

    def find(self) -> None:
        """List the edges that may touch shapes within this frame, after `NearShapes.search`."""
        if self._is_listed:
            wp.launch(
                edge_contact.list_near_edges,
                dim=1,
                inputs=[
                    self._model.pairs, self._near.near_bodies, self._listed, self._listed_count
                ],
            )  # fmt: skip

    def solve(self, state: State, dt: float, inverse_mass: wp.array, previous: wp.array) -> None:
        """Push edges out of shapes; `previous` holds positions at the start of the substep."""
        m, near = self._model, self._near
        inputs = [
            dt, m.particles_per_env, self._limits, m.shapes, m.pairs, m.garment_index, m.materials,
            inverse_mass, near.active, near.pose_before, near.pose_now, near.near,
            near.near_bodies, previous, state.positions, state.impulse,
        ]  # fmt: skip
        if self._is_listed:
            inputs = [self._listed, self._listed_count, *inputs]
            wp.launch(edge_contact.solve_listed_edges, dim=1, inputs=inputs)
            return
        for first, end in pairwise(m.colour_start):
            wp.launch(edge_contact.solve_edge_contact, dim=end - first, inputs=[first, *inputs])
