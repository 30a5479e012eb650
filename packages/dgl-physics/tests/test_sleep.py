"""Cloth that has come to rest sleeps, and wakes when it has to."""

import numpy as np
import pytest

from dgl_physics import ClothMaterial, ModelBuilder, Shape, SolidMaterial

BALL = Shape(kind="sphere", size=(0.02, 0, 0))
G = 9.81


def lie(run, sheet, device, *, height=0.004, **config):
    """A sheet on the ground, and a ball that is far above it."""
    builder = ModelBuilder(1)
    builder.add_garment(*sheet(0.15, 0.15, 0.0125, height=height))
    builder.add_ground()
    builder.add_shape(BALL, body=builder.add_body("ball"))
    r = run(builder, device=device, **config)
    put_ball(r, 1.0, is_jump=True)
    return r


def put_ball(r, height, *, is_jump=False):
    poses = np.zeros((1, 2, 7))
    poses[..., 3] = 1.0
    poses[0, 1, 2] = height
    r.state.set_body_poses(poses, is_jump=is_jump)


def test_it_sleeps_after_its_time_and_not_before(run, sheet, device):
    """In mid-air, without weight, drifting by 1 mm/s."""
    r = lie(run, sheet, device, height=0.5, gravity=(0, 0, 0), sleep_after=0.5)
    r.state.set_particles(r.x[None], np.full((1, len(r.x), 3), [0.001, 0, 0]))
    r.step(29)
    assert np.abs(r.v).max() > 0
    before = r.step(31).x
    assert np.abs(r.v).max() == 0
    np.testing.assert_array_equal(r.step(30).x, before)


def test_falling_cloth_does_not_sleep(run, sheet, device):
    r = lie(run, sheet, device, height=10.0, sleep_after=0.1)
    drag = ClothMaterial().drag
    assert r.step(60).v[:, 2] == pytest.approx(-G * (1 - np.exp(-drag)) / drag, rel=0.01)


@pytest.mark.parametrize(("distance", "sleeps"), [(0.02, True), (0.0005, False)])
def test_cloth_within_the_sleep_distance_sleeps(run, sheet, device, distance, sleeps):
    """Cloth that drifts by 10 mm/s is still within 20 mm and not within half a millimetre."""
    r = lie(run, sheet, device, height=0.5, gravity=(0, 0, 0), sleep_distance=distance)
    r.state.set_particles(r.x[None], np.full((1, len(r.x), 3), [0.01, 0, 0]))
    assert (np.abs(r.step(60).v).max() == 0) == sleeps


def test_a_solid_sleeps_on_while_another_environment_is_awake(run, device):
    """A loaded cube: its elastic forces would lift it if they went on while its weight does not."""
    grid = np.stack(np.meshgrid(*[[0.0, 0.0125]] * 3, indexing="ij"), -1).reshape(-1, 3)
    tets = np.array(
        [[0, 4, 6, 7], [0, 6, 2, 7], [0, 2, 3, 7], [0, 3, 1, 7], [0, 1, 5, 7], [0, 5, 4, 7]]
    )
    builder = ModelBuilder(2)
    material = SolidMaterial(youngs_modulus=1e4, damping=0.01)
    builder.add_tetrahedra(
        grid, tets, material=material, pinned=tuple(np.flatnonzero(grid[:, 2] > 0))
    )
    builder.add_shape(BALL, body=builder.add_body("ball"))
    r = run(builder, device=device)
    poses = np.zeros((2, 2, 7))
    poses[..., 3] = 1.0
    poses[:, 1, 0] = 1.0, 0.045  # Near in the second environment, whose cube stays awake for it.
    found = []
    for _ in range(4):
        for _ in range(30):
            r.state.set_body_poses(poses)
            r.step()
        found.append(r.state.get_positions())
    assert r.state.still.numpy()[1] == 0
    assert (found[-1][0, grid[:, 2] == 0, 2] < -1e-5).all()
    np.testing.assert_array_equal(found[-1][0], found[1][0])


def test_a_body_that_comes_near_wakes_it(run, sheet, device):
    r = lie(run, sheet, device)
    asleep = r.step(60).x
    for k in range(30):  # down to where the ball would be half in the cloth
        put_ball(r, 0.3 - 0.01 * k)
        r.step()
    assert r.x[:, 2].min() < asleep[:, 2].min() + 1e-6
    assert np.linalg.norm(r.x - asleep, axis=1).max() > 1e-3


def test_gravity_and_set_particles_wake_it(run, sheet, device):
    r = lie(run, sheet, device).step(60)
    r.state.set_gravity_scale(-1.0)
    assert r.step(30).x[:, 2].min() > 0.1
    r = lie(run, sheet, device).step(60)
    r.state.set_particles(r.x[None] + [0, 0, 0.2])
    assert r.step(5).v[:, 2].max() < -0.5


def test_a_sleeper_goes_on_weighing(run, sheet, device):
    r = lie(run, sheet, device).step(60)
    force = r.state.impulse.numpy()[0, :, 2].sum() * 60
    assert force == pytest.approx(-r.mass.sum() * G, rel=0.05)
