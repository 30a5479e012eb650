"""The coupling to SAPIEN: shapes arrive where they are, forces come back."""

from types import SimpleNamespace

import numpy as np
import pytest

sapien = pytest.importorskip("sapien")
from sapien import physx  # noqa: E402

from dgl_physics import ClothMaterial, MeshError, SolverConfig, sapien_bridge  # noqa: E402
from dgl_physics.sapien_bridge import (  # noqa: E402
    SapienCloth,
    UnsupportedShapeError,
    convert_shape,
    find_colliders,
)
from dgl_physics.topology import compute_vertex_normals  # noqa: E402

REST = ClothMaterial().rest_offset
TRIANGLE = np.array([[-2, -1, 0], [2, -1, 0], [0, 2, 0]]) * 1e-3
FACE = np.array([[0, 1, 2]])
YAW = [np.cos(0.3), 0, 0, np.sin(0.3)]


def make_scene():
    return sapien.Scene([physx.PhysxCpuSystem()])


def make_material():
    return physx.PhysxMaterial(1.0, 1.0, 0.0)


def add_static(scene, shape, pose):
    component = physx.PhysxRigidStaticComponent()
    component.attach(shape)
    entity = sapien.Entity()
    entity.name = "thing"
    entity.add_component(component)
    entity.set_pose(sapien.Pose(*pose))
    scene.add_entity(entity)
    component.name = "thing"
    return component


def land(scene, points):
    """Drop a small triangle on each point (x, y) from 0.5 m; heights at which they rest, (N,)."""
    cloth = SapienCloth([scene])
    for x, y in points:
        cloth.add_garment(np.add(TRIANGLE, [x, y, 0.4]), FACE)
    cloth.build()
    for _ in range(60):
        cloth.step()
    return cloth.state.get_positions()[0].reshape(-1, 3, 3).mean(axis=1)[:, 2]


def rotate(q, x):
    return (sapien.Pose(q=q) * sapien.Pose(p=x)).p


def test_a_capsule_lies_along_its_x_axis():
    scene = make_scene()
    capsule = physx.PhysxCollisionShapeCapsule(0.05, 0.2, make_material())
    add_static(scene, capsule, ([0.1, 0.2, 0.15], YAW))
    points = [(np.array([0.1, 0.2, 0]) + rotate(YAW, [s, 0, 0]))[:2] for s in (-0.19, 0.0, 0.19)]
    assert land(scene, points) == pytest.approx(0.15 + 0.05 + REST, abs=1e-3)
    beside = (np.array([0.1, 0.2, 0]) + rotate(YAW, [0, 0.1, 0]))[:2]
    assert land(scene, [beside])[0] < 0.0


def test_a_box_has_its_three_sizes_and_its_turn():
    scene = make_scene()
    shape = physx.PhysxCollisionShapeBox([0.1, 0.2, 0.03], make_material())
    add_static(scene, shape, ([0.1, 0.0, 0.1], YAW))
    centre = np.array([0.1, 0, 0])
    inside = [
        (centre + rotate(YAW, [sx * 0.09, sy * 0.19, 0]))[:2] for sx in (-1, 1) for sy in (-1, 1)
    ]
    assert land(scene, inside) == pytest.approx(0.1 + 0.03 + REST, abs=1e-4)
    outside = [(centre + rotate(YAW, [sx * 0.115, 0, 0]))[:2] for sx in (-1, 1)]
    assert land(scene, outside).max() < 0.0


def test_a_sphere_and_its_local_pose():
    scene = make_scene()
    sphere = physx.PhysxCollisionShapeSphere(0.06, make_material())
    sphere.local_pose = sapien.Pose([0.05, 0, 0])
    add_static(scene, sphere, ([0, 0, 0.1], [np.sqrt(0.5), 0, 0, np.sqrt(0.5)]))  # x becomes y
    assert land(scene, [(0.0, 0.05)]) == pytest.approx(0.16 + REST, abs=1e-3)


def test_a_plane_faces_along_its_x_axis():
    """SAPIEN's ground: a plane turned so that its x axis is up."""
    scene = make_scene()
    scene.add_ground(0.07, render=False)
    assert land(scene, [(0.0, 0.0), (0.4, -0.3)]) == pytest.approx(0.07 + REST, abs=1e-4)


def test_a_moving_body_is_followed():
    """A kinematic box that moves under the cloth carries it."""
    scene = make_scene()
    builder = scene.create_actor_builder()
    builder.add_box_collision(half_size=[0.1, 0.1, 0.01], material=make_material())
    tray = builder.build_kinematic(name="tray")
    tray.set_pose(sapien.Pose([0, 0, 0.1]))
    cloth = SapienCloth([scene])
    cloth.add_garment(np.add(TRIANGLE, [0, 0, 0.11 + REST]), FACE)
    cloth.build()
    for k in range(60):
        tray.set_pose(sapien.Pose([0.1 * k / 60, 0, 0.1 + 0.1 * k / 60]))
        cloth.step()
    x = cloth.state.get_positions()[0].mean(axis=0)
    assert x == pytest.approx([0.1 * 59 / 60, 0, 0.1 + 0.1 * 59 / 60 + 0.01 + REST], abs=2e-3)


def test_a_kinematic_body_gets_no_forces(capfd):
    """It cannot be moved by them, and PhysX reports each one as an error."""
    scene = make_scene()
    builder = scene.create_actor_builder()
    builder.add_box_collision(half_size=[0.1, 0.1, 0.01], material=make_material())
    builder.build_kinematic(name="tray").set_pose(sapien.Pose([0, 0, 0.1]))
    cloth = SapienCloth([scene])
    cloth.add_garment(np.add(TRIANGLE, [0, 0, 0.11 + REST]), FACE)
    cloth.build()
    for _ in range(5):
        cloth.apply_forces()
        scene.step()
        cloth.step()
    assert cloth.get_forces()[0, 0, 2] < 0, "what lies on it presses on it"
    assert "kinematic" not in "".join(capfd.readouterr())


@pytest.fixture
def drop(sheet):
    """Drop a sheet on a floating block without gravity; body, cloth and the impulse it got."""

    def run(mass, *, frames=60, max_force=20.0):
        scene = make_scene()
        scene.set_timestep(1 / 60)
        builder = scene.create_actor_builder()
        builder.add_box_collision(half_size=[0.1, 0.1, 0.02], material=make_material())
        body = builder.build(name="block").find_component_by_type(physx.PhysxRigidDynamicComponent)
        body.mass, body.inertia, body.disable_gravity = mass, [mass * 0.01] * 3, True
        body.linear_damping = body.angular_damping = 0.0
        cloth = SapienCloth([scene], max_force=max_force)
        cloth.add_garment(*sheet(0.08, 0.08, 0.0125, height=0.05), material=ClothMaterial(drag=0.0))
        cloth.build()
        impulse = np.zeros(3)
        for _ in range(frames):
            cloth.apply_forces()
            impulse += cloth.get_forces()[0, 0, :3] / 60
            scene.step()
            cloth.step()
        return body, cloth, impulse

    return run


def test_forces_reach_a_dynamic_body(drop):
    """The block gets the momentum that the cloth loses, with one frame of delay."""
    body, cloth, impulse = drop(mass=50.0)
    assert body.linear_velocity[2] * 50.0 == pytest.approx(impulse[2], rel=0.01)
    mass = (1.0 / cloth.model.inverse_mass.numpy()).sum()
    momentum = mass * cloth.state.get_velocities()[0, :, 2].mean()
    assert impulse[2] == pytest.approx(-(mass * 9.81 * 59 / 60 + momentum), rel=0.03)
    assert impulse[:2] == pytest.approx(0, abs=0.02 * abs(impulse[2]))


def test_a_light_body_gives_way(drop):
    light, _first, _ = drop(mass=0.05, frames=20)  # bodies live as long as their scenes
    heavy, _second, _ = drop(mass=5.0, frames=20)
    assert light.linear_velocity[2] < 5 * heavy.linear_velocity[2] < 0


def test_forces_are_bounded(drop):
    _, cloth, _ = drop(mass=50.0, frames=8, max_force=0.01)
    peak = 0.0
    for _ in range(10):
        cloth.step()
        peak = max(peak, np.linalg.norm(cloth.get_forces()[0, 0, :3]))
    assert 0.0 < peak <= 0.01 * (1 + 1e-6)


def test_forces_can_be_restored(drop):
    _, cloth, _ = drop(mass=50.0)
    forces = cloth.get_forces().copy()
    cloth.set_forces(np.zeros_like(forces))
    assert np.abs(cloth.get_forces()).max() == 0.0
    cloth.set_forces(forces)
    np.testing.assert_array_equal(cloth.get_forces(), forces)
    with pytest.raises(ValueError, match="forces must have shape"):
        cloth.set_forces(forces[0])


def test_a_cylinder_lies_along_its_x_axis():
    scene = make_scene()
    cylinder = physx.PhysxCollisionShapeCylinder(0.05, 0.2, make_material())
    add_static(scene, cylinder, ([0.1, 0.2, 0.15], YAW))
    points = [(np.array([0.1, 0.2, 0]) + rotate(YAW, [s, 0, 0]))[:2] for s in (-0.19, 0.0, 0.19)]
    assert land(scene, points) == pytest.approx(0.15 + 0.05 + REST, abs=1e-3)
    beyond = (np.array([0.1, 0.2, 0]) + rotate(YAW, [0.215, 0, 0]))[:2]
    assert land(scene, [beyond])[0] < 0.0  # its ends are flat, a capsule's are not


@pytest.mark.parametrize(
    ("kind", "scale"),  # PhysX has no mirrored hulls
    [("convex", [1, 2, 0.5]), ("mesh", [1, 2, 0.5]), ("mesh", [-1, 2, 0.5])],
)
def test_meshes_have_their_scale(meshes, kind, scale):
    """A wedge: high at its +x end, low at the other; a mirror turns that round."""
    vertices, faces = meshes.make_box([0.1, 0.05, 0.1])
    vertices[(vertices[:, 0] < 0) & (vertices[:, 2] > 0), 2] = 0.0
    scene, material = make_scene(), make_material()
    arrays = vertices.astype(np.float32), faces.astype(np.uint32)
    if kind == "convex":
        shape = physx.PhysxCollisionShapeConvexMesh(arrays[0], np.array(scale), material)
    else:
        shape = physx.PhysxCollisionShapeTriangleMesh(*arrays, np.array(scale), material)
    collider = convert_shape(shape)
    assert collider.kind == kind
    extent = np.ptp(collider.mesh.vertices, axis=0)
    assert extent == pytest.approx([0.2, 0.2, 0.1], abs=1e-5)
    add_static(scene, shape, ([0, 0, 0.2], [1, 0, 0, 0]))
    high = 0.095 * scale[0]
    height = land(scene, [(high, 0.09)])
    assert height == pytest.approx(0.25 + REST, abs=6e-3)  # it may slip down a little


def test_a_mesh_with_a_hole_is_no_hull(meshes):
    """Cloth falls through the middle of a ring and stays on its bar."""
    scene = make_scene()
    vertices, faces = meshes.make_torus(0.06, 0.02, rings=64)
    shape = physx.PhysxCollisionShapeTriangleMesh(
        vertices.astype(np.float32), faces.astype(np.uint32), np.ones(3), make_material()
    )
    add_static(scene, shape, ([0, 0, 0.2], [1, 0, 0, 0]))
    heights = land(scene, [(0.0, 0.0), (0.06, 0.0)])
    assert heights[0] < 0.0
    assert heights[1] == pytest.approx(0.22 + REST, abs=2e-3)


def test_an_open_mesh_is_a_sheet(meshes):
    """The lid of a box alone: cloth stays above, and what starts below falls."""
    scene = make_scene()
    vertices, faces = meshes.make_box([0.1, 0.1, 0.05])
    lid = faces[(vertices[faces][:, :, 2] > 0).all(axis=1)]
    shape = physx.PhysxCollisionShapeTriangleMesh(
        vertices.astype(np.float32), lid.astype(np.uint32), np.ones(3), make_material()
    )
    assert convert_shape(shape).mesh.is_sheet
    add_static(scene, shape, ([0, 0, 0.2], [1, 0, 0, 0]))
    assert land(scene, [(0.02, 0.03)]) == pytest.approx(0.25 + REST, abs=1e-4)


def test_a_moving_mesh_is_followed(meshes):
    """A kinematic body of a triangle mesh carries what lies on it."""
    scene = make_scene()
    vertices, faces = meshes.make_box([0.1, 0.1, 0.01])
    component = physx.PhysxRigidDynamicComponent()
    component.attach(
        physx.PhysxCollisionShapeTriangleMesh(
            vertices.astype(np.float32), faces.astype(np.uint32), np.ones(3), make_material()
        )
    )
    component.kinematic = True
    entity = sapien.Entity()
    entity.add_component(component)
    entity.set_pose(sapien.Pose([0, 0, 0.1]))
    scene.add_entity(entity)
    cloth = SapienCloth([scene])
    cloth.add_garment(np.add(TRIANGLE, [0, 0, 0.11 + REST]), FACE)
    cloth.build()
    for k in range(60):
        entity.set_pose(sapien.Pose([0.1 * k / 60, 0, 0.1 + 0.1 * k / 60]))
        cloth.step()
    x = cloth.state.get_positions()[0].mean(axis=0)
    assert x == pytest.approx([0.1 * 59 / 60, 0, 0.1 + 0.1 * 59 / 60 + 0.01 + REST], abs=2e-3)


def test_equal_meshes_share_a_grid(meshes):
    points = meshes.make_box([0.03, 0.03, 0.03])[0].astype(np.float32)
    first, second = (
        convert_shape(physx.PhysxCollisionShapeConvexMesh(points, np.ones(3), make_material()))
        for _ in range(2)
    )
    assert first.mesh is second.mesh


def test_an_unsupported_shape_names_its_body():
    """SAPIEN has no other kinds today; what it may get is refused."""
    cone = SimpleNamespace(local_pose=sapien.Pose(), physical_material=make_material())
    body = SimpleNamespace(name="thing", collision_shapes=[cone])
    with pytest.raises(
        UnsupportedShapeError, match=r"body 'thing': cloth collides with .* got SimpleNamespace"
    ):
        SapienCloth([make_scene()], colliders=[[body]])


def test_a_mesh_that_cannot_be_collided_with_names_its_body(monkeypatch):
    def refuse(*_, **__):
        raise MeshError("no")

    scene = make_scene()
    add_static(
        scene, physx.PhysxCollisionShapeSphere(0.1, make_material()), ([0] * 3, [1, 0, 0, 0])
    )
    monkeypatch.setattr(sapien_bridge, "convert_shape", refuse)
    with pytest.raises(MeshError, match="body 'thing': no"):
        SapienCloth([scene])


def test_scenes_must_agree():
    first, second = make_scene(), make_scene()
    for scene, name in ((first, "table"), (second, "chair")):
        builder = scene.create_actor_builder()
        builder.add_sphere_collision(radius=0.1)
        builder.build_static(name=name)
    with pytest.raises(ValueError, match="same colliders in the same order"):
        SapienCloth([first, second])


def test_friction_comes_from_the_body_or_the_caller():
    scene = make_scene()
    scene.add_ground(0.0, render=False, material=physx.PhysxMaterial(0.25, 0.25, 0.0))
    for choose, expected in ((None, 0.25), (lambda _: 0.7, 0.7), (lambda _: None, 0.25)):
        cloth = SapienCloth([scene], friction=choose)
        cloth.add_garment(TRIANGLE, FACE)
        cloth.build()
        assert cloth.model.shapes.friction.numpy()[0] == pytest.approx(expected)


def test_environments_have_their_own_bodies():
    scenes = [make_scene() for _ in range(2)]
    for k, scene in enumerate(scenes):
        builder = scene.create_actor_builder()
        builder.add_box_collision(half_size=[0.1, 0.1, 0.01])
        builder.build_kinematic(name="table").set_pose(sapien.Pose([0, 0, 0.1 * k]))
    cloth = SapienCloth(scenes, config=SolverConfig(substeps=5))
    cloth.add_garment(np.add(TRIANGLE, [0, 0, 0.2]), FACE)
    cloth.build()
    for _ in range(60):
        cloth.step()
    height = cloth.state.get_positions()[:, :, 2].mean(axis=1)
    assert height == pytest.approx([0.01 + REST, 0.11 + REST], abs=1e-4)


def test_strain_is_measured_for_one_environment(sheet):
    scene = make_scene()
    cloth = SapienCloth([scene])
    vertices, faces = sheet(0.05, 0.05, 0.0125)
    cloth.add_garment(vertices * [1.1, 1.1, 1.0], faces, rest=vertices[:, :2])
    cloth.build()
    assert cloth.measure_strain(0) == pytest.approx(0.1, abs=1e-5)


def test_colliders_are_found_in_order():
    scene = make_scene()
    for name in ("a", "b", "c"):
        builder = scene.create_actor_builder()
        if name != "b":
            builder.add_sphere_collision(radius=0.1)
        builder.build_kinematic(name=name)
    assert [c.entity.name for c in find_colliders(scene)] == ["a", "c"]


def test_normals_are_unit_and_follow_the_winding(sheet):
    vertices, faces = sheet(0.05, 0.05, 0.0125)
    assert compute_vertex_normals(vertices, faces) == pytest.approx(
        np.tile([0, 0, 1], (len(vertices), 1))
    )
    assert compute_vertex_normals(vertices, faces[:, ::-1])[:, 2] == pytest.approx(-1)
