"""Cloth alone: what mechanics says about it."""

import numpy as np
import pytest

from dgl_physics import ClothMaterial, ModelBuilder, SolverConfig

G = 9.81
SMOOTH = ClothMaterial(drag=0.0, adhesion=0.0)


def test_free_fall_follows_the_parabola(sheet, run, device):
    builder = ModelBuilder(1)
    builder.add_garment(*sheet(0.1, 0.1, 0.0125), material=SMOOTH)
    r = run(builder, device=device).step(30)
    t, h = 30 / 60, 1 / 60 / SolverConfig().substeps
    # symplectic Euler is below the parabola by g t h / 2; the rest is single precision's
    assert r.x[:, 2] == pytest.approx(-G * t * (t + h) / 2, rel=1e-3)
    assert r.v[:, 2] == pytest.approx(-G * t, rel=1e-3)
    assert np.abs(r.strain()).max() < 1e-3


@pytest.mark.parametrize("substeps", [SolverConfig().substeps, 48])
def test_gravity_is_right_far_from_the_origin(sheet, run, device, substeps):
    """Velocities are not differences of positions, whose rounding at 10 m is g dt^2 / 20."""
    builder = ModelBuilder(1)
    builder.add_garment(*sheet(0.1, 0.1, 0.0125, height=10.0), material=SMOOTH)
    r = run(builder, device=device, substeps=substeps).step(30)
    t, h = 30 / 60, 1 / 60 / substeps
    assert 10.0 - r.x[:, 2] == pytest.approx(G * t * (t + h) / 2, rel=5e-3)
    assert r.v[:, 2] == pytest.approx(-G * t, rel=5e-3)


def test_drag_gives_terminal_velocity(sheet, run, builder):
    builder.add_garment(*sheet(0.05, 0.05, 0.0125), material=ClothMaterial(drag=5.0))
    r = run(builder).step(120)
    assert r.v[:, 2] == pytest.approx(-G / 5.0, rel=0.02)


def test_a_pendulum_has_its_period(run, builder):
    """A stiff strip of a few particles on two pins; the first quarter swing against theory."""
    length, tip = 0.5, 1e-3
    vertices = np.array([[0, -tip, 0], [0, tip, 0], [length, 0, 0]], dtype=float)
    angle = np.radians(5)
    vertices[2] = [length * np.sin(angle), 0, -length * np.cos(angle)]
    builder.add_garment(vertices, np.array([[0, 1, 2]]), material=SMOOTH, pinned=(0, 1))
    r = run(builder)
    x = [r.step().x[2, 0] for _ in range(200)]
    crossings = np.flatnonzero(np.diff(np.sign(x)))
    assert len(crossings) >= 3
    k = crossings[[0, 2]]
    exact = k + np.take(x, k) / (np.take(x, k) - np.take(x, k + 1))
    period = np.diff(exact)[0] / 60
    assert period == pytest.approx(2 * np.pi * np.sqrt(length / G) * (1 + angle**2 / 16), rel=0.01)


def test_free_cloth_keeps_its_momentum(sheet, run, builder, device):
    """With no force from outside, linear and angular momentum stay while the sheet flaps."""
    vertices, faces = sheet(0.2, 0.2, 0.0125)
    builder.add_garment(vertices, faces, material=SMOOTH)
    r = run(builder, device=device, gravity=(0, 0, 0))
    velocities = np.random.default_rng(0).normal(0, 0.3, vertices.shape)
    velocities += np.add(np.cross([0.0, 0.0, 2.0], vertices), [0.1, -0.2, 0.3])
    r.state.set_particles(vertices[None], velocities[None])
    m = r.mass[:, None]
    linear, angular = (m * r.v).sum(axis=0), (m * np.cross(r.x, r.v)).sum(axis=0)
    r.step(30)
    scale = np.linalg.norm(linear)
    assert (m * r.v).sum(axis=0) == pytest.approx(linear, abs=2e-3 * scale)
    after = (m * np.cross(r.x, r.v)).sum(axis=0)
    assert after == pytest.approx(angular, abs=0.01 * np.linalg.norm(angular))


def test_energy_does_not_grow(sheet, run, builder):
    vertices, faces = sheet(0.2, 0.2, 0.0125)
    builder.add_garment(vertices, faces, material=SMOOTH)
    r = run(builder, gravity=(0, 0, 0))
    r.state.set_particles(
        vertices[None], np.random.default_rng(0).normal(0, 0.5, (1, *vertices.shape))
    )
    energy = [0.5 * (r.mass[:, None] * r.v**2).sum()]
    for _ in range(20):
        energy.append(0.5 * (r.step(3).mass[:, None] * r.v**2).sum())
    assert max(energy[1:]) < energy[0]


def test_rest_stays_at_rest(sheet, run, device):
    """A flat sheet on the ground has nowhere to go: not in place, not in velocity."""
    builder = ModelBuilder(1)
    vertices, faces = sheet(0.2, 0.2, 0.0125, height=0.004)
    builder.add_garment(vertices, faces)
    builder.add_ground()
    r = run(builder, device=device).step(120)
    assert np.abs(r.x - vertices).max() < 2e-5
    assert np.abs(r.v).max() < 1e-3


def test_pins_hold_exactly(sheet, run, builder):
    vertices, faces = sheet(0.1, 0.1, 0.0125, height=1.0)
    builder.add_garment(vertices, faces, pinned=(0, 8))
    r = run(builder).step(30)
    np.testing.assert_array_equal(r.x[[0, 8]], vertices[[0, 8]].astype(np.float32))
    assert r.x[:, 2].min() < 0.95


def hang(run, sheet, *, substeps, is_row=False, frames=240, **material):
    vertices, faces = sheet(0.6, 0.7, 0.0125)
    vertices = np.column_stack([vertices[:, 0], vertices[:, 2], vertices[:, 1]])
    vertices[:, 1] = 1e-3 * np.sin(20 * vertices[:, 0])  # not a perfect plane
    top = np.flatnonzero(vertices[:, 2] > vertices[:, 2].max() - 1e-6)
    builder = ModelBuilder(1)
    pins = tuple(top) if is_row else (top[0], top[-1])
    builder.add_garment(vertices, faces, pinned=pins, material=ClothMaterial(drag=2.0, **material))
    r = run(builder, substeps=substeps).step(frames)
    return np.abs(r.strain())


def test_strain_of_a_hanging_panel_falls_with_substeps(sheet, run):
    """The residual strain goes with the square of the substep: a quarter, at most 0.4."""
    coarse, fine = (hang(run, sheet, substeps=n, is_row=True, frames=150).mean() for n in (20, 40))
    assert fine < 0.4 * coarse
    assert fine < 0.01


def test_a_panel_hung_by_two_corners_hardly_stretches(sheet, run):
    strain = hang(run, sheet, substeps=SolverConfig().substeps)
    assert strain.mean() <= 0.01
    assert np.percentile(strain, 99.9) <= 0.04


def test_elastic_strain_follows_the_stiffness(run, builder):
    """Where the solver converges, stretch is Hooke's: weight over the stiffness of two edges."""
    side, k = 0.1, 20.0
    vertices = np.array([[0, 0, 0], [side, 0, 0], [side / 2, 0, -side * np.sqrt(0.75)]])
    material = ClothMaterial(stretch_stiffness=k, drag=5.0, area_density=10.0)
    builder.add_garment(vertices, np.array([[0, 1, 2]]), pinned=(0, 1), material=material)
    r = run(builder, substeps=20).step(600)
    force = r.mass[2] * G / 2 / np.sqrt(0.75)  # along each of the two edges, for small angles
    assert np.abs(r.v).max() < 1e-3
    assert r.strain().max() == pytest.approx(force / k / side, rel=0.1)


def test_bending_stiffness_holds_a_cantilever(sheet, run):
    drop = []
    for stiffness in (0.0, 0.3, 30.0):
        builder = ModelBuilder(1)
        vertices, faces = sheet(0.1, 0.05, 0.0125)
        pinned = tuple(np.flatnonzero(vertices[:, 0] < -0.03))
        material = ClothMaterial(bend_stiffness=stiffness, drag=5.0)
        builder.add_garment(vertices, faces, pinned=pinned, material=material)
        drop.append(-run(builder).step(180).x[:, 2].min())
    assert drop[0] > drop[1] > drop[2]


def test_gravity_scale_acts_on_its_environment(sheet, run):
    builder = ModelBuilder(3)
    builder.add_garment(*sheet(0.05, 0.05, 0.0125), material=SMOOTH)
    r = run(builder)
    r.state.set_gravity_scale(np.array([0.0, 1.0, 10.0]))
    r.step(6)
    fall = -r.state.get_positions()[:, :, 2].mean(axis=1)
    assert fall[0] == pytest.approx(0.0, abs=1e-7)
    assert fall[2] / fall[1] == pytest.approx(10.0, rel=2e-3)
