"""State of a simulation."""

import numpy as np
import warp as wp

from dgl_physics.model import Model


class State:
    """Particles, gravity scale and body poses of a batch of environments.

    Attributes:
        positions: Particle positions [m], shape (B * V,), vec3, world frame.
        velocities: Particle velocities [m/s], shape (B * V,), vec3.
        is_stuck: 1 for particles that stuck to a rigid surface at the end of the last substep,
            shape (B * V,), int32; the next substep takes them as held.
        still: Frames for which an environment's cloth has been still, shape (B,), int32; after
            `SolverConfig.sleep_after` it sleeps.
        anchor: Particle positions when that count was 0 [m], shape (B * V,), vec3.
        motion: Sum of the squared distances from the anchors [m^2], shape (B,).
        crowd: Sum of each particle's shares in its contacts, shape (B * V,).
        edge_length, bend_length, yarn_length: Lengths of the constraints in the last substep, for
            damping; negative where unknown.
        is_set: 1 for environments whose particles were set since the last frame, shape (B,), int32.
        gravity_scale: Factor on gravity, shape (B,).
        body_start: Body poses at the start of the coming frame, shape (B, N), transform (xyzw).
        body_end: Body poses at its end.
        impulse: Impulse [N s] and moment of impulse about the world's origin [N m s] on each shape
            by the cloth during the last frame, shape (B, S), spatial vector.
        press: The same by cloth that is squeezed between shapes; it rises at a limited rate.
    """

    def __init__(self, model: Model) -> None:
        device = model.device
        shape = (model.env_count, model.body_count)
        self.model = model
        self.positions = wp.array(
            model.initial_positions.reshape(-1, 3), dtype=wp.vec3, device=device
        )
        self.velocities = wp.zeros_like(self.positions)
        self.is_stuck = wp.zeros(len(self.positions), dtype=wp.int32, device=device)
        self.held = wp.zeros(len(self.positions), dtype=wp.int32, device=device)
        self.still = wp.zeros(model.env_count, dtype=wp.int32, device=device)
        self.anchor = wp.clone(self.positions)
        self.motion = wp.zeros(model.env_count, dtype=wp.float32, device=device)
        self.crowd = wp.zeros(len(self.positions), dtype=wp.float32, device=device)
        self.edge_length = wp.zeros_like(model.rest_length)
        self.bend_length = wp.zeros(model.bending.count, dtype=wp.float32, device=device)
        self.yarn_length = wp.zeros(model.yarns.count, dtype=wp.vec2, device=device)
        self.is_set = wp.ones(model.env_count, dtype=wp.int32, device=device)
        self.is_any_set = True
        self.gravity_scale = wp.ones(model.env_count, dtype=wp.float32, device=device)
        identity = np.tile(np.array([0, 0, 0, 0, 0, 0, 1], dtype=np.float32), (*shape, 1))
        self.body_start = wp.array(identity, dtype=wp.transform, device=device)
        self.body_end = wp.array(identity, dtype=wp.transform, device=device)
        self.impulse = wp.zeros(
            (model.env_count, max(model.shape_count, 1)),
            dtype=wp.spatial_vector,  # pyright: ignore[reportArgumentType]
            device=device,
        )
        self.press = wp.zeros_like(self.impulse)

    def get_positions(self) -> np.ndarray:
        """Return particle positions [m], shape (B, V, 3)."""
        return self.positions.numpy().reshape(self.model.env_count, -1, 3).copy()

    def get_velocities(self) -> np.ndarray:
        """Return particle velocities [m/s], shape (B, V, 3)."""
        return self.velocities.numpy().reshape(self.model.env_count, -1, 3).copy()

    def get_is_stuck(self) -> np.ndarray:
        """Return a mask of the particles that stick to rigid surfaces, shape (B, V), bool."""
        return self.is_stuck.numpy().reshape(self.model.env_count, -1) != 0

    def get_memory(self) -> np.ndarray:
        """Return the solver's memory of the last substep, shape (M,), float32.

        Particles that are set without it continue almost, but not bitwise, as before.
        """
        return np.concatenate([a.numpy().astype(np.float32).ravel() for a in self._memory])

    def set_memory(self, memory: np.ndarray) -> None:
        """Restore the result of `get_memory`, after the particles of the same time."""
        sizes = [a.numpy().size for a in self._memory]
        memory = np.asarray(memory, dtype=np.float32)
        if memory.shape != (sum(sizes),):
            raise ValueError(f"memory must have shape {(sum(sizes),)}; got {memory.shape}")
        parts = np.split(memory, np.cumsum(sizes)[:-1])
        for array, part in zip(self._memory, parts, strict=True):
            old = array.numpy()
            array.assign(part.astype(old.dtype).reshape(old.shape))
        self.is_set.zero_()
        self.is_any_set = False

    @property
    def _memory(self) -> tuple[wp.array, ...]:
        return (
            self.still, self.motion, self.anchor, self.crowd, self.edge_length, self.bend_length,
            self.yarn_length, self.press,
        )  # fmt: skip

    def set_particles(
        self,
        positions: np.ndarray,
        velocities: np.ndarray | None = None,
        is_stuck: np.ndarray | None = None,
        *,
        envs: np.ndarray | None = None,
    ) -> None:
        """Set the particles of some environments, at rest and free when nothing else is given.

        Args:
            positions: [m], shape (len(envs), V, 3).
            velocities: [m/s], the same shape.
            is_stuck: Of `get_is_stuck`, shape (len(envs), V), bool.
            envs: Indices of environments; all when None. The others are not touched.
        """
        m = self.model
        envs = np.arange(m.env_count) if envs is None else np.asarray(envs, dtype=np.int64)
        expected = (len(envs), m.particles_per_env, 3)
        velocities = np.zeros(expected, np.float32) if velocities is None else velocities
        is_stuck = np.zeros(expected[:2], bool) if is_stuck is None else is_stuck
        parts = (
            ("positions", positions, self.positions, expected),
            ("velocities", velocities, self.velocities, expected),
            ("is_stuck", is_stuck, self.is_stuck, expected[:2]),
        )
        for name, new, _, shape in parts:
            if np.shape(new) != shape:
                raise ValueError(f"{name} must have shape {shape}; got {np.shape(new)}")
            if not np.isfinite(new).all():
                raise ValueError(f"{name} must be finite")
        for _, new, old, shape in parts:
            values = old.numpy()
            by_env = values.reshape(m.env_count, *shape[1:]).copy()
            by_env[envs] = new
            old.assign(by_env.reshape(values.shape))
        for flags, value in ((self.is_set, 1), (self.still, 0)):
            by_env = flags.numpy().copy()
            by_env[envs] = value
            flags.assign(by_env)
        self.is_any_set = True

    def hold(
        self, particles: np.ndarray, positions: np.ndarray, velocities: np.ndarray, *, env: int = 0
    ) -> None:
        """Place particles of an environment and hold them there; those held before are let go.

        Nothing moves a held particle until the next call.

        Args:
            particles: Indices in the environment, shape (N,); may be empty.
            positions: [m], shape (N, 3).
            velocities: [m/s] of the particles once they are let go, shape (N, 3).
            env: The environment.

        Raises:
            ValueError: If there is no such particle or environment, or an array is of another
                shape or not finite.
        """
        m, particles = self.model, np.asarray(particles, dtype=np.int64)
        count = m.particles_per_env
        if not 0 <= env < m.env_count:
            raise ValueError(f"env must be in [0, {m.env_count}); got {env}")
        if len(particles) and (particles.min() < 0 or particles.max() >= count):
            raise ValueError(
                f"particles must be in [0, {count}); got {particles.min()} to {particles.max()}"
            )
        for name, values in (("positions", positions), ("velocities", velocities)):
            if np.shape(values) != (len(particles), 3) or not np.isfinite(values).all():
                raise ValueError(
                    f"{name} must be finite, of shape {(len(particles), 3)}; "
                    f"got shape {np.shape(values)}"
                )
        held = self.held.numpy().copy()
        rows = env * count + particles
        held[env * count : (env + 1) * count] = 0
        held[rows] = 1
        self.held.assign(held)
        for array, values in ((self.positions, positions), (self.velocities, velocities)):
            if len(rows):
                present = array.numpy().copy()
                present[rows] = values
                array.assign(present)

    def set_gravity_scale(self, scale: np.ndarray | float) -> None:
        """Set the factor on gravity of each environment, shape (B,) or one number."""
        values = np.broadcast_to(np.asarray(scale, dtype=np.float32), (self.model.env_count,))
        if not np.array_equal(values, self.gravity_scale.numpy()):
            self.still.zero_()  # a change of weight wakes the cloth
        self.gravity_scale.assign(np.ascontiguousarray(values))

    def set_body_poses(self, poses: np.ndarray, *, is_jump: bool = False) -> None:
        """Set the body poses at the end of the coming frame.

        Args:
            poses: xyz [m] + quaternion wxyz, shape (B, N, 7), body 0 (the world) included.
            is_jump: Place the bodies there at once, without velocity.
        """
        m = self.model
        expected = (m.env_count, m.body_count, 7)
        if np.shape(poses) != expected:
            raise ValueError(f"poses must have shape {expected}; got {np.shape(poses)}")
        xyzw = np.asarray(poses, dtype=np.float32)[..., [0, 1, 2, 4, 5, 6, 3]]
        self.body_end.assign(np.ascontiguousarray(xyzw))
        if is_jump:
            wp.copy(self.body_start, self.body_end)
