"""The coarse level's part of a substep, which carries tension across a garment at once."""

import warp as wp

from dgl_physics._kernels import coarse
from dgl_physics.launcher import Launcher
from dgl_physics.model import Model
from dgl_physics.state import State

__all__ = ["CoarseStep"]

ACCELERATION = 200.0
"""Most acceleration that the coarse level gives to a particle [m/s^2]."""


class CoarseStep:
    """Limits on the distances between the nodes of the coarse level, see `dgl_physics.coarse`."""

    def __init__(self, model: Model, sweeps: int, launcher: Launcher) -> None:
        self._model, self._sweeps, self._launcher = model, sweeps, launcher
        device, nodes = model.device, max(model.coarse.node_count, 1)
        count = model.env_count * model.particles_per_env
        self.tension = wp.zeros(count, dtype=wp.vec3, device=device)
        """Pull on each particle that sticks to a shape [m]; it moves nothing by itself."""
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
        self._launcher.launch(
            coarse.gather_nodes,
            t.node_count,
            [
                t.node_start, t.node_particle, t.node_weight, t.node_inverse_mass, inverse_mass,
                state.is_stuck, state.positions, self._centre, self._centre_before, self._mobility,
                self._held, self._reaction,
            ],
        )  # fmt: skip
        for _ in range(self._sweeps):
            self._launcher.launch_colours(
                coarse.solve_limits,
                t.colour_start,
                [t.pairs, t.limit, self._mobility, self._centre, self._reaction],
            )
        self._launcher.launch(
            coarse.move_with_nodes,
            m.env_count * m.particles_per_env,
            [
                ACCELERATION * dt**2, t.nodes, t.weights, t.node_inverse_mass, inverse_mass,
                state.is_stuck, self._centre, self._centre_before, self._held, self._reaction,
                state.positions, self.tension,
            ],
        )  # fmt: skip
