"""A state is complete: restoring, masked resets, batches, devices."""

import numpy as np
import pytest
import warp as wp

from dgl_physics import ClothMaterial, ModelBuilder, Shape, SolverXPBD

BALL = Shape(kind="sphere", size=(0.06, 0, 0))


def drape_builder(sheet, sizes):
    """Sheets of different sizes over a ball and the ground, one environment a size."""
    builder = ModelBuilder(len(sizes))
    for env, size in enumerate(sizes):
        vertices, faces = sheet(size, size, 0.0125, height=0.09)
        builder.add_garment(vertices, faces, env=env)
    builder.add_shape(BALL)
    builder.add_ground()
    return builder


def heap_builder(sheet, sizes):
    """Sheets that fall on their edge and crumple, one environment a size."""
    builder = ModelBuilder(len(sizes))
    for env, size in enumerate(sizes):
        vertices, faces = sheet(size, size, 0.0125)
        vertices = vertices[:, [0, 2, 1]] + [0, 0, size / 2 + 0.01]
        vertices[:, 1] = 0.01 * np.sin(30 * vertices[:, 2])
        builder.add_garment(vertices, faces, env=env)
    builder.add_ground()
    return builder


def assert_same(found, expected, device):
    """To the bit on the CPU. On CUDA particles in a heap add up in any order: 4e-8 m were seen."""
    tolerance = 0.0 if device == "cpu" else 1e-6
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=tolerance)


def test_two_runs_are_the_same(run, sheet, device):
    first, second = (
        run(drape_builder(sheet, (0.15, 0.2)), device=device).step(60) for _ in range(2)
    )
    np.testing.assert_array_equal(first.x, second.x)
    np.testing.assert_array_equal(first.v, second.v)


@pytest.mark.parametrize("make", [drape_builder, heap_builder])
def test_a_restored_state_goes_on_alike(run, sheet, device, make):
    r = run(make(sheet, (0.2,)), device=device).step(30)
    snapshot = r.state.get_positions(), r.state.get_velocities(), r.state.get_is_stuck()
    memory = r.state.get_memory()
    expected = r.step(30).x
    r.state.set_particles(*snapshot)
    r.state.set_memory(memory)
    assert_same(r.step(30).x, expected, device)


@pytest.mark.parametrize("make", [drape_builder, heap_builder])
def test_particles_set_without_memory_go_on_almost_alike(run, sheet, device, make):
    """Setting particles resets the damping of one substep, whatever came before."""
    r = run(make(sheet, (0.2,)), device=device).step(30)
    snapshot = r.state.get_positions(), r.state.get_velocities(), r.state.get_is_stuck()
    expected = r.step(5).x
    ends = []
    for _ in range(2):
        r.step(7).state.set_particles(*snapshot)
        ends.append(r.step(5).x)
    assert_same(*ends, device)
    assert 0 < np.abs(ends[0] - expected).max() < 1e-4
    with pytest.raises(ValueError, match=r"memory must have shape \(\d+,\); got \(3,\)"):
        r.state.set_memory(np.zeros(3))


@pytest.mark.parametrize("make", [drape_builder, heap_builder])
def test_another_solver_goes_on_alike(run, sheet, device, make):
    """The solver itself remembers nothing that matters."""
    r = run(make(sheet, (0.2,)), device=device).step(30)
    other = run(make(sheet, (0.2,)), device=device)
    other.state.set_particles(
        r.state.get_positions(), r.state.get_velocities(), r.state.get_is_stuck()
    )
    other.state.set_memory(r.state.get_memory())
    assert_same(other.step(30).x, r.step(30).x, device)


@pytest.mark.parametrize("make", [drape_builder, heap_builder])
def test_a_batch_equals_its_environments_alone(run, sheet, device, make):
    """Padding and neighbours in the batch change nothing."""
    sizes = (0.2, 0.1, 0.15)
    batch = run(make(sheet, sizes), device=device).step(60)
    together = batch.state.get_positions()
    for env, size in enumerate(sizes):
        alone = run(make(sheet, (size,)), device=device).step(60).state.get_positions()[0]
        assert_same(together[env, : len(alone)], alone, device)


def test_setting_particles_touches_only_the_given_environments(run, sheet):
    sizes = (0.2, 0.1, 0.15)
    r = run(drape_builder(sheet, sizes)).step(20)
    before = r.state.get_positions(), r.state.get_velocities()
    r.state.set_particles(r.model.initial_positions[[1]], envs=np.array([1]))
    after = r.state.get_positions(), r.state.get_velocities()
    for old, new in zip(before, after, strict=True):
        np.testing.assert_array_equal(old[[0, 2]], new[[0, 2]])
    np.testing.assert_array_equal(after[0][1], r.model.initial_positions[1])
    assert np.abs(after[1][1]).max() == 0.0


def test_resetting_an_environment_leaves_the_others_future_alone(run, sheet):
    sizes = (0.2, 0.1)
    r, undisturbed = (run(drape_builder(sheet, sizes)).step(20) for _ in range(2))
    r.state.set_particles(r.model.initial_positions[[1]], envs=np.array([1]))
    r.step(20)
    np.testing.assert_array_equal(
        r.state.get_positions()[0], undisturbed.step(20).state.get_positions()[0]
    )


@pytest.mark.parametrize(
    ("positions", "velocities", "message"),
    [
        (np.zeros((1, 3, 3)), None, r"positions must have shape \(1, 4, 3\); got \(1, 3, 3\)"),
        (np.zeros((1, 4, 3)), np.zeros((4, 3)), r"velocities must have shape"),
        (np.full((1, 4, 3), np.nan), None, "positions must be finite"),
        (np.zeros((1, 4, 3)), np.full((1, 4, 3), np.inf), "velocities must be finite"),
    ],
)
def test_bad_particles_are_refused(run, builder, sheet, positions, velocities, message):
    builder.add_garment(*sheet(0.01, 0.01, 0.0125))
    r = run(builder)
    before = r.x
    with pytest.raises(ValueError, match=message):
        r.state.set_particles(positions, velocities)
    np.testing.assert_array_equal(r.x, before)


def test_body_poses_of_a_wrong_shape_are_refused(run, builder, sheet):
    builder.add_garment(*sheet(0.05, 0.05, 0.0125))
    builder.add_body("hand")
    with pytest.raises(ValueError, match=r"poses must have shape \(1, 2, 7\); got \(1, 1, 7\)"):
        run(builder).state.set_body_poses(np.zeros((1, 1, 7)))


def test_a_jump_of_a_body_gives_no_velocity(run, sheet):
    """A tray that jumps sideways under lying cloth leaves it where it is; a moving one drags it."""

    def drag(is_jump):
        builder = ModelBuilder(1)
        vertices, faces = sheet(0.05, 0.05, 0.0125, height=0.004)
        builder.add_garment(vertices, faces, material=ClothMaterial(adhesion=0.0))
        tray = builder.add_body("tray")
        pose = np.array([0, 0, -0.01, 1, 0, 0, 0])
        builder.add_shape(Shape(kind="box", size=(0.5, 0.5, 0.01), pose=pose), body=tray)
        r = run(builder)
        r.move([[0, 0, 0, 1, 0, 0, 0]], is_jump=True)
        r.step(2)
        r.move([[0.01, 0, 0, 1, 0, 0, 0]], is_jump=is_jump)
        return np.abs((r.step().x - vertices)[:, 0]).max()

    assert drag(is_jump=True) < 1e-5
    assert drag(is_jump=False) > 1e-4


def test_a_replayed_graph_equals_eager_launches(run, sheet, device):
    """A new solver launches its first frame eagerly; an old one replays what it recorded."""
    replayed = run(drape_builder(sheet, (0.2,)), device=device).step(30)
    eager = run(drape_builder(sheet, (0.2,)), device=device)
    for _ in range(30):
        SolverXPBD(eager.model, eager.solver.config).step(eager.state)
    np.testing.assert_array_equal(replayed.x, eager.x)


@pytest.mark.gpu
def test_cpu_and_cuda_agree(run, sheet):
    """After 60 frames of a drape the shapes are within half a millimetre on average."""
    if not wp.is_cuda_available():
        pytest.skip("no CUDA device")
    cpu, cuda = (run(drape_builder(sheet, (0.2,)), device=d).step(60).x for d in ("cpu", "cuda:0"))
    assert np.linalg.norm(cpu - cuda, axis=1).mean() < 5e-4


def test_held_particles_stay_and_the_rest_hang_from_them(run, sheet, device):
    vertices, faces = sheet(0.1, 0.1, 0.0125, height=0.5)
    builder = ModelBuilder(2)
    for env in range(2):
        builder.add_garment(vertices, faces, env=env)
    scene = run(builder, device=device)
    edge = np.flatnonzero(vertices[:, 1] > vertices[:, 1].max() - 1e-6)
    none = np.empty((0, 3))
    for frame in range(60):
        places = vertices[edge] + [0, 0, 0.001 * frame]
        scene.state.hold(edge, places, np.zeros_like(places), env=1)
        scene.step()
    free, held = scene.state.get_positions()
    np.testing.assert_allclose(held[edge], places, atol=1e-6)
    assert held[:, 2].min() > places[0, 2] - 0.13
    assert free[:, 2].max() < 0.5 - 4  # has fallen for a second
    scene.state.hold(np.empty(0, dtype=int), none, none, env=1)
    scene.step(30)
    assert scene.state.get_positions()[1][edge, 2].max() < places[0, 2] - 0.5


def test_what_cannot_be_held_is_refused(run, sheet, unrefused):
    builder = ModelBuilder(1)
    builder.add_garment(*sheet(0.05, 0.05, 0.0125))
    hold = run(builder).state.hold
    count, place = builder.build("cpu").particles_per_env, np.zeros((1, 3))
    rows = [
        (lambda: hold([count], place, place), f"particles must be in .0, {count}"),
        (lambda: hold([-1], place, place), "particles must be in"),
        (lambda: hold([0], place, place, env=1), "env must be in .0, 1.; got 1"),
        (lambda: hold([0], np.zeros((2, 3)), place), "positions must be finite, of shape"),
        (lambda: hold([0], place, place * np.nan), "velocities must be finite"),
    ]
    assert unrefused(rows) == []
