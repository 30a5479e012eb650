"""Cloth on hulls and meshes behaves as on primitives; near shapes are found, and only those."""

import functools

import numpy as np
import pytest

from dgl_physics import (
    ClothMaterial,
    CollisionMesh,
    ModelBuilder,
    Shape,
    SimulationDivergedError,
)

G = 9.81
EDGE = 0.0125
REST = ClothMaterial().rest_offset
LYING = np.array([0, 0, 0, np.sqrt(0.5), 0, np.sqrt(0.5), 0])  # z becomes x


def solid(mesh, **settings):
    return CollisionMesh(vertices=mesh[0], faces=mesh[1], **settings)


@functools.cache
def make_slab(meshes, kind, half=(0.3, 0.3, 0.02)):
    """A slab below z = 0 of any kind; made once, as the grid of a mesh takes half a second."""
    pose = np.array([0, 0, -half[2], 1, 0, 0, 0])
    if kind == "box":
        return Shape(kind="box", size=half, pose=pose)
    vertices, faces = meshes.make_box(np.array(half))
    mesh = CollisionMesh.hull(vertices) if kind == "convex" else solid((vertices, faces))
    return Shape(kind=kind, mesh=mesh, pose=pose)


@pytest.mark.parametrize("kind", ["convex", "mesh"])
def test_cloth_rests_as_on_a_box(run, sheet, meshes, device, kind):
    """Dropped over an edge of it: what lies on top lies as high, what hangs hangs as far out."""
    half = (0.06, 0.1, 0.03)
    ends = []
    for k in ("box", kind):
        builder = ModelBuilder()
        builder.add_garment(*sheet(0.16, 0.1, EDGE, height=0.012), material=ClothMaterial(drag=3.0))
        builder.add_shape(make_slab(meshes, k, half))
        ends.append(run(builder, device=device).step(120).x)
    on_top = (np.abs(ends[0][:, 0]) < 0.03) & (np.abs(ends[0][:, 1]) < 0.09)
    assert on_top.sum() > 30
    for x in ends:
        assert x[on_top, 2] == pytest.approx(REST, abs=2e-5)
    difference = np.linalg.norm(ends[0] - ends[1], axis=1)
    assert difference.mean() < 1e-3
    assert difference.max() < 5e-3
    assert ends[0][:, 2].min() < -0.01  # it does hang over


def slide(run, sheet, meshes, tangent, frames, device):
    angle = np.arctan(tangent)
    builder = ModelBuilder()
    vertices, faces = sheet(0.08, 0.08, EDGE, height=REST)
    builder.add_garment(vertices, faces, material=ClothMaterial(adhesion=0.0, drag=0.0))
    builder.add_shape(make_slab(meshes, "mesh"))
    gravity = (float(G * np.sin(angle)), 0.0, float(-G * np.cos(angle)))
    r = run(builder, device=device, gravity=gravity).step(frames)
    return (r.x - vertices)[:, 0], r.v[:, 0]


def test_a_mesh_holds_below_the_friction_angle(run, sheet, meshes, device):
    moved, _ = slide(run, sheet, meshes, 0.8, 120, device)
    assert np.abs(moved).max() < 1e-5


def test_a_mesh_lets_slide_above_the_friction_angle(run, sheet, meshes, device):
    moved, speed = slide(run, sheet, meshes, 1.2, 30, device)
    angle = np.arctan(1.2)
    acceleration = G * (np.sin(angle) - np.cos(angle))
    assert speed == pytest.approx(0.5 * acceleration, rel=0.1)
    assert moved == pytest.approx(0.5 * acceleration * 0.25, rel=0.1)


def test_cloth_does_not_creep_on_a_round_mesh(run, sheet, meshes):
    """Sticking is exact with interpolated normals too."""
    builder = ModelBuilder()
    builder.add_garment(*sheet(0.06, 0.06, EDGE, height=0.006), material=ClothMaterial(drag=3.0))
    pose = np.array([0, 0, -0.1, 1, 0, 0, 0])
    builder.add_shape(Shape(kind="mesh", mesh=solid(meshes.make_sphere(0.1)), pose=pose))
    r = run(builder).step(120)
    before = r.x
    r.step(60)
    assert np.linalg.norm(r.x - before, axis=1).max() < 1e-4
    gap = np.linalg.norm(r.x - pose[:3], axis=1) - 0.1
    assert gap.min() > REST - 2e-4


def test_impulses_on_a_mesh_balance_the_weight(run, sheet, meshes, device):
    builder = ModelBuilder()
    builder.add_garment(*sheet(0.1, 0.1, EDGE, height=0.02), material=ClothMaterial(drag=0.0))
    builder.add_shape(make_slab(meshes, "mesh"))
    r = run(builder, device=device)
    total = np.zeros(3)
    for _ in range(60):
        r.step()
        total += r.state.impulse.numpy()[0, 0, :3]
    weight = r.mass.sum() * G
    momentum = (r.mass[:, None] * r.v).sum(axis=0)
    expected = np.array([0, 0, -weight]) - momentum
    assert total == pytest.approx(expected, abs=0.01 * weight)


@pytest.mark.parametrize("kind", ["bar", "wedge", "cylinder"])
def test_nothing_tunnels_at_the_speed_of_hands(run, sheet, meshes, device, kind):
    """A bar of a hanger, a hull and a cylinder at 1 m/s into a hanging sheet carry it along."""
    vertices, faces = sheet(0.3, 0.3, EDGE)
    vertices = vertices[:, [0, 2, 1]]
    top = np.flatnonzero(vertices[:, 2] > vertices[:, 2].max() - 1e-6)
    builder = ModelBuilder()
    # little friction: a sheet that is pinned and sticks to the bar would have to stretch by a tenth
    material = ClothMaterial(friction=0.3)
    builder.add_garment(vertices, faces, pinned=tuple(top), material=material)
    hand = builder.add_body("hand")
    if kind == "wedge":
        front = 0.02
        block = meshes.make_box([0.2, 0.02, 0.02])[0]
        builder.add_shape(Shape(kind="convex", mesh=CollisionMesh.hull(block)), body=hand)
        outside = lambda x: meshes.box_distance(x, [0.2, 0.02, 0.02])  # noqa: E731
    else:
        front = 0.005 if kind == "bar" else 0.02
        if kind == "bar":
            mesh = solid(meshes.make_cylinder(front, 0.2))
            builder.add_shape(Shape(kind="mesh", mesh=mesh, pose=LYING), body=hand)
        else:
            shape = Shape(kind="cylinder", size=(front, 0.2, 0), pose=LYING)
            builder.add_shape(shape, body=hand)
        outside = lambda x: np.hypot(x[:, 1], x[:, 2]) - front  # noqa: E731
    r = run(builder, device=device)
    lowest = np.inf
    for k in range(13):
        y = -0.1 + k / 60
        r.move([[0, y, 0, 1, 0, 0, 0]], is_jump=k == 0)
        r.step()
        lowest = min(lowest, outside(r.x - [0, y, 0]).min())
        if y > -front:
            near = np.abs(r.x[:, 2]) < 0.006
            assert near.any()
            assert (r.x[near, 1] > y).all()
    assert lowest > REST - 4e-4


def test_particles_inside_leave_by_the_shortest_way(run, meshes):
    """Small triangles just under each face of a block leave it through that face."""
    half = np.array([0.05, 0.06, 0.07])
    triangle = np.array([[-2, -1, 0], [2, -1, 0], [0, 2, 0]]) * 1e-3
    builder = ModelBuilder()
    places = np.concatenate([np.diag(half - 0.008), -np.diag(half - 0.008)])
    for place in places:
        builder.add_garment(triangle + place, np.array([[0, 1, 2]]))
    builder.add_shape(Shape(kind="mesh", mesh=solid(meshes.make_box(half))))
    r = run(builder, gravity=(0.0, 0.0, 0.0)).step(2)
    ends = r.x.reshape(-1, 3, 3).mean(axis=1)
    expected = places + np.sign(places) * (0.008 + REST)
    assert ends == pytest.approx(expected, abs=3e-3)  # they leave it with the separation speed


def test_a_batch_is_its_environments(run, sheet, meshes):
    """Bodies at other places in each; equal to the bit."""
    mesh = solid(meshes.make_torus(0.05, 0.02, rings=48))
    poses = np.array([[0.0, 0, 0, 1, 0, 0, 0], [0.02, 0.01, 0.01, 0.9, 0.1, 0.3, 0.2]])
    poses[:, 3:] /= np.linalg.norm(poses[:, 3:], axis=1, keepdims=True)

    def simulate(envs):
        builder = ModelBuilder(len(envs))
        builder.add_garment(*sheet(0.12, 0.12, EDGE, height=0.05))
        body = builder.add_body("ring")
        builder.add_shape(Shape(kind="mesh", mesh=mesh), body=body)
        r = run(builder)
        world = np.array([0, 0, 0, 1, 0, 0, 0])
        all_poses = np.array([[world, poses[e]] for e in envs], dtype=np.float32)
        r.state.set_body_poses(all_poses, is_jump=True)
        return r.step(30).state.get_positions()

    together = simulate([0, 1])
    for e in range(2):
        np.testing.assert_array_equal(together[e], simulate([e])[0])
    assert np.abs(together[0] - together[1]).max() > 5e-3


def test_shapes_share_the_grid_of_one_mesh(meshes, sheet):
    mesh = solid(meshes.make_box([0.05, 0.05, 0.05]))
    builder = ModelBuilder()
    builder.add_garment(*sheet(0.05, 0.05, EDGE))
    for _ in range(3):
        builder.add_shape(Shape(kind="mesh", mesh=mesh))
    model = builder.build()
    assert len(model.grids) == 1
    assert model.shapes.grid.numpy().tolist() == [0, 0, 0]


def count_near(solver):
    return solver._near.near_count.numpy()


def test_only_particles_near_a_large_body_are_looked_up(run, sheet, meshes):
    """A body of 1.7 m in whose sphere all cloth is: near is what is within millimetres."""
    for shape in (
        Shape(kind="mesh", mesh=solid(meshes.make_box([0.2, 0.15, 0.85]), max_nodes=300_000)),
        Shape(kind="box", size=(0.2, 0.15, 0.85)),
    ):
        builder = ModelBuilder()
        vertices, faces = sheet(0.3, 0.3, EDGE)
        builder.add_garment(vertices[:, [2, 0, 1]] + [0.25, 0, 0], faces)  # 5 cm off its side
        builder.add_garment(np.add(vertices, [0, 0, 0.85 + REST]), faces)
        builder.add_shape(shape)
        r = run(builder, gravity=(0.0, 0.0, 0.0))
        assert shape.bounding_radius() > 0.8
        near = count_near(r.step().solver)
        assert (near[: len(vertices)] == 0).all()
        assert (near[len(vertices) :] == 1).all()


def test_a_floor_that_rises_is_met(run, sheet):
    """A plane 5 cm below at the start of the frame, and above the cloth at its end."""
    builder = ModelBuilder()
    builder.add_garment(*sheet(0.08, 0.08, EDGE, height=0.05))
    builder.add_shape(Shape(kind="plane"), body=builder.add_body("floor"))
    r = run(builder, gravity=(0.0, 0.0, 0.0))
    for z in (0.0, 0.08):
        r.move([[0, 0, z, 1, 0, 0, 0]], is_jump=z == 0)
        r.step()
    assert r.x[:, 2].min() > 0.08 + REST - 1e-4


@pytest.mark.parametrize("kind", ["capsule", "mesh"])
def test_a_bar_that_swings_is_met(run, sheet, meshes, kind):
    """A bar at the end of an arm that turns by 90 degrees in a frame meets cloth that is far from
    where it starts, from where it is in the middle, and from where it ends."""
    builder = ModelBuilder()
    vertices, faces = sheet(0.05, 0.05, EDGE)
    angle = np.radians(15)
    builder.add_garment(np.add(vertices, [0.3 * np.cos(angle), 0.3 * np.sin(angle), 0]), faces)
    pose = np.array([0.3, 0, 0, 1, 0, 0, 0])
    if kind == "mesh":
        bar = Shape(kind="mesh", mesh=solid(meshes.make_cylinder(0.01, 0.1)), pose=pose)
    else:
        bar = Shape(kind="capsule", size=(0.01, 0.1, 0), pose=pose)
    builder.add_shape(bar, body=builder.add_body("arm"))
    r = run(builder, gravity=(0.0, 0.0, 0.0))
    r.move([[0, 0, 0, 1, 0, 0, 0]], is_jump=True)
    r.step()
    r.move([[0, 0, 0, np.sqrt(0.5), 0, 0, np.sqrt(0.5)]])
    r.step()
    assert count_near(r.solver).sum() > 10
    assert np.linalg.norm(r.v, axis=1).max() > 1.0


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 1e30])
def test_particles_astray_are_noticed_not_looked_up(run, sheet, meshes, bad):
    builder = ModelBuilder()
    builder.add_garment(*sheet(0.05, 0.05, EDGE))
    builder.add_shape(Shape(kind="mesh", mesh=solid(meshes.make_sphere(0.05))))
    r = run(builder).step()
    positions = r.state.positions.numpy()
    positions[3:6, 1] = bad
    r.state.positions.assign(positions)
    with pytest.raises(SimulationDivergedError):
        r.step()
