"""Cloth in SAPIEN scenes: colliders in, contact forces out.

The coupling follows the usual recipe of two simulators that exchange poses and impulses every
frame: SAPIEN moves the rigid bodies, the cloth is advanced over the same time with the bodies on
straight paths between their old and new poses, and the contact forces act on the bodies during
the next frame.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np
import sapien
from sapien import physx

from dgl_physics.collision_mesh import CollisionMesh, is_closed
from dgl_physics.errors import MeshError, PhysicsError
from dgl_physics.model import Model, ModelBuilder
from dgl_physics.shapes import Shape
from dgl_physics.solver import SolverXPBD
from dgl_physics.solver_config import SolverConfig
from dgl_physics.state import State

# SAPIEN's capsules, cylinders and planes are along x, ours along z.
_X_FROM_Z = sapien.Pose(q=[np.sqrt(0.5), 0, np.sqrt(0.5), 0])


class UnsupportedShapeError(PhysicsError):
    """A collider has a collision shape that cloth cannot collide with yet."""


def find_colliders(scene: sapien.Scene) -> list[physx.PhysxRigidBaseComponent]:
    """List the rigid components of a scene that have collision shapes, in the scene's order."""
    return [
        component
        for entity in scene.entities
        for component in entity.components
        if isinstance(component, physx.PhysxRigidBaseComponent) and component.collision_shapes
    ]


def convert_shape(
    shape: physx.PhysxCollisionShape, *, friction: float | None = None, is_measured: bool = True
) -> Shape:
    """Convert a SAPIEN collision shape to a cloth collider in the frame of its component.

    Triangle meshes that are not closed have no inside, as in PhysX: cloth stays at its side.

    Args:
        shape: Plane, sphere, capsule, box, cylinder, convex mesh or triangle mesh.
        friction: Factor on the garment's friction; the shape's static friction when None.
        is_measured: Add up contact impulses.

    Raises:
        UnsupportedShapeError: For any other kind.
        MeshError: If a mesh cannot be collided with.
    """
    if friction is None:
        friction = float(shape.physical_material.static_friction)
    pose, size, mesh = shape.local_pose, (0.0, 0.0, 0.0), None
    if isinstance(shape, physx.PhysxCollisionShapeSphere):
        kind, size = "sphere", (float(shape.radius), 0.0, 0.0)
    elif isinstance(shape, physx.PhysxCollisionShapeBox):
        x, y, z = (float(s) for s in shape.half_size)
        kind, size = "box", (x, y, z)
    elif isinstance(shape, physx.PhysxCollisionShapeCapsule):
        kind, size = "capsule", (float(shape.radius), float(shape.half_length), 0.0)
        pose = pose * _X_FROM_Z
    elif isinstance(shape, physx.PhysxCollisionShapePlane):
        kind, pose = "plane", pose * _X_FROM_Z
    elif isinstance(shape, physx.PhysxCollisionShapeCylinder):
        kind, size = "cylinder", (float(shape.radius), float(shape.half_length), 0.0)
        pose = pose * _X_FROM_Z
    elif isinstance(shape, physx.PhysxCollisionShapeConvexMesh):
        kind, mesh = "convex", _convert_mesh(shape, is_convex=True)
    elif isinstance(shape, physx.PhysxCollisionShapeTriangleMesh):
        kind, mesh = "mesh", _convert_mesh(shape, is_convex=False)
    else:
        raise UnsupportedShapeError(
            "cloth collides with planes, spheres, capsules, boxes, cylinders, convex and triangle "
            f"meshes; got {type(shape).__name__}"
        )
    return Shape(
        kind=kind, size=size, mesh=mesh, pose=_flat(pose), friction=friction,
        is_measured=is_measured,
    )  # fmt: skip


def _convert_mesh(
    shape: physx.PhysxCollisionShapeConvexMesh | physx.PhysxCollisionShapeTriangleMesh,
    *,
    is_convex: bool,
) -> CollisionMesh:
    scale = np.asarray(shape.scale, dtype=np.float32)
    vertices = np.asarray(shape.vertices, dtype=np.float32) * scale
    faces = np.asarray(shape.triangles, dtype=np.int32)
    if np.prod(scale) < 0:
        faces = faces[:, ::-1]  # a mirror turns the surface inside out
    return _make_mesh(vertices.tobytes(), faces.tobytes(), is_convex)


@lru_cache(maxsize=32)
def _make_mesh(vertices: bytes, faces: bytes, is_convex: bool) -> CollisionMesh:  # noqa: FBT001
    """Make a mesh of arrays' bytes, cached, because the same bodies return."""
    points = np.frombuffer(vertices, dtype=np.float32).reshape(-1, 3)
    if is_convex:
        return CollisionMesh.hull(points)
    triangles = np.frombuffer(faces, dtype=np.int32).reshape(-1, 3)
    return CollisionMesh(
        vertices=points, faces=triangles, is_sheet=not is_closed(points, triangles)
    )


class SapienCloth:
    """Garments of one or more SAPIEN scenes (environments) with the same rigid bodies.

    Call `build` once, then `apply_forces` before each step of SAPIEN and `step` after each
    frame of `SolverConfig.dt`.

    Limitations: reads bodies of PhysX on the CPU only.
    """

    def __init__(
        self,
        scenes: Sequence[sapien.Scene],
        *,
        colliders: Sequence[Sequence[physx.PhysxRigidBaseComponent]] | None = None,
        friction: Callable[[physx.PhysxRigidBaseComponent], float | None] | None = None,
        config: SolverConfig | None = None,
        max_force: float = 20.0,
        device: str = "cpu",
    ) -> None:
        """Collect the rigid bodies that cloth collides with.

        Args:
            scenes: One scene an environment.
            colliders: Bodies of each scene, in corresponding order; all when None.
            friction: Factor on the garments' friction of a body; its own static friction where
                this is None or returns None.
            config: Solver settings.
            max_force: Largest contact force that acts back on a body [N].
            device: Warp device.
        """
        self.scenes = list(scenes)
        self.bodies = [
            list(c) for c in (colliders or [find_colliders(scene) for scene in self.scenes])
        ]
        names = [[b.name for b in bodies] for bodies in self.bodies]
        if any(n != names[0] for n in names):
            raise ValueError("all scenes must have the same colliders in the same order")
        self.config = config or SolverConfig()
        self.max_force = max_force
        self._device = device
        self._builder = ModelBuilder(len(self.scenes))
        self.add_garment, self.add_solid = self._builder.add_garment, self._builder.add_solid
        """Methods of the `ModelBuilder` that `build` uses."""
        self._shape_body: list[int] = []
        for b, component in enumerate(self.bodies[0]):
            body = self._builder.add_body(component.name)
            factor = friction(component) if friction is not None else None
            can_move = isinstance(component, physx.PhysxRigidBodyComponent)
            for shape in component.collision_shapes:
                try:
                    collider = convert_shape(shape, friction=factor, is_measured=can_move)
                except (UnsupportedShapeError, MeshError) as err:
                    raise type(err)(f"body {component.name!r}: {err}") from err
                # fixed bodies belong to the world: their pose is folded into the shape
                if not can_move:
                    pose = component.entity_pose * _pose(collider.pose)
                    collider = replace(collider, pose=_flat(pose))
                self._builder.add_shape(collider, body=body if can_move else 0)
                self._shape_body.append(b)
        self.model: Model | None = None

    def build(self) -> None:
        """Build model, state and solver of the added garments."""
        self.model = self._builder.build(self._device)
        self.state = State(self.model)
        self.solver = SolverXPBD(self.model, self.config)
        self._forces = np.zeros((len(self.scenes), len(self.bodies[0]), 6), dtype=np.float32)
        self.sync_bodies(is_jump=True)

    def sync_bodies(self, *, is_jump: bool = False) -> None:
        """Read the bodies' poses; with `is_jump` they have no velocity from it."""
        poses = np.zeros((len(self.scenes), len(self.bodies[0]) + 1, 7), dtype=np.float32)
        poses[:, 0, 3] = 1.0
        for rows, bodies in zip(poses, self.bodies, strict=True):
            for row, component in zip(rows[1:], bodies, strict=True):
                pose = component.entity_pose
                row[:3], row[3:] = pose.p, pose.q
        self.state.set_body_poses(poses, is_jump=is_jump)

    def step(self) -> None:
        """Advance the cloth by one frame, over the bodies' motion since the last call."""
        self.sync_bodies()
        self.solver.step(self.state)
        self._forces = self._sum_forces()

    def measure_strain(self, env: int = 0) -> np.ndarray:
        """Measure the absolute strain of every edge of an environment, shape (E,)."""
        positions = self.state.get_positions()[env]
        parts = []
        for g in self._built().garments:
            if g.env == env:
                ends = positions[g.first + g.edges]
                length = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)
                parts.append(np.abs(length / g.rest_lengths - 1.0))
        return np.concatenate(parts)

    def get_forces(self) -> np.ndarray:
        """Return contact force [N] and torque about the centre of mass [N m] of each body.

        Returns:
            World frame, averaged over the last frame, shape (B, bodies, 6).
        """
        return self._forces

    def set_forces(self, forces: np.ndarray) -> None:
        """Restore forces of `get_forces`, shape (B, bodies, 6)."""
        if forces.shape != self._forces.shape:
            raise ValueError(f"forces must have shape {self._forces.shape}; got {forces.shape}")
        self._forces = np.array(forces, dtype=np.float32)

    def apply_forces(self) -> None:
        """Apply the last frame's contact forces to the bodies; before each step of SAPIEN."""
        for e, b in np.argwhere(self._forces[..., :3].any(axis=-1)):
            component = self.bodies[e][b]
            is_driven = isinstance(component, physx.PhysxRigidDynamicComponent) and (
                component.kinematic  # PhysX refuses forces on kinematic bodies
            )
            if isinstance(component, physx.PhysxRigidBodyComponent) and not is_driven:
                force = self._forces[e, b]
                component.add_force_torque(force[:3], force[3:])  # pyright: ignore[reportArgumentType]

    def _built(self) -> Model:
        if self.model is None:
            raise RuntimeError("build() must be called first")
        return self.model

    def _sum_forces(self) -> np.ndarray:
        total = np.zeros((len(self.scenes), len(self.bodies[0]), 6), dtype=np.float32)
        impulse = self.state.impulse.numpy() + self.state.press.numpy()
        if not impulse.any():
            return total
        impulse = impulse[:, : len(self._shape_body)]  # (B, S, 6)
        rows = (slice(None), self._shape_body)
        np.add.at(total, rows, impulse / self.config.dt)  # pyright: ignore[reportArgumentType]
        for e, b in np.argwhere(total[..., :3].any(axis=-1)):
            component = self.bodies[e][b]
            if isinstance(component, physx.PhysxRigidBodyComponent):
                x, y, z = (component.entity_pose * component.cmass_local_pose).p
                force = total[e, b, :3]
                fx, fy, fz = force
                total[e, b, 3:] -= (y * fz - z * fy, z * fx - x * fz, x * fy - y * fx)
                total[e, b] *= min(1.0, self.max_force / max(float(np.linalg.norm(force)), 1e-9))
        return total


def _pose(flat: np.ndarray) -> sapien.Pose:
    return sapien.Pose(flat[:3], flat[3:])  # pyright: ignore[reportArgumentType]


def _flat(pose: sapien.Pose) -> np.ndarray:
    return np.concatenate([pose.p, pose.q]).astype(np.float32)
