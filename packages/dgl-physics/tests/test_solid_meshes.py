"""Solids from surfaces: fillings, skins, and what is refused."""

from functools import partial

import numpy as np
import pytest

from dgl_physics import MeshError, ModelBuilder, SolidMaterial
from dgl_physics.factor import factorise, order_rows
from dgl_physics.lattice import fill_closed_surface
from dgl_physics.tetrahedra import compute_edges, compute_surface, compute_volumes

TET = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], dtype=float) * 0.05
ONE = np.array([[0, 1, 2, 3]])
CLOSED = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])


def ball(radius, count=3):
    """A subdivided octahedron, seen from outside."""
    vertices = np.array(
        [[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], float
    )
    faces = np.array([(i, j, k) for i in (0, 1) for j in (2, 3) for k in (4, 5)])
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    flip = np.sum(np.cross(b - a, c - a) * a, axis=1) < 0
    faces[flip] = faces[flip][:, ::-1]
    for _ in range(count):
        edges, index = np.unique(
            np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]], axis=2).reshape(-1, 2),
            axis=0,
            return_inverse=True,
        )
        m = index.reshape(-1, 3) + len(vertices)
        vertices = np.concatenate([vertices, vertices[edges].mean(axis=1)])
        vertices /= np.linalg.norm(vertices, axis=1, keepdims=True)
        a, b, c = faces.T
        faces = np.concatenate(
            [np.column_stack(t) for t in
             ((a, m[:, 0], m[:, 2]), (m[:, 0], b, m[:, 1]), (m[:, 2], m[:, 1], c), m.T)]
        )  # fmt: skip
    return vertices * radius, faces


@pytest.mark.parametrize("resolution", [6, 12])
def test_a_filled_ball_is_a_ball(resolution):
    vertices, faces = ball(0.05)
    points, tets, skin = fill_closed_surface(vertices, faces, resolution)
    assert compute_volumes(points, tets).min() > 0
    assert compute_volumes(points, tets).sum() == pytest.approx(4 / 3 * np.pi * 0.05**3, rel=0.06)
    outer = np.linalg.norm(points[np.unique(compute_surface(tets))], axis=1)
    assert np.abs(outer - 0.05).mean() < 0.12 * 0.1 / resolution  # of a cube's side
    np.testing.assert_allclose(skin.compute_vertices(points), vertices, atol=1e-12)
    np.testing.assert_allclose(skin.weights.sum(axis=1), 1.0)


def test_a_skin_follows_its_solid(run):
    vertices, faces = ball(0.05)
    builder = ModelBuilder(1)
    builder.add_solid(vertices, faces, resolution=6, material=SolidMaterial(drag=0.0))
    r = run(builder).step(10)
    drawn, triangles = r.model.garments[0].get_surface(r.x)
    np.testing.assert_array_equal(triangles, faces)
    fall = r.x.mean(axis=0) - r.model.initial_positions[0].mean(axis=0)
    np.testing.assert_allclose(drawn, vertices + fall, atol=1e-5)


def test_the_surface_of_a_wall_is_closed_and_seen_from_outside(run, sheet):
    vertices, faces = sheet(0.05, 0.05, 0.0125)
    builder = ModelBuilder(1)
    builder.add_solid(vertices, faces, thickness=0.003)
    positions, surface = (
        builder.build().garments[0].get_surface(builder.build().initial_positions[0].astype(float))
    )
    a, b, c = (positions[surface[:, k]] for k in range(3))
    d, e, f = (vertices[faces[:, k]] for k in range(3))
    area = 0.5 * np.linalg.norm(np.cross(e - d, f - d), axis=1)
    assert np.sum(a * np.cross(b, c)) / 6 == pytest.approx(area.sum() * 0.003, rel=1e-3)
    np.testing.assert_array_equal(positions[: len(vertices)], vertices.astype(np.float32))


def test_a_factor_solves_its_matrix():
    rng = np.random.default_rng(0)
    tets = np.concatenate([np.sort(rng.permutation(20)[:4])[None] + k for k in range(0, 150)])
    n = int(tets.max()) + 1
    order = order_rows(tets, n)
    np.testing.assert_array_equal(np.sort(order), np.arange(n))
    row = np.argsort(order)
    edges = row[compute_edges(tets)]
    weights = rng.uniform(1, 2, len(edges))
    rows = np.concatenate([edges.ravel(), edges.ravel()])
    columns = np.concatenate([edges[:, ::-1].ravel(), edges.ravel()])
    values = np.concatenate([np.repeat(-weights, 2), np.repeat(weights, 2)])
    matrix = np.diag(np.full(n, 0.1))
    np.add.at(matrix, (rows, columns), values)
    f = factorise(np.full(n, 0.1), rows, columns, values)
    lower = np.zeros((n, n))
    for k, (start, column) in enumerate(zip(f.entry_start, f.column_start, strict=True)):
        lower[k, column : k + 1] = f.entries[start : start + k + 1 - column]
        lower[k, k] = 1 / lower[k, k]
    np.testing.assert_allclose(lower @ lower.T, matrix, atol=1e-5)
    np.testing.assert_allclose(f.inverse @ matrix, np.eye(n), atol=1e-4)


def test_bad_tetrahedra_are_refused(builder, unrefused):
    rows = [
        (TET[:, :2], ONE, r"vertices must have shape \(V, 3\) .* got \(4, 2\)"),
        (TET, ONE[:, :3], r"tets must have shape \(T, 4\) .* got \(1, 3\)"),
        (TET, ONE.astype(float), "tets must be integers; got float64"),
        (TET * [1, 1, np.nan], ONE, "4 vertices are not finite, the first is 0"),
        (TET, ONE + 1, r"tets must index 0\.\.3; got 1\.\.4"),
        (TET, ONE[:, [1, 0, 2, 3]], "1 tetrahedra are inverted or flat, the first is 0"),
        (TET * [1, 1, 1e-4], ONE, "1 tetrahedra are inverted or flat"),
        (np.concatenate([TET, [[1, 1, 1]]]), ONE, "1 vertices belong to no tetrahedron"),
    ]
    rows = [(partial(builder.add_tetrahedra, v, tets), message) for v, tets, message in rows]
    assert unrefused(rows, MeshError) == []


def test_bad_surfaces(builder):
    with pytest.raises(MeshError, match="faces must have shape"):
        builder.add_solid(TET, ONE)
    with pytest.raises(
        MeshError, match=r"passed twice in the same direction, the first is \(0, 1\)"
    ):
        builder.add_solid(TET, np.array([[0, 1, 2], [0, 1, 3], [0, 3, 2]]), thickness=0.001)
    with pytest.raises(MeshError, match="faces inwards"):
        builder.add_solid(TET, CLOSED[:, ::-1])
    with pytest.raises(MeshError, match=r"raise resolution \(1\)"):
        builder.add_solid(TET, CLOSED, resolution=1)
    with pytest.raises(ValueError, match=r"thickness must be None; got 0\.001"):
        builder.add_solid(TET, CLOSED, thickness=0.001)
    with pytest.raises(ValueError, match="none can be pinned; got 1"):
        builder.add_solid(TET, CLOSED, pinned=(0,))
    for thickness in (None, 0.0, -1.0):
        with pytest.raises(ValueError, match=f"wall thickness > 0; got {thickness}"):
            builder.add_solid(TET, CLOSED[:3], thickness=thickness)
    with pytest.raises(MeshError, match=r"a wall of 0\.05 m folds over itself behind"):
        builder.add_solid(*half_ball(), thickness=0.05)
    with pytest.raises(ValueError, match=r"rest must have shape \(4, 3\); got \(3, 3\)"):
        builder.add_tetrahedra(TET, ONE, rest=TET[:3])
    with pytest.raises(ValueError, match=r"pinned must be in 0\.\.3; got 4\.\.4"):
        builder.add_tetrahedra(TET, ONE, pinned=(4,))
    with pytest.raises(ValueError, match=r"env must be in 0\.\.0; got 3"):
        builder.add_tetrahedra(TET, ONE, env=3)


def test_bad_stiffness(builder):
    with pytest.raises(ValueError, match=r"stiffness must have shape \(4,\); got \(3,\)"):
        builder.add_tetrahedra(TET, ONE, stiffness=np.ones(3))
    for bad in (0.0, -1.0, np.nan):
        with pytest.raises(ValueError, match="stiffness must be positive"):
            builder.add_tetrahedra(TET, ONE, stiffness=np.array([1.0, 1.0, 1.0, bad]))
    with pytest.raises(ValueError, match="stiffness must be None"):
        builder.add_solid(TET, CLOSED, stiffness=np.ones(4))
    vertices, faces = half_ball()
    with pytest.raises(ValueError, match="stiffness must have shape"):
        builder.add_solid(vertices, faces, thickness=0.004, stiffness=np.ones(3))


def half_ball():
    vertices, faces = ball(0.04)
    faces = faces[(vertices[faces, 2] > -1e-9).all(axis=1)]
    used, index = np.unique(faces, return_inverse=True)
    return vertices[used], index.reshape(-1, 3)


def test_poissons_ratio_has_a_limit():
    SolidMaterial(poisson_ratio=0.49)
    with pytest.raises(ValueError, match=r"poisson_ratio must be <= 0\.49; got 0\.5"):
        SolidMaterial(poisson_ratio=0.5)
    mu, lame = SolidMaterial(youngs_modulus=1e6, poisson_ratio=0.25).compute_lame()
    assert (mu, lame) == pytest.approx((4e5, 4e5))
