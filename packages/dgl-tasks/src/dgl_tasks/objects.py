"""Objects in scenes: seen by the cameras, felt by cloth and robots."""

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING

import numpy as np
import sapien

from dgl_assets.props import Prop, PropShape, make_prop
from dgl_physics.drawing.camera import Vector3
from dgl_tasks.declaration import SceneObject, Task
from dgl_tasks.drawing.bodies import ShownMeshes, make_part_mesh
from dgl_tasks.robot import let_robot_pass, let_robot_through

if TYPE_CHECKING:
    from mani_skill.envs.scene import ManiSkillScene
    from mani_skill.utils.structs import Actor

_TEXELS = 256  # of a wood's tile of 0.6 m: 2.3 mm
# SAPIEN's capsules and cylinders are along x, those of props along z.
_X_FROM_Z = sapien.Pose(q=[np.sqrt(0.5), 0, np.sqrt(0.5), 0])


class PlacedObject:
    """An object that stands in a scene; it moves only when it is placed."""

    def __init__(
        self, scene: "ManiSkillScene", declared: SceneObject, rng: np.random.Generator
    ) -> None:
        """Add a kinematic body with the object's shapes and, with a renderer, its looks.

        Args:
            scene: Where it is added.
            declared: The declaration.
            rng: Draws which of several props it is.
        """
        self.declared = declared
        self._number = int(rng.integers(len(declared.props)))
        self.prop: Prop = make_prop(declared.props[self._number])
        self._frames: tuple[np.ndarray, dict[str, np.ndarray]] | None = None
        builder = scene.create_actor_builder()
        builder.initial_pose = _make_pose(declared.position, declared.yaw)  # pyright: ignore[reportAttributeAccessIssue]
        self.actor: Actor = builder.build_kinematic(name=declared.name)
        # ManiSkill has no way to add shapes of points
        self.entity: sapien.Entity = self.actor._objs[0]  # noqa: SLF001
        body = self.entity.find_component_by_type(sapien.physx.PhysxRigidDynamicComponent)
        assert isinstance(body, sapien.physx.PhysxRigidDynamicComponent)
        material = sapien.physx.PhysxMaterial(declared.friction, declared.friction, 0.0)
        for shape in self.prop.shapes:
            body.attach(_convert_shape(shape, material))
        if declared.solid_to == "hands":
            let_robot_pass(self.actor)
        elif declared.solid_to == "garment":
            let_robot_through(self.actor)
        if scene.can_render():
            ShownMeshes(self.entity).replace(
                [make_part_mesh(part, texels=_TEXELS) for part in self.prop.parts]
            )

    @property
    def pose(self) -> np.ndarray:
        """Pose of the object: xyz [m] and quaternion wxyz, shape (7,), world frame."""
        pose = self.entity.pose
        return np.concatenate([pose.p, pose.q]).astype(np.float64)

    def get_frames(self) -> dict[str, np.ndarray]:
        """Named frames of the object now [m], shape (3,), world frame."""
        pose = self.pose
        if self._frames is None or not np.array_equal(self._frames[0], pose):
            self._frames = pose, self.prop.compute_landmarks(pose)
        return dict(self._frames[1])

    def place(self, position: Vector3, yaw: float = 0.0) -> None:
        """Place the object at once.

        Cloth takes this for a motion and is carried or hit by it; to avoid that, call
        `SapienCloth.sync_bodies(is_jump=True)` after placing.

        Args:
            position: Of the object's frame [m], world frame.
            yaw: Rotation about z [rad].
        """
        self.entity.set_pose(_make_pose(position, yaw))

    def draw(self, rng: np.random.Generator) -> dict[str, float]:
        """Place the object at random within its ranges.

        Returns:
            The draws by name: place [m]; turn [rad] and number of the prop, where they are drawn.
        """
        p = self.declared
        dx, dy = float(rng.uniform(*p.x_range)), float(rng.uniform(*p.y_range))
        x, y, z = p.position
        draws: dict[str, float] = {f"{p.name}_x": x + dx, f"{p.name}_y": y + dy}
        yaw = p.yaw
        if p.yaw_range != (0.0, 0.0):
            yaw += float(rng.uniform(*p.yaw_range))
            draws[f"{p.name}_yaw"] = yaw
        if len(p.props) > 1:
            draws[f"{p.name}_prop"] = self._number
        self.place((x + dx, y + dy, z), yaw)
        return draws


def compute_frames(task: Task, draws: Mapping[str, object]) -> dict[str, dict[str, np.ndarray]]:
    """Compute the frames of a task's objects from the draws of an episode.

    Args:
        task: Its declaration.
        draws: Of the episode, as `GarmentEnv.draws` and episode files hold them.

    Returns:
        Positions by object and frame [m], shape (3,), world frame.

    Raises:
        ValueError: If the draws lack an object's place.
    """
    frames = {}
    for item in task.objects:
        place = [draws.get(f"{item.name}_{axis}") for axis in "xy"]
        if not all(isinstance(number, float) for number in place):
            raise ValueError(f"the draws must tell where {item.name} stands; got {place}")
        yaw, number = draws.get(f"{item.name}_yaw", item.yaw), draws.get(f"{item.name}_prop", 0)
        if not isinstance(yaw, float) or number not in range(len(item.props)):
            raise ValueError(
                f"the draws must tell the turn of {item.name} and which of its {len(item.props)} "
                f"props it is; got {yaw} and {number}"
            )
        pose = _make_pose((place[0], place[1], item.position[2]), yaw)  # pyright: ignore[reportArgumentType]
        pose = np.concatenate([pose.p, pose.q]).astype(np.float64)
        frames[item.name] = make_prop(item.props[number]).compute_landmarks(pose)  # pyright: ignore[reportArgumentType, reportCallIssue]
    return frames


def measure_touch(scene: sapien.Scene, objects: Iterable[PlacedObject]) -> dict[str, float]:
    """Measure the force with which bodies press on each object that is to be avoided.

    Args:
        scene: After a step of the rigid bodies.
        objects: Objects in it.

    Returns:
        Sum of the contacts' forces by object [N]; the garment has no part in it.
    """
    avoided = {item.entity: item.declared.name for item in objects if item.declared.avoided}
    forces = dict.fromkeys(avoided.values(), 0.0)
    for contact in scene.get_contacts() if avoided else ():
        for body in contact.bodies:
            if (name := avoided.get(body.entity)) is not None:
                impulses = np.array([point.impulse for point in contact.points])
                forces[name] += float(np.linalg.norm(impulses, axis=1).sum()) / scene.timestep
    return forces


def _make_pose(position: Vector3, yaw: float) -> sapien.Pose:
    return sapien.Pose(list(position), [np.cos(yaw / 2), 0.0, 0.0, np.sin(yaw / 2)])


def _convert_shape(
    shape: PropShape, material: sapien.physx.PhysxMaterial
) -> sapien.physx.PhysxCollisionShape:
    physx, pose = sapien.physx, sapien.Pose(list(shape.xyz), list(shape.wxyz))
    if shape.kind == "box":
        solid = physx.PhysxCollisionShapeBox(list(shape.half_size), material)  # pyright: ignore[reportArgumentType]
    elif shape.points is None:
        is_capsule = shape.kind == "capsule"
        make = physx.PhysxCollisionShapeCapsule if is_capsule else physx.PhysxCollisionShapeCylinder
        solid = make(shape.radius, shape.half_length, material)
        pose = pose * _X_FROM_Z
    else:
        points, scale = shape.points.astype(np.float32), np.ones(3, dtype=np.float32)
        if shape.faces is None:
            solid = physx.PhysxCollisionShapeConvexMesh(points, scale, material)
        else:
            triangles = shape.faces.astype(np.uint32)
            solid = physx.PhysxCollisionShapeTriangleMesh(points, triangles, scale, material)
    solid.local_pose = pose
    return solid
