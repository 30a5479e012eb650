"""Cloth in SAPIEN scenes: colliders in, contact forces out, garments in pictures.

The coupling follows the usual recipe of two simulators that exchange poses and impulses every
frame: SAPIEN moves the rigid bodies, the cloth is advanced over the same time with the bodies on
straight paths between their old and new poses, and the contact forces act on the bodies during
the next frame.
"""

from collections.abc import Callable, Sequence

import numpy as np
import sapien
from sapien import physx, render

from dgl_physics.errors import PhysicsError
from dgl_physics.material import ClothMaterial
from dgl_physics.model import Model, ModelBuilder
from dgl_physics.shapes import Shape
from dgl_physics.solver import SolverConfig, SolverXPBD
from dgl_physics.state import State

# SAPIEN's capsules and planes are along x, ours along z.
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


def convert_shape(shape: physx.PhysxCollisionShape, *, friction: float | None = None) -> Shape:
    """Convert a SAPIEN collision shape to a cloth collider in the frame of its component.

    Args:
        shape: Plane, sphere, capsule or box.
        friction: Factor on the garment's friction; the shape's static friction when None.

    Raises:
        UnsupportedShapeError: For any other kind.
    """
    if friction is None:
        friction = float(shape.physical_material.static_friction)
    pose = shape.local_pose
    if isinstance(shape, physx.PhysxCollisionShapeSphere):
        return Shape(kind="sphere", size=(shape.radius, 0, 0), pose=_flat(pose), friction=friction)
    if isinstance(shape, physx.PhysxCollisionShapeBox):
        x, y, z = (float(s) for s in shape.half_size)
        return Shape(kind="box", size=(x, y, z), pose=_flat(pose), friction=friction)
    pose = pose * _X_FROM_Z
    if isinstance(shape, physx.PhysxCollisionShapeCapsule):
        size = (float(shape.radius), float(shape.half_length), 0.0)
        return Shape(kind="capsule", size=size, pose=_flat(pose), friction=friction)
    if isinstance(shape, physx.PhysxCollisionShapePlane):
        return Shape(kind="plane", pose=_flat(pose), friction=friction)
    raise UnsupportedShapeError(
        f"cloth collides with planes, spheres, capsules and boxes; got {type(shape).__name__}"
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
        self._shape_body: list[int] = []
        for b, component in enumerate(self.bodies[0]):
            body = self._builder.add_body(component.name)
            factor = friction(component) if friction is not None else None
            for shape in component.collision_shapes:
                try:
                    self._builder.add_shape(convert_shape(shape, friction=factor), body=body)
                except UnsupportedShapeError as err:
                    raise UnsupportedShapeError(f"body {component.name!r}: {err}") from err
                self._shape_body.append(b)
        self.model: Model | None = None

    def add_garment(
        self,
        vertices: np.ndarray,
        faces: np.ndarray,
        *,
        material: ClothMaterial | None = None,
        rest: np.ndarray | None = None,
        env: int | None = None,
    ) -> None:
        """Add a garment; the arguments are those of `ModelBuilder.add_garment`."""
        self._builder.add_garment(vertices, faces, material=material, rest=rest, env=env)

    def build(self) -> None:
        """Build model, state and solver from what was added."""
        self.model = self._builder.build(self._device)
        self.state: State = self.model.make_state()
        self.solver = SolverXPBD(self.model, self.config)
        self._forces = np.zeros((len(self.scenes), len(self.bodies[0]), 6), dtype=np.float32)
        self.sync_bodies(is_jump=True)

    def sync_bodies(self, *, is_jump: bool = False) -> None:
        """Read the bodies' poses; with `is_jump` they have no velocity from it."""
        poses = np.zeros((len(self.scenes), len(self.bodies[0]) + 1, 7), dtype=np.float32)
        poses[:, 0, 3] = 1.0
        for e, bodies in enumerate(self.bodies):
            for b, component in enumerate(bodies):
                poses[e, b + 1] = _flat(component.entity_pose)
        self.state.set_body_poses(poses, is_jump=is_jump)

    def step(self) -> None:
        """Advance the cloth by one frame, over the bodies' motion since the last call."""
        self.sync_bodies()
        self.solver.step(self.state)
        self._forces = self._sum_forces()

    def measure_strain(self, env: int = 0) -> np.ndarray:
        """Absolute relative change of length of every edge of an environment, shape (E,)."""
        positions = self.state.get_positions()[env]
        parts = []
        for g in self._built().garments:
            if g.env == env:
                ends = positions[g.first + g.edges]
                length = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)
                parts.append(np.abs(length / g.rest_lengths - 1.0))
        return np.concatenate(parts)

    def get_forces(self) -> np.ndarray:
        """Contact force [N] and torque about the centre of mass [N m] of each body.

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
        for e, b in zip(*np.nonzero(np.abs(self._forces[..., :3]).sum(axis=-1)), strict=True):
            component = self.bodies[e][b]
            if isinstance(component, physx.PhysxRigidBodyComponent):
                force = self._forces[e, b]
                component.add_force_torque(force[:3], force[3:])

    def _built(self) -> Model:
        if self.model is None:
            raise RuntimeError("build() must be called first")
        return self.model

    def _sum_forces(self) -> np.ndarray:
        impulse = self.state.impulse.numpy()[:, : len(self._shape_body)]  # (B, S, 6)
        total = np.zeros((len(self.scenes), len(self.bodies[0]), 6), dtype=np.float32)
        np.add.at(total, (slice(None), self._shape_body), impulse / self.config.dt)
        for e, b in zip(*np.nonzero(np.abs(total[..., :3]).sum(axis=-1)), strict=True):
            component = self.bodies[e][b]
            if isinstance(component, physx.PhysxRigidBodyComponent):
                centre = (component.entity_pose * component.cmass_local_pose).p
                force = total[e, b, :3]
                total[e, b, 3:] -= np.cross(centre, force)
                total[e, b] *= min(1.0, self.max_force / max(float(np.linalg.norm(force)), 1e-9))
        return total


class GarmentVisual:
    """A garment's surface in one SAPIEN scene.

    SAPIEN's triangle meshes are fixed, so each `update` replaces the mesh; update before taking
    a picture, not every frame. Both windings are drawn, because back faces are culled.
    """

    def __init__(
        self,
        scene: sapien.Scene,
        faces: np.ndarray,
        *,
        colour: tuple[float, float, float] = (0.85, 0.5, 0.12),
        roughness: float = 0.9,
        name: str = "garment",
    ) -> None:
        """Add an entity with the garment's material to the scene; it is empty until `update`."""
        self._faces = np.asarray(faces, dtype=np.uint32)
        self._material = render.RenderMaterial()
        self._material.base_color = [*colour, 1.0]
        self._material.roughness = roughness
        self._material.specular = 0.1
        self._component: render.RenderBodyComponent | None = None
        self.entity = sapien.Entity()
        self.entity.name = name
        scene.add_entity(self.entity)

    def update(self, positions: np.ndarray) -> None:
        """Draw the surface at these particle positions [m], shape (V, 3), world frame."""
        positions = np.asarray(positions, dtype=np.float32)
        normals = compute_vertex_normals(positions, self._faces)
        count = len(positions)
        shape = render.RenderShapeTriangleMesh(
            vertices=np.concatenate([positions, positions]),
            triangles=np.concatenate([self._faces, self._faces[:, ::-1] + count]).astype(np.uint32),
            normals=np.concatenate([normals, -normals]),
            uvs=np.zeros((2 * count, 2), dtype=np.float32),
            material=self._material,
        )
        component = render.RenderBodyComponent()
        component.attach(shape)
        if self._component is not None:
            self.entity.remove_component(self._component)
        self.entity.add_component(component)
        self._component = component


def compute_vertex_normals(positions: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Compute area-weighted unit normals of a mesh's vertices, shape (V, 3), float32."""
    a, b, c = (positions[faces[:, k]] for k in range(3))
    weighted = np.cross(b - a, c - a)
    normals = np.stack(
        [
            np.bincount(faces.ravel(), np.repeat(weighted[:, k], 3), minlength=len(positions))
            for k in range(3)
        ],
        axis=1,
    )
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    return (normals / np.maximum(length, 1e-12)).astype(np.float32)


def _flat(pose: sapien.Pose) -> np.ndarray:
    return np.concatenate([pose.p, pose.q]).astype(np.float32)
