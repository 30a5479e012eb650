"""What cannot be simulated is refused, with what was expected and what came."""

import dataclasses

import numpy as np
import pytest

from dgl_physics import (
    ClothMaterial,
    ContactOverflowError,
    MeshError,
    ModelBuilder,
    PhysicsError,
    Shape,
    SimulationDivergedError,
    SolverConfig,
)

SQUARE = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]], dtype=float)
FACES = np.array([[0, 1, 2], [1, 3, 2]])


def changed(array, index, value):
    array = array.copy()
    array[index] = value
    return array


@pytest.mark.parametrize(
    ("vertices", "faces", "message"),
    [
        (SQUARE[:, :2], FACES, r"vertices must have shape \(V, 3\) with V > 0; got \(4, 2\)"),
        (SQUARE[:0], FACES, r"vertices must have shape .* got \(0, 3\)"),
        (SQUARE, np.zeros((120, 4), int), r"faces must have shape \(F, 3\) .* got \(120, 4\)"),
        (SQUARE, FACES[:0], r"faces must have shape .* got \(0, 3\)"),
        (SQUARE, FACES.astype(float), "faces must be integers; got float64"),
        (changed(SQUARE, (2, 0), np.nan), FACES, "1 vertices are not finite, the first is 2"),
        (SQUARE, changed(FACES, (1, 1), 4), r"faces must index 0\.\.3; got 0\.\.4"),
        (SQUARE, changed(FACES, (0, 0), -1), r"faces must index 0\.\.3; got -1\.\.3"),
        (SQUARE, np.array([[0, 1, 2], [1, 3, 3]]), "1 triangles have no area, the first is 1"),
        (
            np.concatenate([SQUARE, [[5, 5, 5]]]),
            FACES,
            "1 vertices belong to no triangle, the first is 4",
        ),
        (
            np.concatenate([SQUARE, [[0, 0, 1]]]),
            np.concatenate([FACES, [[1, 2, 4]]]),
            r"1 edges belong to more than two triangles, the first is \(.*1.*, .*2.*\)",
        ),
    ],
)
def test_bad_meshes(builder, vertices, faces, message):
    with pytest.raises(MeshError, match=message) as caught:
        builder.add_garment(vertices, faces)
    assert isinstance(caught.value, ValueError)
    assert isinstance(caught.value, PhysicsError)


def test_rest_of_a_wrong_shape(builder):
    with pytest.raises(ValueError, match=r"rest must have shape \(4, 2\) .* got \(3, 2\)"):
        builder.add_garment(SQUARE, FACES, rest=np.zeros((3, 2)))


def test_builder_refuses_what_is_not_there(builder):
    with pytest.raises(ValueError, match=r"env must be in 0\.\.0; got 1"):
        builder.add_garment(SQUARE, FACES, env=1)
    with pytest.raises(ValueError, match=r"body must be in 0\.\.0; got 1"):
        builder.add_shape(Shape(kind="plane"), body=1)
    with pytest.raises(ValueError, match="env_count must be >= 1; got 0"):
        ModelBuilder(0)
    with pytest.raises(ValueError, match="every environment needs a garment"):
        builder.build()


@pytest.mark.parametrize("field", [f.name for f in dataclasses.fields(ClothMaterial)])
def test_materials_are_checked_on_both_sides_of_zero(field):
    with pytest.raises(ValueError, match=rf"{field} must be >=? 0; got -0.1"):
        ClothMaterial(**{field: -0.1})
    with pytest.raises(ValueError, match=rf"{field} must be >=? 0; got nan"):
        ClothMaterial(**{field: float("nan")})
    positive = "area_density stretch_stiffness shear_stiffness rest_offset thickness"
    if field in positive.split():
        with pytest.raises(ValueError, match=rf"{field} must be > 0; got 0"):
            ClothMaterial(**{field: 0.0})
    else:
        ClothMaterial(**{field: 0.0})


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"dt": 0.0}, "dt must be > 0; got 0"),
        ({"substeps": 0}, "substeps must be >= 1; got 0"),
        ({"search_every": 0}, "search_every must be >= 1; got 0"),
        ({"neighbour_margin": 0.0}, "neighbour_margin must be > 0; got 0"),
    ],
)
def test_bad_settings(settings, message):
    with pytest.raises(ValueError, match=message):
        SolverConfig(**settings)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"kind": "cone"}, r"kind must be one of \[.*'box'.*\]; got 'cone'"),
        ({"kind": "sphere"}, "size of a sphere must be positive"),
        ({"kind": "box", "size": (1, 1, 0)}, "size of a box must be positive"),
        ({"kind": "capsule", "size": (1, -1, 0)}, "size of a capsule must be positive"),
        ({"kind": "plane", "pose": np.zeros(6)}, r"pose must have shape \(7,\); got \(6,\)"),
        ({"kind": "plane", "friction": -1.0}, "friction must be >= 0; got -1"),
    ],
)
def test_bad_shapes(arguments, message):
    with pytest.raises(ValueError, match=message):
        Shape(**arguments)


@pytest.mark.parametrize("bad", [np.nan, np.inf, 1e3])
def test_divergence_names_step_and_environment(run, sheet, bad, device):
    builder = ModelBuilder(3)
    builder.add_garment(*sheet(0.05, 0.05, 0.0125))
    r = run(builder, device=device).step(4)
    positions = r.state.get_positions()
    positions[1, :, 0] = bad
    r.state.positions.assign(positions.reshape(-1, 3))
    with pytest.raises(
        SimulationDivergedError, match=r"frame 5 in environment\(s\) \[1\]"
    ) as caught:
        r.step()
    assert caught.value.step == 5
    assert caught.value.env_indices == [1]


def test_a_guard_that_is_off_says_nothing(run, sheet, builder):
    builder.add_garment(*sheet(0.05, 0.05, 0.0125))
    r = run(builder, is_guarded=False)
    r.state.positions.assign(np.full((r.model.particles_per_env, 3), 1e3, dtype=np.float32))
    r.step()
    assert r.x.min() > 100.0  # far outside, and no error


def test_lists_that_may_not_grow_are_told(run, sheet, builder):
    builder.add_garment(*sheet(0.05, 0.05, 0.0125, height=0.01))
    for _ in range(3):
        builder.add_ground()
    with pytest.raises(ContactOverflowError, match=r"shapes .* need 4\.\d+e-07 GiB.* allows 1e-07"):
        run(builder, near_capacity=2, list_memory=1e-7).step()
    builder = ModelBuilder(1)
    vertices, faces = sheet(0.05, 0.05, 0.0125)
    for k in range(4):
        builder.add_garment(np.add(vertices, [0, 0, 0.004 * k]), faces)
    with pytest.raises(ContactOverflowError, match=r"neighbours .* allows 1e-07"):
        run(builder, neighbour_capacity=2, list_memory=1e-7).step()
