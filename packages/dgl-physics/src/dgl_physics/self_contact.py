"""Contact between particles: search for neighbours, and separation."""

# What wp.struct returns is no class to pyright.
# pyright: reportGeneralTypeIssues=false
import numpy as np
import warp as wp

from dgl_physics._kernels import selfcontact
from dgl_physics._kernels.types import SolverLimits
from dgl_physics.contact_lists import grow_list
from dgl_physics.launcher import Launcher
from dgl_physics.model import Model
from dgl_physics.solver_config import SolverConfig
from dgl_physics.state import State

__all__ = ["SelfContact"]


class SelfContact:
    """Lists of neighbouring particles, renewed where particles have moved, and their contact."""

    def __init__(
        self,
        model: Model,
        config: SolverConfig,
        limits: SolverLimits,
        overflow: wp.array,
        launcher: Launcher,
    ) -> None:
        """Make the lists; `overflow` counts each environment's entries without room, shape (B,)."""
        self._model, self._config, self._limits, self._overflow = model, config, limits, overflow
        self._launcher = launcher
        device, count = model.device, model.env_count * model.particles_per_env
        self.squeeze = wp.zeros(count, dtype=wp.vec3, device=device)
        """Push on each particle in the last solution [m]."""
        self._reach = model.contact_reach + config.neighbour_margin
        self._grid = wp.HashGrid(64, 64, 8, device=device)
        self._grid.reserve(count)
        cells = max(1 << 14, 1 << int(np.ceil(np.log2(8 * count))))
        self._stirred = wp.zeros(cells, dtype=wp.int32, device=device)
        self._restless = wp.zeros(model.env_count, dtype=wp.int32, device=device)
        self._searched_at = wp.full(count, wp.vec3(1.0e9, 0.0, 0.0), dtype=wp.vec3, device=device)
        # Vector code reads eight entries at a time.
        self._neighbours = wp.zeros(
            count * config.neighbour_capacity + 8, dtype=wp.int32, device=device
        )
        self._neighbour_count = wp.zeros(count, dtype=wp.int32, device=device)
        self._correction = wp.zeros(count, dtype=wp.vec3, device=device)
        self._squeeze_next = wp.zeros(count, dtype=wp.vec3, device=device)
        self._crowd_next = wp.zeros(count, dtype=wp.float32, device=device)

    def mark_stirred(self, state: State) -> None:
        """Mark the cells in which particles have moved, or may move before the next search."""
        m, c = self._model, self._config
        self._stirred.zero_()
        self._restless.zero_()
        wp.launch(
            selfcontact.mark_stirred,
            dim=m.env_count * m.particles_per_env,
            inputs=[
                c.search_every * c.dt / c.substeps, self._limits, m.environment, m.inverse_mass,
                state.positions, state.velocities, self._searched_at, self._stirred,
                self._restless,
            ],
        )  # fmt: skip

    def is_any_stirred(self) -> bool:
        """Check for marked cells; True on a GPU, where reading the flags would stall the device."""
        return self._model.device != "cpu" or bool(self._restless.numpy().any())

    def search(self, state: State) -> None:
        """List neighbours anew in the cells that are marked."""
        m = self._model
        if not self._launcher.has_twin(selfcontact.find_neighbours):  # which sorts by itself
            self._grid.build(state.positions, self._limits.cell_size, groups=m.environment)
        self._launcher.launch(
            selfcontact.find_neighbours,
            m.env_count * m.particles_per_env,
            [
                self._grid.id, self._limits, m.environment, m.touch, self._reach,
                m.adjacency_start, m.adjacency, self._stirred, state.positions, self._searched_at,
                self._neighbours, self._neighbour_count, self._overflow,
            ],
        )  # fmt: skip

    def grow(self) -> None:
        """Double the room for neighbours; a new search must follow.

        Raises:
            ContactOverflowError: If that takes more memory than is allowed.
        """
        device, count = self._model.device, len(self._neighbour_count)
        capacity = self._limits.neighbour_capacity
        size = grow_list("neighbours", count * capacity, self._config.list_memory)
        rows = np.zeros((count, 2 * capacity), dtype=np.int32)
        rows[:, :capacity] = self._neighbours.numpy()[: count * capacity].reshape(count, capacity)
        self._limits.neighbour_capacity = 2 * capacity
        self._neighbours = wp.zeros(size + 8, dtype=wp.int32, device=device)
        wp.copy(self._neighbours, wp.array(rows.ravel(), dtype=wp.int32, device=device))

    def solve(
        self,
        state: State,
        dt: float,
        inverse_mass: wp.array,
        previous: wp.array,
        *,
        share: float = 1.0,
    ) -> None:
        """Separate particles, with friction and adhesion.

        A `share` of the corrections is applied; 0 only counts contacts. `previous` holds positions
        at the start of the substep.
        """
        m = self._model
        count = m.env_count * m.particles_per_env
        self._launcher.launch(
            selfcontact.solve_self_contact,
            count,
            [
                dt, self._limits, m.touch, inverse_mass, state.positions, previous,
                self._neighbours, self._neighbour_count, state.crowd, self._correction,
                self._squeeze_next, self._crowd_next,
            ],
        )  # fmt: skip
        self._launcher.launch(
            selfcontact.apply_corrections,
            count,
            [
                share, self._correction, self._squeeze_next, self._crowd_next, state.positions,
                self.squeeze, state.crowd,
            ],
        )  # fmt: skip
