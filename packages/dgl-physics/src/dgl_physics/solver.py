"""The solver: small XPBD substeps with contact last."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import warp as wp

from dgl_physics._kernels import (
    bending,
    cloth,
    coarse,
    edge_contact,
    forgetting,
    guard,
    rigid,
    selfcontact,
    sleep,
    yarns,
)
from dgl_physics._kernels.types import Limits
from dgl_physics.elastic_step import ElasticStep, NearShapes
from dgl_physics.errors import ContactOverflowError, SimulationDivergedError
from dgl_physics.model import Model
from dgl_physics.state import State

PRESS_RATE = 30.0
"""What the press of squeezed cloth on a shape rises by at most [N/s]: bodies answer to it a frame later."""
COARSE_ACCELERATION = 200.0
"""Most acceleration that the coarse level gives to a particle [m/s^2]."""


@dataclass(frozen=True, kw_only=True)
class SolverConfig:
    """Settings of the solver."""

    dt: float = 1 / 60
    """Length of a frame [s]; > 0."""
    substeps: int = 10
    """Substeps of a frame, each of one iteration; >= 1."""
    coarse_sweeps: int = 3
    """Passes over the limits of the coarse level in each substep; 0 leaves it out."""
    search_every: int = 5
    """Substeps after which particle contacts are searched for, where particles moved; >= 1."""
    neighbour_margin: float = 0.005
    """Distance beyond thickness and adhesion that a search looks for [m]; > 0. Half of it is how
    far a particle may move without a search."""
    neighbour_capacity: int = 256
    """Most particles of higher index that a particle can be near to."""
    near_capacity: int = 96
    """Most shapes that a particle can be near to."""
    sleep_distance: float = 1.5e-3
    """Cloth is still while its particles stay this near to where they were, as the root of the mean square
    over an environment [m]; 0 for cloth that never sleeps."""
    sleep_after: float = 0.5
    """Time for which the cloth of an environment has been still that sleeps [s]; > 0. It wakes when a
    body that can move comes near, or when particles or gravity are set."""
    max_speed: float = 15.0
    """Particles are not faster than this [m/s]."""
    separation_speed: float = 0.1
    """Velocity that a contact may give by undoing an overlap [m/s]; > 0. The overlap itself is
    undone at once; what exceeds this changes places and not velocities."""
    gravity: tuple[float, float, float] = (0.0, 0.0, -9.81)
    """[m/s^2], world frame."""
    is_guarded: bool = True
    """Raise when particles diverge or contact capacities overflow, looked at after each frame."""

    def __post_init__(self) -> None:
        if not self.dt > 0:
            raise ValueError(f"dt must be > 0; got {self.dt}")
        if self.substeps < 1:
            raise ValueError(f"substeps must be >= 1; got {self.substeps}")
        if not self.neighbour_margin > 0:
            raise ValueError(f"neighbour_margin must be > 0; got {self.neighbour_margin}")
        if not (self.sleep_distance >= 0 and self.sleep_after > 0):
            raise ValueError(
                f"sleep_distance must be >= 0 and sleep_after > 0; got {self.sleep_distance} and "
                f"{self.sleep_after}"
            )
        if self.search_every < 1:
            raise ValueError(f"search_every must be >= 1; got {self.search_every}")


class SolverXPBD:
    """Advances the state of a model by frames.

    Extended position-based dynamics with small steps (Macklin et al. 2016 and 2019): each substep
    integrates, separates particles, projects every distance constraint once in the order of its
    colour, and resolves rigid contact with stiction last.

    The bodies move on straight lines from `body_start` to `body_end` during a frame, after which
    `body_end` becomes `body_start`.

    Limitations: contact is resolved between particles, not between triangles: layers are as thick
    as the longest edges need, see `dgl_physics.topology.compute_radii`.
    """

    def __init__(self, model: Model, config: SolverConfig | None = None) -> None:
        self.model = model
        self.config = config or SolverConfig()
        self.frame = 0
        device, count, envs = (
            model.device,
            model.env_count * model.particles_per_env,
            model.env_count,
        )
        c = self.config
        self._limits = Limits()
        self._limits.max_speed = c.max_speed
        self._limits.separation_speed = c.separation_speed
        self._limits.neighbour_margin = c.neighbour_margin
        self._limits.neighbour_capacity = c.neighbour_capacity
        self._limits.near_capacity = c.near_capacity
        self._limits.sleep_distance = c.sleep_distance
        self._limits.sleep_frames = max(1, round(c.sleep_after / c.dt))
        self._grid = wp.HashGrid(64, 64, 8, device=device)
        self._grid.reserve(count)
        self._reach = model.contact_reach + c.neighbour_margin
        self._limits.cell_size = (
            2.0 * self._reach
        )  # a query visits few cells, and not many particles
        cells = max(1 << 14, 1 << int(np.ceil(np.log2(8 * count))))
        self._stirred = wp.zeros(cells, dtype=wp.int32, device=device)
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
        self._correction = wp.zeros(count, dtype=wp.vec3, device=device)
        self._squeeze = wp.zeros(count, dtype=wp.vec3, device=device)
        self._squeeze_next = wp.zeros(count, dtype=wp.vec3, device=device)
        self._crowd_next = wp.zeros(count, dtype=wp.float32, device=device)
        nodes = max(model.coarse.node_count, 1)
        self._centre = wp.zeros(nodes, dtype=wp.vec3, device=device)
        self._centre_before = wp.zeros(nodes, dtype=wp.vec3, device=device)
        self._mobility = wp.zeros(nodes, dtype=wp.float32, device=device)
        self._held = wp.zeros(nodes, dtype=wp.float32, device=device)
        self._reaction = wp.zeros(nodes, dtype=wp.vec3, device=device)
        self._tension = wp.zeros(count, dtype=wp.vec3, device=device)
        self._neighbours = wp.zeros(count * c.neighbour_capacity, dtype=wp.int32, device=device)
        self._neighbour_count = wp.zeros(count, dtype=wp.int32, device=device)
        self._near = wp.zeros(count * c.near_capacity, dtype=wp.int32, device=device)
        self._near_count = wp.zeros(count, dtype=wp.int32, device=device)
        self._near_bodies = wp.zeros(count, dtype=wp.int32, device=device)
        shapes = max(model.shape_count, 1)
        self._active = wp.zeros((envs, shapes), dtype=wp.int32, device=device)
        self._active_count = wp.zeros(envs, dtype=wp.int32, device=device)
        self._pose_middle = wp.zeros((envs, shapes), dtype=wp.transform, device=device)
        self._swept = wp.zeros((envs, shapes), dtype=wp.vec4, device=device)
        self._pose_before = wp.zeros((envs, shapes), dtype=wp.transform, device=device)
        self._pose_now = wp.zeros((envs, shapes), dtype=wp.transform, device=device)
        self._near_shapes = NearShapes(
            active=self._active,
            pose_before=self._pose_before,
            pose_now=self._pose_now,
            near=self._near,
            near_count=self._near_count,
            previous=self._previous,
            inverse_mass=self._inverse_mass,
        )
        self._lower = wp.zeros(envs, dtype=wp.vec3, device=device)
        self._upper = wp.zeros(envs, dtype=wp.vec3, device=device)
        self._overflow = wp.zeros(envs, dtype=wp.int32, device=device)
        self._flag = wp.zeros(envs, dtype=wp.int32, device=device)
        self._searched_at = wp.full(count, wp.vec3(1.0e9, 0.0, 0.0), dtype=wp.vec3, device=device)
        self._restless = wp.zeros(envs, dtype=wp.int32, device=device)
        self._elastic = model.solids and ElasticStep(model.solids, c.dt / c.substeps, device)
        self._graphs: dict[str, wp.Graph] = {}
        self._graph_state: State | None = None

    def step(self, state: State) -> None:
        """Advance the state by one frame.

        Raises:
            SimulationDivergedError: If a particle is not finite or left the space (100 m).
            ContactOverflowError: If a contact list was too short.
        """
        c = self.config
        substeps = range(c.substeps)
        parts = [substeps[k : k + c.search_every] for k in substeps[:: c.search_every]]
        with wp.ScopedDevice(self.model.device):
            if self._graph_state is not state:
                self._graphs, self._graph_state = {}, state
            if state.is_any_set:
                self._forget(state)
            self._replay("begin", self._begin_frame)
            for part in () if self._is_asleep() else parts:
                if self._needs_search():
                    self._replay("search", self._find_neighbours)
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

    @property
    def _state(self) -> State:
        assert self._graph_state is not None
        return self._graph_state

    def _is_asleep(self) -> bool:
        """Ask whether nothing moves at all; on a GPU particles that sleep are passed over one by one."""
        if self.model.device != "cpu":
            return False  # reading the answer back would stall the device
        return bool((self._state.still.numpy() >= self._limits.sleep_frames).all())

    def _needs_search(self) -> bool:
        """Ask whether particles have moved; on a GPU the search itself decides, unasked."""
        self._replay("stirred", self._mark_stirred)
        if self.model.device != "cpu":
            return True  # reading the answer back would stall the device
        return bool(self._restless.numpy().any())

    def _mark_stirred(self) -> None:
        m, c, state = self.model, self.config, self._state
        self._stirred.zero_()
        self._restless.zero_()
        wp.launch(
            selfcontact.mark_stirred,
            dim=m.env_count * m.particles_per_env,
            inputs=[
                c.search_every * c.dt / c.substeps, self._limits, m.environment, m.inverse_mass, state.positions,
                state.velocities, self._searched_at, self._stirred, self._restless,
            ],
        )  # fmt: skip

    def _begin_frame(self) -> None:
        m, state = self.model, self._state
        self._find_near_shapes(state)
        count = m.env_count * m.particles_per_env
        wp.launch(
            sleep.find_touched,
            dim=count,
            inputs=[
                m.particles_per_env, self._limits, m.shapes, self._active, self._near,
                self._near_count, self._is_touched,
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
                self._limits, m.environment, state.still, m.inverse_mass, state.positions,
                state.velocities, self._inverse_mass, state.anchor,
            ],
        )  # fmt: skip

    def _end_frame(self) -> None:
        m, state = self.model, self._state
        wp.copy(state.body_start, state.body_end)
        wp.launch(
            sleep.ease_press,
            dim=state.press.shape,
            inputs=[
                PRESS_RATE * self.config.dt**2, self._limits, state.still, self._pressed, state.press
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
        m, c, state = self.model, self.config, self._state
        count = m.env_count * m.particles_per_env
        dt = c.dt / c.substeps
        rate = 1.0 / dt
        for k in part:
            wp.launch(
                cloth.integrate,
                dim=count,
                inputs=[
                    wp.vec3(*c.gravity), state.gravity_scale, dt, m.environment, m.garment_index,
                    m.materials, self._inverse_mass, state.positions, state.velocities, self._previous,
                ],
            )  # fmt: skip
            self._solve_self_contact(state, dt)
            # What is solved last holds best, so the stiff comes after the soft.
            self._solve_bending(state, dt, rate)
            for first, end in self._colours(m.colour_start):
                wp.launch(
                    cloth.solve_distances,
                    dim=end - first,
                    inputs=[
                        first, 1.0 / dt**2, m.pairs, m.rest_length, m.compliance, self._inverse_mass,
                        state.positions, rate if m.is_stretch_damped else 0.0, m.garment_index,
                        m.materials, state.edge_length, self._is_torn,
                    ],
                )  # fmt: skip
            self._solve_yarns(state, dt, rate)
            if m.coarse.node_count and c.coarse_sweeps:
                self._solve_coarse_level(state, dt)
            self._solve_self_contact(state, dt)
            self._pose_shapes(state, (k + 1) / c.substeps)
            if self._elastic is not None:
                self._elastic.launch(wp.vec3(*c.gravity), state, self._limits, self._near_shapes)
            self._solve_edge_contact(state, dt)
            wp.launch(
                rigid.solve_rigid_contact,
                dim=count,
                inputs=[
                    dt, m.particles_per_env, self._limits, m.shapes, m.garment_index, m.materials,
                    self._inverse_mass, self._active, self._pose_before, self._pose_now, self._near,
                    self._near_count, self._previous, self._squeeze, state.positions,
                    state.velocities, state.impulse, self._pressed, state.is_stuck,
                    self._tension, self._is_torn,
                ],
            )  # fmt: skip

    def _solve_edge_contact(self, state: State, dt: float) -> None:
        m = self.model
        run = 64 if m.device == "cpu" else 1
        for first, end in self._colours(m.colour_start):
            wp.launch(
                edge_contact.solve_edge_contact,
                dim=-(-(end - first) // run),
                inputs=[
                    first, end, run, dt, m.particles_per_env, self._limits, m.shapes, m.pairs, m.garment_index,
                    m.materials, self._inverse_mass, self._active, self._pose_before, self._pose_now,
                    self._near, self._near_bodies, self._previous, state.positions, state.impulse,
                ],
            )  # fmt: skip

    def _solve_self_contact(self, state: State, dt: float, *, share: float = 1.0) -> None:
        m = self.model
        count = m.env_count * m.particles_per_env
        wp.launch(
            selfcontact.solve_self_contact,
            dim=count,
            inputs=[
                dt, self._limits, m.touch, self._inverse_mass, state.positions, self._previous,
                self._neighbours, self._neighbour_count, state.crowd, self._correction,
                self._squeeze_next, self._crowd_next,
            ],
        )  # fmt: skip
        wp.launch(
            selfcontact.apply_corrections,
            dim=count,
            inputs=[
                share, self._correction, self._squeeze_next, self._crowd_next, state.positions, self._squeeze,
                state.crowd,
            ],
        )  # fmt: skip

    def _forget(self, state: State) -> None:
        """Forget the substep before in the environments whose particles were set since then.

        Damping knows no lengths then, and contacts are counted without being resolved.
        """
        m = self.model
        wp.copy(self._previous, state.positions)
        wp.copy(self._inverse_mass, m.inverse_mass)
        crowd = wp.clone(state.crowd)
        self._mark_stirred()
        self._find_neighbours()
        self._solve_self_contact(state, self.config.dt / self.config.substeps, share=0.0)
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

    def _solve_coarse_level(self, state: State, dt: float) -> None:
        m, t = self.model, self.model.coarse
        wp.launch(
            coarse.gather_nodes,
            dim=t.node_count,
            inputs=[
                t.node_start, t.node_particle, t.node_weight, t.node_inverse_mass, self._inverse_mass,
                state.is_stuck, state.positions, self._centre, self._centre_before, self._mobility,
                self._held, self._reaction,
            ],
        )  # fmt: skip
        for _ in range(self.config.coarse_sweeps):
            for first, end in self._colours(t.colour_start):
                wp.launch(
                    coarse.solve_limits,
                    dim=end - first,
                    inputs=[first, t.pairs, t.limit, self._mobility, self._centre, self._reaction],
                )
        wp.launch(
            coarse.move_with_nodes,
            dim=m.env_count * m.particles_per_env,
            inputs=[
                COARSE_ACCELERATION * dt**2, t.nodes, t.weights, t.node_inverse_mass,
                self._inverse_mass, state.is_stuck, self._centre, self._centre_before, self._held,
                self._reaction, state.positions,
                self._tension,
            ],
        )  # fmt: skip

    def _colours(self, start: tuple[int, ...]) -> Iterator[tuple[int, int]]:
        """Ranges of constraints that a launch may have.

        On the CPU one thread works off a launch in order, so all colours may share one.
        """
        return pairwise((start[0], start[-1]) if self.model.device == "cpu" else start)

    def _solve_bending(self, state: State, dt: float, rate: float) -> None:
        m = self.model
        for first, end in self._colours(m.bending.colour_start):
            wp.launch(
                bending.solve_bending,
                dim=end - first,
                inputs=[
                    first, dt, rate, m.bending.vertices, m.bending.weights, m.bending.response,
                    self._inverse_mass, state.positions, state.bend_length,
                ],
            )  # fmt: skip

    def _solve_yarns(self, state: State, dt: float, rate: float) -> None:
        m = self.model
        for first, end in self._colours(m.yarns.colour_start):
            wp.launch(
                yarns.solve_yarns,
                dim=end - first,
                inputs=[
                    first, dt, rate, m.yarns.vertices, m.yarns.weights, m.yarns.response,
                    self._inverse_mass, state.positions, state.yarn_length,
                ],
            )  # fmt: skip

    def _find_near_shapes(self, state: State) -> None:
        m, c = self.model, self.config
        wp.launch(rigid.reset_bounds, dim=m.env_count, inputs=[self._lower, self._upper])
        wp.launch(
            rigid.bound_cloth,
            dim=m.env_count * m.particles_per_env,
            inputs=[m.particles_per_env, m.inverse_mass, state.positions, self._lower, self._upper],
        )
        wp.launch(
            rigid.select_shapes,
            dim=m.env_count,
            inputs=[
                0.02 + c.max_speed * c.dt, m.shapes, state.body_start, state.body_end, self._lower,
                self._upper, self._active, self._active_count, self._pose_middle, self._swept,
            ],
        )  # fmt: skip
        self._pose_shapes(state, 0.0)
        wp.launch(
            rigid.find_near_shapes,
            dim=m.env_count * m.particles_per_env,
            inputs=[
                c.dt, m.particles_per_env, self._limits, m.shapes, m.garment_index, m.materials,
                self._active, self._active_count, self._pose_middle, self._swept, self._pose_now,
                state.body_end, m.inverse_mass, state.positions, state.velocities, self._near,
                self._near_count, self._near_bodies, self._overflow,
            ],
        )  # fmt: skip

    def _pose_shapes(self, state: State, fraction: float) -> None:
        wp.launch(
            rigid.pose_shapes,
            dim=self._active.shape,
            inputs=[
                fraction, self.model.shapes, state.body_start, state.body_end, self._active,
                self._active_count, self._pose_before, self._pose_now,
            ],
        )  # fmt: skip

    def _find_neighbours(self) -> None:
        m, state = self.model, self._state
        self._grid.build(state.positions, self._limits.cell_size, groups=m.environment)
        wp.launch(
            selfcontact.find_neighbours,
            dim=m.env_count * m.particles_per_env,
            inputs=[
                self._grid.id, self._limits, m.environment, m.touch, self._reach, m.adjacency_start, m.adjacency, self._stirred, state.positions,
                self._searched_at, self._neighbours, self._neighbour_count, self._overflow,
            ],
        )  # fmt: skip

    def measure_penetration(self, state: State) -> np.ndarray:
        """Measure how deep particles are inside rigid shapes after the last frame.

        Args:
            state: The state that was stepped last.

        Returns:
            Largest depth of a particle's centre under a surface [m], shape (B,); 0 when none is
            inside. Particles rest `ClothMaterial.rest_offset` above a surface.
        """
        m = self.model
        deepest = wp.zeros(m.env_count, dtype=wp.float32, device=m.device)
        wp.launch(
            rigid.measure_penetration,
            dim=m.env_count * m.particles_per_env,
            inputs=[
                m.particles_per_env, self._limits, m.shapes, self._active, self._pose_now,
                self._near, self._near_count, state.positions, deepest,
            ],
            device=m.device,
        )  # fmt: skip
        return deepest.numpy()

    def _check(self) -> None:
        diverged = np.flatnonzero(self._flag.numpy())
        if len(diverged):
            self._flag.zero_()
            raise SimulationDivergedError(self.frame, [int(e) for e in diverged])
        overflow = np.flatnonzero(self._overflow.numpy())
        if len(overflow):
            self._overflow.zero_()
            raise ContactOverflowError(
                f"contact lists overflowed in environment(s) {overflow.tolist()} at frame "
                f"{self.frame}; raise neighbour_capacity ({self.config.neighbour_capacity}) or "
                f"near_capacity ({self.config.near_capacity}) of SolverConfig"
            )
