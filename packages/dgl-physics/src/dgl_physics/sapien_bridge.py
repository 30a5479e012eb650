"""Cloth in SAPIEN scenes: colliders in, contact forces out, garments in pictures.

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
from sapien import physx, render

from dgl_physics.collision_mesh import CollisionMesh, is_closed
from dgl_physics.errors import MeshError, PhysicsError
from dgl_physics.model import Model, ModelBuilder
from dgl_physics.shapes import Shape
from dgl_physics.solver import SolverXPBD
from dgl_physics.solver_config import SolverConfig
from dgl_physics.state import State
from dgl_physics.topology import compute_vertex_normals

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


class GarmentVisual:
    """A garment's surface in one SAPIEN scene.

    SAPIEN's triangle meshes are fixed, so each `update` replaces the mesh; update before taking
    a picture, not every frame. Back faces are culled, so the surface is drawn with both windings:
    its outside, and its inside in a darker shade.
    """

    INSIDE_SHADE = 0.9
    """Brightness of the inside, a factor on the (linear) colour."""
    SPECULAR = 0.008
    """Share of perpendicular light that is reflected."""

    def __init__(
        self,
        scene: sapien.Scene,
        faces: np.ndarray,
        *,
        colour: tuple[float, float, float] = (0.85, 0.5, 0.12),
        roughness: float = 0.9,
        uvs: np.ndarray | None = None,
        texture: np.ndarray | None = None,
        thickness: float = 0.004,
        name: str = "garment",
    ) -> None:
        """Add an entity with the garment's materials to the scene; it is empty until `update`.

        Args:
            scene: Scene that shows the garment.
            faces: Triangles of particles, shape (F, 3), seen from outside counter-clockwise.
            colour: Base colour, linear, each in [0, 1]; used where there is no texture.
            roughness: 0 for a mirror, 1 for chalk.
            uvs: Texture coordinates in tiles of each particle, shape (V, 2), or of each corner,
                shape (F, 3, 2), where the two sides of a seam differ; needed with a texture.
            texture: One tile of the outside, shape (H, W, 3), uint8, sRGB.
            thickness: Thickness of the cloth [m]; the surface is drawn half of it outwards, so that
                the outer of two layers is seen.
            name: Name of the entity.
        """
        if texture is not None:
            if uvs is None:
                raise ValueError(
                    "a texture must come with uvs of shape (V, 2) or (F, 3, 2); got None"
                )
            if texture.ndim != 3 or texture.shape[2] != 3 or texture.dtype != np.uint8:
                raise ValueError(
                    "texture must have shape (H, W, 3) and dtype uint8; "
                    f"got {texture.shape} {texture.dtype}"
                )
        self._particle_faces = self.faces = np.asarray(faces, dtype=np.uint32)
        """Triangles of the drawn vertices, shape (F, 3), uint32."""
        self.uvs = None if uvs is None else np.ascontiguousarray(uvs, dtype=np.float32)
        """Texture coordinates of the drawn vertices, shape (W, 2), float32."""
        self._particles: np.ndarray | None = None
        if self.uvs is not None and self.uvs.ndim == 3:
            self.faces, self.uvs, self._particles = _cut_seams(self.faces, self.uvs)
        self._windings = (self.faces, np.ascontiguousarray(self.faces[:, ::-1]))
        self._materials = tuple(
            _make_cloth_material(colour, texture, roughness=roughness, shade=shade)
            for shade in (1.0, self.INSIDE_SHADE)
        )
        self._thickness = thickness
        self._component: render.RenderBodyComponent | None = None
        self.entity = sapien.Entity()
        self.entity.name = name
        scene.add_entity(self.entity)

    def compute_surface(self, positions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Compute the drawn surface, the outside of the cloth.

        Args:
            positions: Of the particles [m], shape (V, 3), world frame.

        Returns:
            Vertices [m] and their normals, each of shape (W, 3).
        """
        positions = np.asarray(positions, dtype=np.float32)
        normals = compute_vertex_normals(positions, self._particle_faces)
        surface = positions + np.float32(self._thickness / 2) * normals
        if self._particles is None:
            return surface, normals
        return surface[self._particles], normals[self._particles]

    def update(self, positions: np.ndarray) -> None:
        """Draw the surface at these particle positions [m], shape (V, 3), world frame."""
        if self._particles is None and self.uvs is not None and len(self.uvs) != len(positions):
            raise ValueError(
                f"positions must have shape ({len(self.uvs)}, 3); got {positions.shape}"
            )
        surface, normals = self.compute_surface(positions)
        uvs = np.zeros((len(surface), 2), np.float32) if self.uvs is None else self.uvs
        component = render.RenderBodyComponent()
        for sign, triangles, material in zip((1, -1), self._windings, self._materials, strict=True):
            shape = render.RenderShapeTriangleMesh(
                vertices=surface,
                triangles=triangles,
                normals=sign * normals,
                uvs=uvs,
                material=material,
            )
            component.attach(shape)
        if self._component is not None:
            self.entity.remove_component(self._component)
        self.entity.add_component(component)
        self._component = component


def _cut_seams(
    faces: np.ndarray, corner_uvs: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Give every corner with its own texture coordinates a vertex of its own.

    Args:
        faces: Triangles of particles, shape (F, 3).
        corner_uvs: Texture coordinates of their corners, shape (F, 3, 2).

    Returns:
        Triangles, shape (F, 3), uint32; texture coordinates of their vertices, shape (W, 2),
        float32; and the particle of each vertex, shape (W,).
    """
    if corner_uvs.shape != (*faces.shape, 2):
        raise ValueError(
            f"uvs of corners must have shape {(*faces.shape, 2)}; got {corner_uvs.shape}"
        )
    corners = np.concatenate(
        [faces.reshape(-1, 1).astype(np.float64), corner_uvs.reshape(-1, 2)], axis=1
    )
    found, inverse = np.unique(corners, axis=0, return_inverse=True)
    return (
        inverse.reshape(faces.shape).astype(np.uint32),
        np.ascontiguousarray(found[:, 1:], dtype=np.float32),
        found[:, 0].astype(np.int64),
    )


def _make_cloth_material(
    colour: tuple[float, float, float],
    texture: np.ndarray | None,
    *,
    roughness: float,
    shade: float,
) -> render.RenderMaterial:
    """Make a matt material whose linear colour is scaled by `shade`."""
    material = render.RenderMaterial()
    material.base_color = [*(shade * c for c in colour), 1.0]
    material.roughness = roughness
    material.specular = GarmentVisual.SPECULAR / 0.08  # SAPIEN's unit
    if texture is not None:
        # sRGB is close to a power law, so a linear factor is this factor on its values
        image = (texture * shade ** (1 / 2.2)).astype(np.uint8)
        opaque = np.full((*image.shape[:2], 1), 255, dtype=np.uint8)
        material.base_color_texture = render.RenderTexture2D(
            np.ascontiguousarray(np.concatenate([image, opaque], axis=2)),
            "R8G8B8A8Unorm",
            mipmap_levels=max(1, int(np.log2(min(image.shape[:2])))),
            srgb=True,
        )
    return material


def _pose(flat: np.ndarray) -> sapien.Pose:
    return sapien.Pose(flat[:3], flat[3:])  # pyright: ignore[reportArgumentType]


def _flat(pose: sapien.Pose) -> np.ndarray:
    return np.concatenate([pose.p, pose.q]).astype(np.float32)
