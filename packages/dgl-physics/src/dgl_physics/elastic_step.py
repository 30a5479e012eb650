"""The implicit step that moves elastic solids, contact with rigid shapes included."""

# What wp.struct returns is no class to pyright.
# pyright: reportGeneralTypeIssues=false
import numpy as np
import warp as wp

from dgl_physics._kernels import solid, solid_contact
from dgl_physics._kernels.solid import Bodies
from dgl_physics._kernels.solid_contact import Touches
from dgl_physics._kernels.types import SolverLimits
from dgl_physics.elastic import Solids
from dgl_physics.near_shapes import NearShapes
from dgl_physics.state import State

CONTACT_SWEEPS = 30
"""Most sweeps over the contacts of a solid; fewer when nothing moves by more than 0.1 um."""


class ElasticStep:
    """One quasi-Newton step of implicit Euler for all solids, once a substep.

    The step solves (mass + dt^2 stiffness bound) dx = dt^2 (weight + elastic forces) with a
    factor made once (Liu, Bouaziz and Kavan 2017, Quasi-Newton Methods for Real-Time Simulation
    of Hyperelastic Materials). It moves nothing where forces balance, so stiffness at rest is
    exact at any substep. Linear momentum is exact, and so are modes of frequency w << 1 / dt.
    """

    def __init__(self, solids: Solids, dt: float, device: str) -> None:
        self._solids = solids
        self._dt = dt
        factors = [mesh.make_factor(dt) for mesh in solids.meshes]
        rows = np.concatenate([[0], np.cumsum([len(f.column_start) for f in factors])])
        sizes = np.concatenate([[0], np.cumsum([len(f.entries) for f in factors])])
        starts = [f.entry_start + size for f, size in zip(factors, sizes[:-1], strict=True)]
        meshes = [solids.meshes[k] for k in solids.mesh_index]

        def to_device(values: np.ndarray | list, dtype: type) -> wp.array:
            return wp.array(np.ascontiguousarray(values), dtype=dtype, device=device)

        self._bodies = Bodies()
        self._bodies.first_row = to_device(solids.first_row, wp.int32)
        self._bodies.row_count = to_device([m.vertex_count for m in meshes], wp.int32)
        self._bodies.factor_row = to_device(rows[solids.mesh_index], wp.int32)
        self._bodies.is_free = to_device([int(m.mass.min() > 0) for m in meshes], wp.int32)
        self._bodies.entry_start = to_device(np.concatenate(starts), wp.int32)
        self._bodies.column_start = to_device(
            np.concatenate([f.column_start for f in factors]), wp.int32
        )
        self._bodies.entries = to_device(np.concatenate([f.entries for f in factors]), wp.float32)
        sizes = np.concatenate([[0], np.cumsum([f.inverse.size for f in factors])])
        self._bodies.inverse_start = to_device(sizes[solids.mesh_index], wp.int32)
        self._bodies.inverse = to_device(
            np.concatenate([f.inverse.ravel() for f in factors]), wp.float32
        )
        count = solids.particle.size
        self._trial, self._fall, self._step, self._push, self._shift, self._arm, self._lever = (
            wp.zeros(count, dtype=wp.vec3, device=device) for _ in range(7)
        )
        # points of contact: the rows, and the middles of the surface's edges
        own_rows = np.repeat(np.arange(count)[:, None], 2, axis=1)
        ends = np.concatenate([own_rows, solids.edges])
        points = len(ends)
        self._first_edge = to_device(count + solids.first_edge, wp.int32)
        self._edge_count = to_device(solids.edge_count, wp.int32)
        self._point_push, self._point_moved = (
            wp.zeros(points, dtype=wp.vec3, device=device) for _ in range(2)
        )
        self._own = wp.zeros(points, dtype=wp.vec2, device=device)
        self._inverse_inertia = wp.zeros(len(meshes), dtype=wp.mat33, device=device)
        self._turning = wp.zeros(len(meshes), dtype=wp.mat33, device=device)
        self._listed = wp.zeros(points, dtype=wp.int32, device=device)
        self._contact_count = wp.zeros(len(meshes), dtype=wp.int32, device=device)
        self._touches = Touches()
        self._touches.row_count = count
        self._touches.ends = to_device(ends.astype(np.int32), wp.vec2i)
        self._touches.shape = wp.zeros(points, dtype=wp.int32, device=device)
        for name in ("gap", "friction"):
            setattr(self._touches, name, wp.zeros(points, dtype=wp.float32, device=device))
        for name in ("normal", "slip", "surface", "arm", "lever"):
            setattr(self._touches, name, wp.zeros(points, dtype=wp.vec3, device=device))
        self._forces = wp.zeros(solids.elements.rows.size, dtype=wp.mat33, device=device)

    def launch(
        self,
        gravity: wp.vec3,
        state: State,
        limits: SolverLimits,
        near: NearShapes,
        inverse_mass: wp.array,
        previous: wp.array,
    ) -> None:
        """Move the solids' integrated particles by elasticity and contact.

        `near` is posed for this substep; `previous` holds positions at its start.
        """
        m, s, count = state.model, self._solids, self._solids.particle.size
        wp.launch(
            solid.predict,
            dim=count,
            inputs=[
                gravity, state.gravity_scale, self._dt, s.particle, s.damping, m.environment,
                m.garment_index, m.materials, inverse_mass, state.positions, state.velocities,
                self._trial, self._fall,
            ],
        )  # fmt: skip
        wp.launch(
            solid.compute_element_forces,
            dim=s.elements.rows.size,
            inputs=[s.elements, self._trial, self._forces],
        )
        wp.launch(
            solid.gather_forces,
            dim=count,
            inputs=[
                self._dt, s.incident_start, s.incident, s.mass, self._fall, self._forces,
                self._step,
            ],
        )  # fmt: skip
        wp.launch(
            solid_contact.add_adhesion,
            dim=count,
            inputs=[
                self._dt, m.particles_per_env, limits, m.shapes, m.garment_index, m.materials,
                inverse_mass, near.active, near.pose_now, near.near, near.near_count,
                s.particle, self._trial, self._step, state.impulse,
            ],
        )  # fmt: skip
        wp.launch(
            solid.find_levers,
            dim=len(s.first_row),
            inputs=[self._bodies, s.particle, s.mass, previous, self._arm, self._lever],
        )
        self._substitute(self._step, is_for_contact=False)
        self._substitute(self._lever, is_for_contact=False)
        wp.launch(
            solid.level_step,
            dim=len(s.first_row),
            inputs=[
                self._bodies, s.mass, self._arm, self._lever, self._inverse_inertia,
                self._turning, self._step,
            ],
        )  # fmt: skip
        edges = len(self._touches.ends) - count
        for first, points in ((0, count), (count, edges)):
            wp.launch(
                solid_contact.find_touches,
                dim=points,
                inputs=[
                    first, self._dt, m.particles_per_env, limits, m.shapes, m.garment_index,
                    m.materials, inverse_mass, near.active, near.pose_before, near.pose_now,
                    near.near, near.near_count, previous, state.positions, near.near_bodies,
                    s.particle, self._fall, self._step, self._touches,
                ],
            )  # fmt: skip
        wp.launch(
            solid_contact.solve_touches,
            dim=len(s.first_row),
            inputs=[
                self._dt, CONTACT_SWEEPS, self._bodies, m.shapes, m.environment, s.particle,
                self._first_edge, self._edge_count, self._arm, self._lever,
                self._inverse_inertia, self._turning, self._touches, self._own, self._listed,
                self._contact_count, self._point_push, self._point_moved, self._push,
                state.impulse,
            ],
        )  # fmt: skip
        wp.copy(self._shift, self._push)
        self._substitute(self._shift, is_for_contact=True)
        wp.launch(
            solid.move_bodies,
            dim=len(s.first_row),
            inputs=[
                self._bodies, s.particle, s.mass, inverse_mass, self._arm, self._lever,
                self._inverse_inertia, self._fall, self._step, self._contact_count, self._push,
                self._shift, state.positions,
            ],
        )  # fmt: skip

    def _substitute(self, vector: wp.array, *, is_for_contact: bool) -> None:
        wp.launch(
            solid.substitute,
            dim=len(self._solids.first_row),
            inputs=[self._bodies, self._contact_count, int(is_for_contact), vector],
        )
