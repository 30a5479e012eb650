"""The solver: small XPBD substeps with contact last."""

from collections.abc import Callable

import numpy as np
import warp as wp

from dgl_physics._kernels import bending, cloth, forgetting, guard, rigid, sleep, yarns
from dgl_physics.coarse_step import CoarseStep
from dgl_physics.edge_contact import EdgeContact
from dgl_physics.elastic_step import ElasticStep
from dgl_physics.errors import SimulationDivergedError
from dgl_physics.launcher import Kernel, Launcher
from dgl_physics.model import Model
from dgl_physics.near_shapes import NearShapes
from dgl_physics.quiet import quiet_warp
from dgl_physics.self_contact import SelfContact
from dgl_physics.solver_config import SolverConfig
from dgl_physics.state import State
from dgl_physics.stencils import Stencils

__all__ = ["SolverXPBD"]

PRESS_RATE = 30.0
"""Largest rate at which the press of squeezed cloth rises [N/s]: bodies react a frame later."""


class SolverXPBD:
    """Advances the state of a model by frames.

    Extended position-based dynamics with small steps (Macklin et al. 2016 and 2019): each substep
    integrates, separates particles, projects every distance constraint once in the order of its
    colour, and resolves rigid contact with stiction last.

    The bodies move on straight lines from `body_start` to `body_end` during a frame, after which
    `body_end` becomes `body_start`.

    Limitations: layers of cloth collide by their particles, not by their triangles, so the longest
    edges decide their thickness, see `dgl_physics.topology.compute_radii`; rigid shapes collide
    with particles and the middles of edges.
    """

    @quiet_warp()
    def __init__(self, model: Model, config: SolverConfig | None = None) -> None:
        self.model = model
        self.config = config or SolverConfig()
        self.frame = 0
        device, envs = model.device, model.env_count
        count = envs * model.particles_per_env
        c = self.config
        self._limits = c.make_limits(model.contact_reach)
        self._previous = wp.zeros(count, dtype=wp.vec3, device=device)
        self._inverse_mass = wp.zeros(count, dtype=wp.float32, device=device)
        free = model.inverse_mass.numpy().reshape(envs, -1) > 0
        self._free_count = wp.array(free.sum(axis=1), dtype=wp.float32, device=device)
        self._is_touched = wp.zeros(envs, dtype=wp.int32, device=device)
        self._pressed = wp.zeros(
            (envs, max(model.shape_count, 1)),
            dtype=wp.spatial_vector,  # pyright: ignore[reportArgumentType]
            device=device,
        )
        self._is_torn = wp.zeros(count, dtype=wp.int32, device=device)
        self._overflow = wp.zeros(envs, dtype=wp.int32, device=device)
        self._flag = wp.zeros(envs, dtype=wp.int32, device=device)
        self._launcher = Launcher(device, c.cpu_code, count)
        self._near = NearShapes(model, c, self._limits, self._overflow, self._launcher)
        self._edge_contact = EdgeContact(model, self._limits, self._near)
        self._contact = SelfContact(model, c, self._limits, self._overflow, self._launcher)
        self._coarse = CoarseStep(model, c.coarse_sweeps, self._launcher)
        self._elastic = model.solids and ElasticStep(model.solids, c.dt / c.substeps, device)
        self._graphs: dict[str, wp.Graph] = {}
        self._graph_state: State | None = None

    @quiet_warp()
    def step(self, state: State) -> None:
        """Advance the state by one frame.

        Raises:
            SimulationDivergedError: If a particle is not finite or left the space (100 m).
            ContactOverflowError: If a contact list would need more memory than is allowed.
        """
        c = self.config
        substeps = range(c.substeps)
        parts = [substeps[k : k + c.search_every] for k in substeps[:: c.search_every]]
        with wp.ScopedDevice(self.model.device):
            if self._graph_state is not state:
                self._graphs, self._graph_state = {}, state
            if state.is_any_set:
                self._forget(state)
            self._list(self._near)
            self._replay("begin", self._begin_frame)
            for part in () if self._is_asleep() else parts:
                if self._needs_search():
                    self._list(self._contact)
                self._replay(f"substeps {part}", lambda part=part: self._run_substeps(part))
            self._replay("end", self._end_frame)
        self.frame += 1
        if self.config.is_guarded:
            self._check()

    def _replay(self, name: str, launch: Callable[[], None]) -> None:
        """Run launches: directly the first time, which compiles kernels, then as a graph."""
        if name not in self._graphs:
            launch()
            with wp.ScopedCapture() as capture:
                launch()
            self._graphs[name] = capture.graph  # pyright: ignore[reportArgumentType]
        else:
            wp.capture_launch(self._graphs[name])

    def _list(self, lists: NearShapes | SelfContact) -> None:
        """Fill the lists of near shapes or particles; they grow until every entry has room.

        A list that overflows changes nothing else, so the result is that of long enough lists.
        """
        name = type(lists).__name__
        self._replay(name, lambda: lists.search(self._state))
        while self._has_overflowed():
            lists.grow()
            self._graphs.clear()
            self._replay(name, lambda: lists.search(self._state))

    def _has_overflowed(self) -> bool:
        """Check for entries that found no room, and reset their count."""
        if not self.config.is_guarded or not self._overflow.numpy().any():
            return False
        self._overflow.zero_()
        return True

    @property
    def _state(self) -> State:
        assert self._graph_state is not None
        return self._graph_state

    def _is_asleep(self) -> bool:
        """Check if all cloth sleeps; on a GPU sleeping particles are skipped one by one."""
        if self.model.device != "cpu":
            return False  # reading the answer back would stall the device
        return bool((self._state.still.numpy() >= self._limits.sleep_frames).all())

    def _needs_search(self) -> bool:
        """Check if particles have moved; on a GPU the search itself decides."""
        self._replay("stirred", lambda: self._contact.mark_stirred(self._state))
        return self._contact.is_any_stirred()

    def _begin_frame(self) -> None:
        m, state = self.model, self._state
        self._edge_contact.find()
        count = m.env_count * m.particles_per_env
        wp.launch(
            sleep.find_touched,
            dim=count,
            inputs=[
                m.particles_per_env, self._limits, m.shapes, self._near.active, self._near.near,
                self._near.near_count, self._is_touched,
            ],
        )  # fmt: skip
        wp.launch(
            sleep.count_still_frames,
            dim=m.env_count,
            inputs=[
                self._limits, self._free_count, self._is_touched, state.motion, state.still
            ],
        )  # fmt: skip
        wp.launch(
            sleep.clear_impulses,
            dim=state.impulse.shape,
            inputs=[self._limits, state.still, state.impulse],
        )
        wp.launch(
            sleep.lay_down,
            dim=count,
            inputs=[
                self._limits, m.environment, state.still, state.held, m.inverse_mass,
                state.positions, state.velocities, self._inverse_mass, state.anchor,
            ],
        )  # fmt: skip

    def _end_frame(self) -> None:
        m, state = self.model, self._state
        wp.copy(state.body_start, state.body_end)
        wp.launch(
            sleep.ease_press,
            dim=state.press.shape,
            inputs=[
                PRESS_RATE * self.config.dt**2, self._limits, state.still, self._pressed,
                state.press,
            ],
        )  # fmt: skip
        wp.launch(
            sleep.add_motion,
            dim=m.env_count * m.particles_per_env,
            inputs=[m.environment, state.anchor, state.positions, state.motion],
        )
        if self.config.is_guarded:
            wp.launch(
                guard.flag_divergence,
                dim=m.env_count * m.particles_per_env,
                inputs=[m.particles_per_env, 100.0, m.inverse_mass, state.positions, self._flag],
            )

    def _run_substeps(self, part: range) -> None:
        m, c, state, near = self.model, self.config, self._state, self._near
        count = m.env_count * m.particles_per_env
        dt = c.dt / c.substeps
        for k in part:
            self._launcher.launch(
                cloth.integrate,
                count,
                [
                    wp.vec3(*c.gravity), state.gravity_scale, dt, m.environment, m.garment_index,
                    m.materials, self._inverse_mass, state.positions, state.velocities,
                    self._previous,
                ],
            )  # fmt: skip
            self._contact.solve(state, dt, self._inverse_mass, self._previous)
            # The last constraints hold best, so stiff ones come after soft ones.
            self._solve_stencils(bending.solve_bending, m.bending, state, dt, state.bend_length)
            self._launcher.launch_colours(
                cloth.solve_distances,
                m.colour_start,
                [
                    1.0 / dt**2, m.pairs, m.rest_length, m.compliance, self._inverse_mass,
                    state.positions, 1.0 / dt if m.is_stretch_damped else 0.0, m.garment_index,
                    m.materials, state.edge_length, self._is_torn,
                ],
            )  # fmt: skip
            self._solve_stencils(yarns.solve_yarns, m.yarns, state, dt, state.yarn_length)
            self._coarse.launch(state, dt, self._inverse_mass)
            self._contact.solve(state, dt, self._inverse_mass, self._previous)
            near.pose(state, (k + 1) / c.substeps)
            if self._elastic is not None:
                self._elastic.launch(
                    wp.vec3(*c.gravity), state, self._limits, near, self._inverse_mass,
                    self._previous,
                )  # fmt: skip
            self._edge_contact.solve(state, dt, self._inverse_mass, self._previous)
            self._launcher.launch(
                rigid.solve_rigid_contact,
                count,
                [
                    dt, m.particles_per_env, self._limits, m.shapes, m.garment_index, m.materials,
                    self._inverse_mass, near.active, near.pose_before, near.pose_now, near.near,
                    near.near_count, near.near_bodies, self._previous, self._contact.squeeze,
                    state.positions, state.velocities, state.impulse, self._pressed,
                    state.is_stuck, self._coarse.tension, self._is_torn,
                ],
            )  # fmt: skip

    def _forget(self, state: State) -> None:
        """Reset the memory of the last substep in environments whose particles were set.

        Lengths become unknown to damping, and contacts are counted without being solved.
        """
        m = self.model
        wp.copy(self._previous, state.positions)
        wp.copy(self._inverse_mass, m.inverse_mass)
        crowd = wp.clone(state.crowd)
        self._contact.mark_stirred(state)
        self._list(self._contact)
        dt = self.config.dt / self.config.substeps
        self._contact.solve(state, dt, self._inverse_mass, self._previous, share=0.0)
        wp.launch(
            forgetting.take_counts,
            dim=len(crowd),
            inputs=[state.is_set, m.environment, state.crowd, crowd],
        )
        wp.copy(state.crowd, crowd)
        for particles, lengths, unknown in (
            (m.pairs, state.edge_length, -1.0),
            (m.bending.vertices, state.bend_length, -1.0),
            (m.yarns.vertices, state.yarn_length, wp.vec2(-1.0, -1.0)),
        ):
            wp.launch(
                forgetting.forget_lengths,
                dim=len(lengths),
                inputs=[state.is_set, m.environment, particles, unknown, lengths],
            )
        state.is_set.zero_()
        state.is_any_set = False

    def _solve_stencils(
        self, kernel: Kernel, s: Stencils, state: State, dt: float, before: wp.array
    ) -> None:
        self._launcher.launch_colours(
            kernel,
            s.colour_start,
            [
                dt, 1.0 / dt, s.vertices, s.weights, s.response, self._inverse_mass,
                state.positions, before,
            ],
        )  # fmt: skip

    @quiet_warp()
    def measure_penetration(self, state: State) -> np.ndarray:
        """Measure the largest depth of a particle's centre inside a shape [m], shape (B,).

        Taken after the last frame of `state`; particles rest `rest_offset` above a surface.
        """
        return self._near.measure_penetration(state)

    def _check(self) -> None:
        diverged = np.flatnonzero(self._flag.numpy())
        if len(diverged):
            self._flag.zero_()
            raise SimulationDivergedError(self.frame, [int(e) for e in diverged])
