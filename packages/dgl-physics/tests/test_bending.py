"""Bending: energy, invariance, momentum, and Peirce's test."""

from itertools import pairwise

import numpy as np
import pytest
import warp as wp

from dgl_physics import ClothMaterial, ModelBuilder, topology
from dgl_physics._kernels.bending import solve_bending
from dgl_physics.bending import make_bending

B = 2.0e-5  # N m


def jitter(vertices, edge, seed=0):
    """Move the vertices within the plane by up to a fifth of an edge, for an uneven mesh."""
    noise = np.random.default_rng(seed).uniform(-0.2, 0.2, (len(vertices), 2)) * edge
    return vertices + np.column_stack([noise, np.zeros(len(vertices))])


def energy(block, x):
    """Energy of bending [J]."""
    c = np.einsum("hj,hja->ha", block.weights, x[block.vertices])
    return 0.5 * ((c**2).sum(axis=1) / block.compliance).sum()


def hinge_area(block, vertices):
    """A third of the triangles of all hinges [m^2], which is where bending costs energy."""
    e0, e1, w0, w1 = vertices[block.vertices].swapaxes(0, 1)
    return sum(np.linalg.norm(np.cross(e1 - e0, w - e0), axis=1).sum() / 6 for w in (w0, w1))


def bent(vertices, angle, curvature):
    """Roll a flat sheet to a cylinder around a direction in its plane, without stretch."""
    n = np.array([np.cos(angle), np.sin(angle)])
    s = vertices[:, :2] @ n
    x = vertices.copy()
    x[:, :2] += np.outer(np.sin(curvature * s) / curvature - s, n)
    x[:, 2] = (1 - np.cos(curvature * s)) / curvature
    return x


@pytest.mark.parametrize("angle", np.radians([0, 20, 45, 77, 90]))
@pytest.mark.parametrize("edge", [0.0125, 0.006])
def test_rolling_up_costs_the_energy_of_the_rigidity(sheet, edge, angle):
    """B k^2 / 2 per area, in all directions and for all sizes of triangles: 2 %."""
    vertices, faces = sheet(0.3, 0.3, edge)
    block = make_bending(vertices, faces, B)
    k = 5.0  # a radius of 0.2 m
    expected = 0.5 * B * k**2 * hinge_area(block, vertices)
    assert energy(block, bent(vertices, angle, k)) == pytest.approx(expected, rel=0.02)


def test_an_uneven_mesh_is_as_stiff(sheet):
    """Triangles moved by a fifth of an edge: within 6 % in each direction, 1 % in the mean."""
    vertices, faces = sheet(0.3, 0.3, 0.0125)
    vertices = jitter(vertices, 0.0125)
    block = make_bending(vertices, faces, B)
    k = 2.0
    expected = 0.5 * B * k**2 * hinge_area(block, vertices)
    measured = [energy(block, bent(vertices, a, k)) for a in np.linspace(0, np.pi, 12, False)]
    assert np.mean(measured) == pytest.approx(expected, rel=0.01)
    assert measured == pytest.approx([expected] * 12, rel=0.06)


def test_the_constraints_know_nothing_of_rigid_motion(sheet):
    """The weights sum to zero, and so do the weighted rest positions: no force, no moment."""
    vertices, faces = sheet(0.1, 0.1, 0.0125)
    vertices = jitter(vertices, 0.0125)
    block = make_bending(vertices, faces, B)
    np.testing.assert_allclose(block.weights.sum(axis=1), 0, atol=1e-12)
    rotation = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    moved = vertices @ rotation.T + [1, 2, 3]
    c = np.einsum("hj,hja->ha", block.weights, moved[block.vertices])
    np.testing.assert_allclose(c, 0, atol=1e-12)


def test_a_seam_that_is_folded_at_rest_turns_freely(sheet):
    """Two panels with the same flat coordinates joined at one side have no hinges there."""
    vertices, faces = sheet(0.05, 0.05, 0.0125)
    count = len(vertices)
    seam = vertices[:, 1] < vertices[:, 1].min() + 1e-9
    other = np.where(seam, np.arange(count), count + np.cumsum(~seam) - 1)
    rest = np.concatenate([vertices, vertices[~seam]])
    both = np.concatenate([faces, other[faces][:, ::-1]])
    hinges = make_bending(rest, both, B).vertices
    on_seam = seam[np.minimum(hinges[:, :2], count - 1)].all(axis=1)
    on_seam &= (hinges[:, :2] < count).all(axis=1)
    assert not on_seam.any()
    assert len(hinges) == 2 * len(topology.compute_hinges(faces))


def test_factors_stiffen_their_hinges_and_the_seams_between_them(sheet):
    vertices, faces = sheet(0.05, 0.05, 0.0125)
    high = vertices[:, 1] > vertices[:, 1].mean()
    plain = make_bending(vertices, faces, B)
    stiff = make_bending(vertices, faces, B, factors=np.where(high, 9.0, 1.0))
    both = high[plain.vertices[:, :2]].sum(axis=1)
    np.testing.assert_allclose(plain.compliance / stiff.compliance, np.array([1, 5, 9])[both])
    cut = np.array([[0.0, 0], [1, 0], [0, 1]])[:, [0, 1, 1]] * [0.01, 0.01, 0]
    folded, pair = np.vstack([cut, cut[2]]), np.array([[0, 1, 2], [1, 0, 3]])
    for factors, count in (([9, 9, 1, 1], 1), ([9, 1, 9, 9], 0), (None, 0)):
        factors = None if factors is None else np.array(factors, dtype=float)
        assert len(make_bending(folded, pair, B, factors=factors).vertices) == count


def test_a_stiff_band_opens_to_a_circle(builder, run):
    """Two strips that are sewn at their ends lie flat; stiffened, they become a ring."""
    count, edge = 10, 0.012
    along = np.arange(count + 1) * edge
    strip = np.array([[x, y, 0.0] for y in (0.0, edge, 2 * edge) for x in along])
    rows = np.arange(3 * (count + 1)).reshape(3, -1)
    ends = np.isin(np.arange(len(strip)), rows[:, [0, -1]])
    other = np.where(ends, np.arange(len(strip)), len(strip) + np.cumsum(~ends) - 1)
    quads = [
        (rows[i, j], rows[i, j + 1], rows[i + 1, j + 1], rows[i + 1, j])
        for i in range(2)
        for j in range(count)
    ]
    faces = np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])
    rest = np.concatenate([strip, strip[~ends]])
    both = np.concatenate([faces, other[faces][:, ::-1]])
    start = rest.copy()
    bulge = 0.004 * np.sin(np.pi * rest[:, 0] / along[-1])
    start[:, 2] += np.where(np.arange(len(rest)) < len(strip), bulge, -bulge)
    for factor, least, most in ((1.0, 0.0, 0.5), (1000.0, 0.8, 1.25)):
        b = builder.__class__()
        b.add_garment(start, both, rest=rest, stiffness=np.full(len(rest), factor))
        r = run(b, gravity=(0.0, 0.0, 0.0))
        r.step(240)
        x = r.x
        depth = np.ptp(x[:, 2])
        assert least < depth / np.ptp(x[:, 0]) < most


def test_a_band_that_shrinks_comes_to_rest_at_its_length(builder, run, sheet):
    vertices, faces = sheet(0.1, 0.05, 0.0125)
    shrinkage = np.full(len(vertices), 0.7)
    builder.add_garment(0.73 * vertices, faces, rest=vertices, shrinkage=shrinkage)
    r = run(builder, gravity=(0.0, 0.0, 0.0))
    r.step(240)
    assert np.ptp(r.x[:, 0]) == pytest.approx(0.7 * np.ptp(vertices[:, 0]), rel=0.01)
    for factors, message in (
        (np.ones(3), "shrinkage must have shape"),
        (np.zeros(len(vertices)), "shrinkage must be positive"),
    ):
        with pytest.raises(ValueError, match=message):
            builder.add_garment(vertices, faces, shrinkage=factors)


def test_nothing_bends_without_hinges_or_stiffness(sheet, builder, run):
    triangle = np.array([[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0]], dtype=float)
    assert len(make_bending(triangle, np.array([[0, 1, 2]]), B).vertices) == 0
    builder.add_garment(*sheet(0.1, 0.1, 0.0125), material=ClothMaterial(bending_stiffness=0.0))
    r = run(builder)
    assert r.model.bending.count == 0
    r.step()


def test_a_pass_keeps_both_momenta(sheet, device):
    """Of the hinges of each colour alone, on a crumpled sheet that moves, damping included."""
    vertices, faces = sheet(0.1, 0.1, 0.0125)
    rng = np.random.default_rng(3)
    builder = ModelBuilder(1)
    builder.add_garment(vertices, faces, material=ClothMaterial(bending_stiffness=1e-3))
    model = builder.build(device)
    x = vertices + rng.normal(0, 0.004, vertices.shape)
    mass = 1.0 / model.inverse_mass.numpy().astype(float)[:, None]
    block = model.bending
    before = rng.uniform(0, 0.01, block.count).astype(np.float32)
    for first, end in pairwise(block.colour_start):
        position = wp.array(x, dtype=wp.vec3, device=device)
        wp.launch(
            solve_bending,
            dim=end - first,
            inputs=[
                first, 1 / 720, 720.0, block.vertices, block.weights, block.response,
                model.inverse_mass, position, wp.array(before, dtype=wp.float32, device=device),
            ],
            device=device,
        )  # fmt: skip
        moved = mass * (position.numpy() - x.astype(np.float32))
        turned = np.cross(x, moved)
        assert np.abs(moved).sum() > 0
        assert np.abs(moved.sum(axis=0)).max() < 1e-4 * np.abs(moved).sum()
        assert np.abs(turned.sum(axis=0)).max() < 1e-4 * np.abs(turned).sum()


@pytest.mark.parametrize("damping", [0.0, 0.05])
def test_a_flapping_sheet_keeps_its_momentum(run, sheet, device, damping):
    """0.5 s of a bent, turning, stiff sheet: linear to 1e-4, angular to 1.5 %."""
    vertices, faces = sheet(0.2, 0.1, 0.0125)
    x = bent(vertices, 0.3, 10.0)
    builder = ModelBuilder(1)
    material = ClothMaterial(
        adhesion=0.0, drag=0.0, bending_stiffness=1e-4, bending_damping=damping,
        stretch_damping=damping,
    )  # fmt: skip
    builder.add_garment(x, faces, rest=vertices[:, :2], material=material)
    r = run(builder, device=device, gravity=(0, 0, 0))
    r.state.set_particles(x[None], np.add(np.cross([1.0, -2.0, 3.0], x), [0.3, -0.2, 0.1])[None])
    m = r.mass[:, None]
    linear, angular = (m * r.v).sum(axis=0), (m * np.cross(r.x, r.v)).sum(axis=0)
    r.step(30)
    assert np.linalg.norm((m * r.v).sum(axis=0) - linear) < 1e-4 * np.linalg.norm(linear)
    after = (m * np.cross(r.x, r.v)).sum(axis=0)
    assert np.linalg.norm(after - angular) < 0.015 * np.linalg.norm(angular)


@pytest.mark.parametrize("damping", [0.0, 0.1])
def test_a_stiff_sheet_is_stable(run, sheet, damping):
    """A hundred times denim's rigidity on edges of 8 mm, far beyond what a substep resolves."""
    vertices, faces = sheet(0.1, 0.1, 0.008)
    builder = ModelBuilder(1)
    material = ClothMaterial(bending_stiffness=2e-3, bending_damping=damping, drag=0.0)
    builder.add_garment(vertices, faces, pinned=(0, 1, 2), material=material)
    r = run(builder)
    r.state.set_particles(
        vertices[None], np.random.default_rng(0).normal(0, 0.5, (1, *vertices.shape))
    )
    for _ in range(4):
        r.step(30)
        assert np.sqrt((r.v**2).sum(axis=1).mean()) < 1.5  # it falls by 0.1 m and swings


def swing(run, sheet, damping):
    """Amplitudes of the first mode of a strip that is clamped at one end, without gravity."""
    vertices, faces = sheet(0.075, 0.025, 0.0125)
    s = np.maximum(vertices[:, 0] - vertices[:, 0].min() - 0.026, 0.0)
    builder = ModelBuilder(1)
    material = ClothMaterial(bending_damping=damping, adhesion=0.0, drag=0.0)
    pinned = tuple(np.flatnonzero(s == 0.0))
    builder.add_garment(vertices, faces, pinned=pinned, material=material)
    r = run(builder, gravity=(0, 0, 0), substeps=48)
    r.state.set_particles(vertices[None], np.outer(20.0 * s**2, [0, 0, 1])[None])
    z = np.array([r.step().x[np.argmax(s), 2] for _ in range(200)])
    turns = np.flatnonzero((np.abs(z[1:-1]) >= np.abs(z[:-2])) & (np.abs(z[1:-1]) > np.abs(z[2:])))
    return turns, np.abs(z[turns + 1])


def test_damping_has_its_relaxation_time(run, sheet):
    """The mode decays by exp(-t w^2 tau / 2) more than undamped: within 25 %."""
    tau = 0.03
    turns, free = swing(run, sheet, 0.0)
    damped_turns, damped = swing(run, sheet, tau)
    omega = np.pi * 60 / np.diff(turns).mean()
    free_rate = -np.polyfit(turns / 60, np.log(free), 1)[0]
    rate = -np.polyfit(damped_turns / 60, np.log(damped), 1)[0]
    assert rate - free_rate == pytest.approx(omega**2 * tau / 2, rel=0.25)
