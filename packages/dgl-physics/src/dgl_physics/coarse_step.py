"""What the coarse level does in a substep: it carries tension across a garment at once."""

import warp as wp

from dgl_physics._kernels import coarse
from dgl_physics.model import Model
from dgl_physics.state import State

__all__ = ["CoarseStep"]

ACCELERATION = 200.0
"""Most acceleration that the coarse level gives to a particle [m/s^2]."""


class CoarseStep:
    """Limits on the distances between the nodes of the coarse level, see `dgl_physics.coarse`."""

    def __init__(self, model: Model, sweeps: int) -> None:
        """Make it.

        Args:
            model: What is simulated.
            sweeps: Passes over the limits in each substep; 0 leaves them out.
        """
        self._model, self._sweeps = model, sweeps
        device, nodes = model.device, max(model.coarse.node_count, 1)
        count = model.env_count * model.particles_per_env
        self.tension = wp.zeros(count, dtype=wp.vec3, device=device)
        """What pulled at each particle that sticks to a shape [m]; it moves nothing by itself."""
        self._centre, self._centre_before, self._reaction = (
            wp.zeros(nodes, dtype=wp.vec3, device=device) for _ in range(3)
        )
        self._mobility, self._held = (
            wp.zeros(nodes, dtype=wp.float32, device=device) for _ in range(2)
        )

    def launch(self, state: State, dt: float, inverse_mass: wp.array) -> None:
        """Keep nodes within their limits, and move particles with their nodes."""
        m, t = self._model, self._model.coarse
        if not (t.node_count and self._sweeps):
            return
        wp.launch(
            coarse.gather_nodes,
            dim=t.node_count,
            inputs=[
                t.node_start, t.node_particle, t.node_weight, t.node_inverse_mass, inverse_mass,
                state.is_stuck, state.positions, self._centre, self._centre_before, self._mobility,
                self._held, self._reaction,
            ],
        )  # fmt: skip
        for _ in range(self._sweeps):
            for first, end in m.divide_launches(t.colour_start):
                wp.launch(
                    coarse.solve_limits,
                    dim=end - first,
                    inputs=[first, t.pairs, t.limit, self._mobility, self._centre, self._reaction],
                )
        wp.launch(
            coarse.move_with_nodes,
            dim=m.env_count * m.particles_per_env,
            inputs=[
                ACCELERATION * dt**2, t.nodes, t.weights, t.node_inverse_mass, inverse_mass, state.is_stuck,
                self._centre, self._centre_before, self._held, self._reaction, state.positions, self.tension,
            ],
        )  # fmt: skip
