"""Rigid shapes that particles may touch within a frame, and their poses in a substep."""

# What wp.struct returns is no class to pyright.
# pyright: reportGeneralTypeIssues=false
import numpy as np
import warp as wp

from dgl_physics._kernels import rigid
from dgl_physics._kernels.types import SolverLimits
from dgl_physics.contact_lists import grow_list
from dgl_physics.launcher import Launcher
from dgl_physics.model import Model
from dgl_physics.solver_config import SolverConfig
from dgl_physics.state import State

__all__ = ["NearShapes"]


class NearShapes:
    """Lists of the shapes near the cloth of each environment, and near each particle."""

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
        device, envs = model.device, model.env_count
        count, shapes = envs * model.particles_per_env, max(model.shape_count, 1)

        def by_shape(dtype: type) -> wp.array:
            return wp.zeros((envs, shapes), dtype=dtype, device=device)

        self.active = by_shape(wp.int32)
        """The shapes near the cloth of each environment, shape (B, S)."""
        self.pose_before = by_shape(wp.transform)
        """Poses of the active shapes at the start of the substep."""
        self.pose_now = by_shape(wp.transform)
        """Poses of the active shapes at its end."""
        self.near = wp.zeros(count * config.near_capacity, dtype=wp.int32, device=device)
        """Indices into `active` of the shapes near each particle, planes last."""
        self.near_count = wp.zeros(count, dtype=wp.int32, device=device)
        """Number of shapes near each particle."""
        self.near_bodies = wp.zeros(count, dtype=wp.int32, device=device)
        """Number of those that are no planes."""
        self._active_count = wp.zeros(envs, dtype=wp.int32, device=device)
        self._pose_middle, self._swept = by_shape(wp.transform), by_shape(wp.vec4)
        self._lower = wp.zeros(envs, dtype=wp.vec3, device=device)
        self._upper = wp.zeros(envs, dtype=wp.vec3, device=device)

    def search(self, state: State) -> None:
        """List the shapes that may be touched within the coming frame."""
        m, c = self._model, self._config
        count = m.env_count * m.particles_per_env
        wp.launch(rigid.reset_bounds, dim=m.env_count, inputs=[self._lower, self._upper])
        wp.launch(
            rigid.bound_cloth,
            dim=count,
            inputs=[m.particles_per_env, m.inverse_mass, state.positions, self._lower, self._upper],
        )
        wp.launch(
            rigid.select_shapes,
            dim=m.env_count,
            inputs=[
                0.02 + c.max_speed * c.dt, m.shapes, state.body_start, state.body_end, self._lower,
                self._upper, self.active, self._active_count, self._pose_middle, self._swept,
            ],
        )  # fmt: skip
        self.pose(state, 0.0)
        self._launcher.launch(
            rigid.find_near_shapes,
            count,
            [
                c.dt, m.particles_per_env, self._limits, m.shapes, m.garment_index, m.materials,
                self.active, self._active_count, self._pose_middle, self._swept, self.pose_now,
                state.body_end, m.inverse_mass, state.positions, state.velocities, self.near,
                self.near_count, self.near_bodies, self._overflow,
            ],
        )  # fmt: skip

    def grow(self) -> None:
        """Double the room for shapes near each particle; a new search must follow.

        Raises:
            ContactOverflowError: If that takes more memory than is allowed.
        """
        size = grow_list("shapes", self.near.size, self._config.list_memory)
        self._limits.near_capacity *= 2
        self.near = wp.zeros(size, dtype=wp.int32, device=self._model.device)

    def pose(self, state: State, fraction: float) -> None:
        """Pose the active shapes at a fraction of the frame, and keep their last pose."""
        wp.launch(
            rigid.pose_shapes,
            dim=self.active.shape,
            inputs=[
                fraction, self._model.shapes, state.body_start, state.body_end, self.active,
                self._active_count, self.pose_before, self.pose_now,
            ],
        )  # fmt: skip

    def measure_penetration(self, state: State) -> np.ndarray:
        """Measure the largest depth of a particle's centre inside a shape [m], shape (B,)."""
        m = self._model
        deepest = wp.zeros(m.env_count, dtype=wp.float32, device=m.device)
        wp.launch(
            rigid.measure_penetration,
            dim=m.env_count * m.particles_per_env,
            inputs=[
                m.particles_per_env, self._limits, m.shapes, self.active, self.pose_now,
                self.near, self.near_count, state.positions, deepest,
            ],
            device=m.device,
        )  # fmt: skip
        return deepest.numpy()
