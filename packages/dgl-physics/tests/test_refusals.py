"""Bad input is refused with the expected and the received value."""

import dataclasses
from functools import partial

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
    SolidMaterial,
    SolverConfig,
)

SQUARE = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]], dtype=float)
FACES = np.array([[0, 1, 2], [1, 3, 2]])


def changed(array, index, value):
    array = array.copy()
    array[index] = value
    return array


def test_bad_meshes_are_refused(builder, unrefused):
    rows = [
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
    ]
    rows = [(partial(builder.add_garment, v, f), message) for v, f, message in rows]
    assert unrefused(rows, MeshError) == []
    assert issubclass(MeshError, ValueError)
    assert issubclass(MeshError, PhysicsError)


def test_bad_arguments_of_the_builder_are_refused(builder, unrefused):
    add = partial(builder.add_garment, SQUARE, FACES)
    plane = Shape(kind="plane")
    rows = [
        (
            partial(add, rest=np.zeros((3, 2))),
            r"rest must have shape \(4, 2\) .* got \(3, 2\)",
        ),
        (partial(add, env=1), r"env must be in 0\.\.0; got 1"),
        (partial(builder.add_shape, plane, body=1), r"body must be in 0\.\.0; got 1"),
        (partial(ModelBuilder, 0), "env_count must be >= 1; got 0"),
        (builder.build, "every environment needs a garment"),
    ]
    assert unrefused(rows) == []


@pytest.mark.parametrize("kind", [ClothMaterial, SolidMaterial])
def test_materials_are_checked_on_both_sides_of_zero(kind, unrefused):
    positive = "area_density stretch_stiffness shear_stiffness rest_offset thickness density"
    positive = [*positive.split(), "youngs_modulus"]
    rows = []
    for field in (f.name for f in dataclasses.fields(kind)):
        rows += [
            (partial(kind, **{field: bad}), rf"{field} must be >=? 0; got {bad}")
            for bad in (-0.1, float("nan"))
        ]
        zero = partial(kind, **{field: 0.0})
        if field in positive:
            rows.append((zero, rf"{field} must be > 0; got 0"))
        else:
            zero()
    assert unrefused(rows) == []


def test_bad_settings_are_refused(unrefused):
    rows = [
        ({"dt": 0.0}, "dt must be > 0; got 0"),
        ({"substeps": 0}, "substeps must be >= 1; got 0"),
        ({"search_every": 0}, "search_every must be >= 1; got 0"),
        ({"neighbour_margin": 0.0}, "neighbour_margin must be > 0; got 0"),
        ({"sleep_distance": -1e-3}, "sleep_distance must be >= 0; got -0.001"),
        ({"sleep_after": 0.0}, "sleep_after must be > 0; got 0"),
    ]
    assert unrefused((partial(SolverConfig, **s), message) for s, message in rows) == []


def test_bad_shapes_are_refused(unrefused):
    rows = [
        ({"kind": "cone"}, r"kind must be one of \[.*'box'.*\]; got 'cone'"),
        ({"kind": "sphere"}, "size of a sphere must be positive"),
        ({"kind": "box", "size": (1, 1, 0)}, "size of a box must be positive"),
        ({"kind": "capsule", "size": (1, -1, 0)}, "size of a capsule must be positive"),
        ({"kind": "plane", "pose": np.zeros(6)}, r"pose must have shape \(7,\); got \(6,\)"),
        ({"kind": "plane", "friction": -1.0}, "friction must be >= 0; got -1"),
    ]
    assert unrefused((partial(Shape, **a), message) for a, message in rows) == []


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


def test_an_unguarded_solver_raises_nothing(run, sheet, builder):
    builder.add_garment(*sheet(0.05, 0.05, 0.0125))
    r = run(builder, is_guarded=False)
    r.state.positions.assign(np.full((r.model.particles_per_env, 3), 1e3, dtype=np.float32))
    r.step()
    assert r.x.min() > 100.0  # far outside, and no error


def test_lists_beyond_their_memory_are_refused(run, sheet, builder):
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
