"""Stretch and shear: the moduli of a sheet are the material's, on even and on uneven meshes."""

import numpy as np
import pytest

from dgl_physics import ClothMaterial, ModelBuilder, topology
from dgl_physics.membrane import compute_edge_stiffness, compute_moduli, make_yarns

W = 0.2  # kg/m^2
G = 9.81


def compliance_tensor(stretch, shear):
    """(S_11, S_12, S_66) [m/N] of the model of the membrane module."""
    c11 = 0.5 * (stretch + np.sqrt(stretch**2 + 4 * shear**2))
    s11, s12 = np.array([c11, -shear]) / (c11**2 - shear**2)
    return s11, s12, 1 / shear


def energy_per_area(vertices, faces, stretch, shear, strain):
    """Energy of net and yarns under a uniform small strain [J/m^2]."""
    moduli = compute_moduli(stretch, shear)
    x = vertices.copy()
    x[:, :2] = vertices[:, :2] @ (np.eye(2) + strain)
    edges = topology.compute_edges(faces)
    k = compute_edge_stiffness(vertices, faces, edges, moduli.net)
    length = [np.linalg.norm(p[edges[:, 0]] - p[edges[:, 1]], axis=1) for p in (vertices, x)]
    total = 0.5 * (k * (length[1] - length[0]) ** 2).sum()
    yarns = make_yarns(vertices[:, :2], faces, moduli.yarn)
    if len(yarns.vertices):
        a, b, c = x[yarns.vertices].swapaxes(0, 1)
        for w in (yarns.weights[:, :2], yarns.weights[:, 2:]):
            vector = (b - a) * w[:, :1] + (c - a) * w[:, 1:]
            stretched = np.linalg.norm(vector, axis=1) - 1
            total += 0.5 * (stretched**2 / yarns.compliance).sum()
    return total / topology.compute_vertex_areas(vertices, faces).sum()


MODULI = [(1000.0, None), (1000.0, 375.0), (1000.0, 40.0), (4000.0, 10.0)]


@pytest.mark.parametrize(("stretch", "shear"), MODULI)
@pytest.mark.parametrize(("edge", "noise", "bound"), [(0.0125, 0, 0.01), (0.005, 0.2, 0.05)])
def test_energy_of_uniform_strain(sheet, stretch, shear, edge, noise, bound):
    """C_11, C_22, C_66 and C_12 of an even mesh to 1 %, of an uneven one to 5 % of the larger."""
    vertices, faces = sheet(0.4, 0.4, edge)
    shift = np.random.default_rng(0).uniform(-noise, noise, (len(vertices), 2)) * edge
    vertices[:, :2] += shift
    s11, s12, s66 = compliance_tensor(stretch, shear or 0.375 * stretch)
    c11, c12 = np.array([s11, -s12]) / (s11**2 - s12**2)
    e = 1e-4
    for strain, expected in (
        ([[e, 0], [0, 0]], c11),
        ([[0, 0], [0, e]], c11),
        ([[0, e / 2], [e / 2, 0]], 1 / s66),
        ([[e, 0], [0, e]], 2 * c11 + 2 * c12),
        ([[e, 0], [0, -e]], 2 * c11 - 2 * c12),
    ):
        measured = 2 * energy_per_area(vertices, faces, stretch, shear, np.array(strain)) / e**2
        assert measured == pytest.approx(expected, rel=bound + 0.01)


def settle(run, vertices, faces, pinned, gravity, *, turned=0.0, **material):
    """Displacement of a flat sheet under its weight in its own plane, turned in the fabric."""
    c, s = np.cos(turned), np.sin(turned)
    builder = ModelBuilder(1)
    builder.add_garment(
        vertices,
        faces,
        rest=vertices[:, :2] @ np.array([[c, s], [-s, c]]),
        pinned=tuple(np.flatnonzero(pinned)),
        material=ClothMaterial(area_density=W, adhesion=0.0, drag=8.0, thickness=0.005, **material),
    )
    # it creeps to its place in the heavy air: it must not fall asleep on the way
    r = run(builder, gravity=gravity, substeps=96, sleep_distance=0.0).step(150)
    assert np.abs(r.v).max() < 0.01
    return r.x - vertices


@pytest.mark.parametrize(
    ("stretch", "shear", "turned"),
    [
        (40.0, None, 0),
        (40.0, 3.0, 45),
        (40.0, 3.0, 90),
        pytest.param(40.0, None, 45, marks=pytest.mark.slow),
        pytest.param(40.0, None, 90, marks=pytest.mark.slow),
        pytest.param(40.0, 3.0, 0, marks=pytest.mark.slow),
    ],
)
def test_uniaxial_tension(run, sheet, stretch, shear, turned):
    """A strip hung by its end is w g L^2 / 2 E longer along warp, bias and weft: 6 %."""
    vertices, faces = sheet(0.12, 0.5, 0.02)
    y = vertices[:, 1] - vertices[:, 1].min()
    drop = settle(
        run, vertices, faces, y > y.max() - 1e-6, (0, -G / 4, 0),
        turned=np.radians(turned), stretch_stiffness=stretch, shear_stiffness=shear,
    )  # fmt: skip
    s11, s12, s66 = compliance_tensor(stretch, shear or 0.375 * stretch)
    compliance = (2 * s11 + 2 * s12 + s66) / 4 if turned == 45 else s11
    # between a fifth and the whole length, away from the clamp's lateral hold
    low, high = (drop[np.abs(y - at) < 0.009, 1].mean() for at in (0.0, 0.8 * y.max()))
    expected = compliance * W * G / 4 * (0.8 * y.max()) ** 2 / 2
    assert high - low == pytest.approx(expected, rel=0.06)


@pytest.mark.parametrize(
    ("stretch", "shear"), [pytest.param(40.0, None, marks=pytest.mark.slow), (60.0, 6.0)]
)
def test_pure_shear(run, sheet, stretch, shear):
    """A wide sheet held at its lower edge, pulled sideways: w g H^2 / 2 G at its top, 6 %."""
    vertices, faces = sheet(0.8, 0.1, 0.02)
    y = vertices[:, 1] - vertices[:, 1].min()
    shift = settle(
        run, vertices, faces, y < 1e-6, (G / 10, 0, 0),
        stretch_stiffness=stretch, shear_stiffness=shear,
    )  # fmt: skip
    middle = (np.abs(vertices[:, 0]) < 0.2) & (y > y.max() - 1e-6)
    modulus = shear or 0.375 * stretch
    expected = W * G / 10 * y.max() ** 2 / 2 / modulus
    assert shift[middle, 0].mean() == pytest.approx(expected, rel=0.06)


def test_three_dimensional_rest_is_isotropic(sheet, builder):
    """Without flat coordinates nothing says where the warp is."""
    material = ClothMaterial(shear_stiffness=10.0)
    vertices, faces = sheet(0.1, 0.1, 0.0125)
    builder.add_garment(vertices, faces, material=material)
    builder.add_garment(vertices, faces, rest=vertices[:, :2], material=material)
    model = builder.build()
    assert model.yarns.count == len(faces)
    stiffness = 1.0 / model.compliance.numpy()
    assert stiffness.max() / stiffness.min() > 1000 * 3 / 80 / 2


def test_a_softer_shear_than_the_default_needs_no_more_than_three_eighths():
    assert ClothMaterial(stretch_stiffness=80.0, shear_stiffness=30.0).shear_stiffness == 30.0
    with pytest.raises(ValueError, match="at most 3/8 of stretch_stiffness, 30; got 31"):
        ClothMaterial(stretch_stiffness=80.0, shear_stiffness=31.0)


def bounce(run, damping):
    """Height of a particle on a spring triangle after a second of bouncing, and its rest."""
    vertices = np.array([[0, 0, 0], [0.1, 0, 0], [0.05, 0, -0.1 * np.sqrt(0.75)]])
    builder = ModelBuilder(1)
    material = ClothMaterial(
        stretch_stiffness=40.0, stretch_damping=damping, drag=0.0, area_density=10.0
    )
    builder.add_garment(vertices, np.array([[0, 1, 2]]), pinned=(0, 1), material=material)
    r = run(builder, substeps=40)
    return np.array([r.step().x[2, 2] for _ in range(120)]) - vertices[2, 2]


def test_stretch_damping_has_its_relaxation_time(run):
    """A weight on two springs of modulus E: its swing decays by exp(-t w^2 tau / 2), 20 %."""
    tau = 0.004
    free, damped = bounce(run, 0.0), bounce(run, tau)
    rest = damped[-30:].mean()
    assert free.mean() == pytest.approx(rest, rel=0.05)  # damping moves no equilibrium
    omega = np.sqrt(G / -rest)  # of a linear spring
    swing = [np.ptp(damped[k : k + 20]) / np.ptp(free[k : k + 20]) for k in (0, 20)]
    assert np.log(swing[0] / swing[1]) == pytest.approx(omega**2 * tau / 2 * 20 / 60, rel=0.2)


def test_damping_beyond_the_substep_is_stable(run, sheet):
    vertices, faces = sheet(0.1, 0.1, 0.0125)
    for material in (ClothMaterial(stretch_damping=1.0), ClothMaterial(
        stretch_stiffness=4000.0, shear_stiffness=40.0, stretch_damping=1.0
    )):  # fmt: skip
        builder = ModelBuilder(1)
        builder.add_garment(vertices, faces, rest=vertices[:, :2], pinned=(0, 1), material=material)
        r = run(builder)
        r.state.set_particles(
            vertices[None], np.random.default_rng(0).normal(0, 0.5, (1, *vertices.shape))
        )
        r.step(90)
        assert np.sqrt((r.v**2).sum(axis=1).mean()) < 1.5


def test_a_restored_state_resets_the_damping(run, sheet):
    """Lengths kept for damping do not outlive a frame, not even those that are not numbers."""
    vertices, faces = sheet(0.1, 0.1, 0.0125)
    material = ClothMaterial(shear_stiffness=40.0, stretch_damping=0.01)
    builder = ModelBuilder(1)
    builder.add_garment(
        bend(vertices), faces, rest=vertices[:, :2], pinned=(0, 1), material=material
    )
    used, fresh = run(builder, is_guarded=False), run(builder, is_guarded=False)
    start = used.state.get_positions()
    used.step(3)
    used.state.positions.assign(np.full_like(start[0], np.nan))
    used.step()
    used.state.set_particles(start)
    np.testing.assert_array_equal(used.step(3).x, fresh.step(3).x)


def bend(vertices):
    return np.column_stack([vertices[:, :2], 0.02 * np.sin(40 * vertices[:, 0])])
