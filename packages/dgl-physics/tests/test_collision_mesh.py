"""Distances of cylinders, hulls and meshes against what is known of them."""

from functools import partial

import numpy as np
import pytest
import warp as wp

from dgl_physics import ClothMaterial, CollisionMesh, MeshError, ModelBuilder, Shape
from dgl_physics._kernels.distance import bound_distance, shape_distance
from dgl_physics._kernels.types import ShapeTable
from dgl_physics.shape_table import build_shape_table

MM = 1e-3


@wp.kernel(module="unique", enable_backward=False)
def look_up(
    table: ShapeTable,
    points: wp.array(dtype=wp.vec3),
    hit: wp.array(dtype=wp.vec4),
    bound: wp.array(dtype=wp.float32),
):
    i = wp.tid()
    kind = table.kind[0]
    x = wp.transform_point(wp.transform_inverse(table.pose[0]), points[i])
    hit[i] = shape_distance(kind, table.size[0], table.grid[0], table.grids, x)
    bound[i] = bound_distance(kind, table.size[0], table.grid[0], table.grids, x)


def measure(shape, points, device="cpu"):
    """Normals (N, 3), distances (N,) and lower bounds at points (N, 3), frame of the body."""
    table, _grids = build_shape_table([(0, shape)], 0.008, device)
    x = wp.array(points.astype(np.float32), dtype=wp.vec3, device=device)
    hit = wp.zeros(len(points), dtype=wp.vec4, device=device)
    bound = wp.zeros(len(points), dtype=wp.float32, device=device)
    wp.launch(look_up, dim=len(points), inputs=[table, x, hit, bound], device=device)
    return hit.numpy()[:, :3], hit.numpy()[:, 3], bound.numpy()


def mesh_shape(mesh, **settings):
    return Shape(kind="mesh", mesh=CollisionMesh(vertices=mesh[0], faces=mesh[1], **settings))


def scatter(vertices, count, margin=0.02):
    """Random points of the box around a mesh."""
    return np.random.default_rng(0).uniform(
        vertices.min(axis=0) - margin, vertices.max(axis=0) + margin, (count, 3)
    )


def angle_of_gradient(distance, points, normals):
    """Angle between normals and the gradient of a known distance [deg]."""
    steps = 1e-6 * np.eye(3)
    gradient = np.stack([distance(points + s) - distance(points - s) for s in steps], axis=1)
    gradient /= np.linalg.norm(gradient, axis=1, keepdims=True)
    return np.degrees(np.arccos(np.clip(np.sum(gradient * normals, axis=1), -1, 1)))


@pytest.mark.parametrize(
    ("name", "tolerance", "degrees"),
    [("sphere", 0.15, 3.0), ("torus", 0.25, 7.0), ("bar of 10 mm", 0.25, 17.0)],
)
def test_round_meshes(meshes, device, name, tolerance, degrees):
    """From the surface to the end of contact: errors in mm, of which half is the facets'."""
    mesh, exact = {
        "sphere": (meshes.make_sphere(0.05), lambda x: np.linalg.norm(x, axis=1) - 0.05),
        "torus": (
            meshes.make_torus(0.06, 0.02, sides=48),
            lambda x: meshes.torus_distance(x, 0.06, 0.02),
        ),
        "bar of 10 mm": (
            meshes.make_torus(0.05, 0.005),
            lambda x: meshes.torus_distance(x, 0.05, 0.005),
        ),
    }[name]
    x = scatter(mesh[0], 20_000)
    x = x[(exact(x) > -1 * MM) & (exact(x) < 16 * MM)]
    normals, distance, _ = measure(mesh_shape(mesh), x, device)
    assert np.abs(distance - exact(x)).max() < tolerance * MM
    assert angle_of_gradient(exact, x, normals).max() < degrees


def test_boxes_are_exact_but_for_their_edges(meshes, device):
    """Over the faces to rounding; around edges and corners, at a rest offset, to 0.4 mm."""
    half = np.array([0.05, 0.04, 0.03])
    mesh = meshes.make_box(half)
    x = scatter(mesh[0], 20_000)
    exact = meshes.box_distance(x, half)
    x, exact = (
        x[(exact > -3 * MM) & (exact < 16 * MM)],
        exact[(exact > -3 * MM) & (exact < 16 * MM)],
    )
    shapes = [mesh_shape(mesh), Shape(kind="convex", mesh=CollisionMesh.hull(mesh[0]))]
    inner = (np.abs(x) < half - 6 * MM).sum(axis=1) == 2  # over the middle of a face
    for shape, rounding in zip(shapes, (1e-6, 1e-5), strict=True):
        normals, distance, _ = measure(shape, x, device)
        assert np.abs(distance - exact)[inner].max() < rounding
        outward = np.sign(x[inner]) * (np.abs(x[inner]) > half - 3 * MM)
        assert np.sum(normals[inner] * outward, axis=1).min() > 1 - 1e-5
        rest = np.abs(exact - 4 * MM) < 1 * MM
        assert np.abs(distance - exact)[rest].max() < 0.4 * MM


def test_a_cylinder_is_exact(meshes, device):
    x = scatter(np.array([[-0.06, -0.06, -0.09], [0.06, 0.06, 0.09]]), 20_000)
    normals, distance, bound = measure(Shape(kind="cylinder", size=(0.05, 0.08, 0)), x, device)
    side, end = np.hypot(x[:, 0], x[:, 1]) - 0.05, np.abs(x[:, 2]) - 0.08
    outside = np.hypot(np.maximum(side, 0), np.maximum(end, 0))
    exact = np.where(outside > 0, outside, np.maximum(side, end))
    assert distance == pytest.approx(exact, abs=1e-6)
    np.testing.assert_array_equal(bound, distance)
    # a step of the distance against the normal ends on the surface
    foot = x - normals * distance[:, None]
    assert np.linalg.norm(normals, axis=1) == pytest.approx(1, abs=1e-5)
    assert measure(Shape(kind="cylinder", size=(0.05, 0.08, 0)), foot)[1] == pytest.approx(
        0, abs=1e-6
    )


def test_a_cylinder_is_its_mesh(meshes):
    mesh = meshes.make_cylinder(0.03, 0.04, sides=192)
    x = scatter(mesh[0], 20_000)
    exact = measure(Shape(kind="cylinder", size=(0.03, 0.04, 0)), x)[1]
    for shape in (mesh_shape(mesh), Shape(kind="convex", mesh=CollisionMesh.hull(mesh[0]))):
        rest = np.abs(exact - 4 * MM) < 2 * MM
        assert np.abs(measure(shape, x)[1] - exact)[rest].max() < 0.4 * MM


@pytest.mark.parametrize("is_sheet", [False, True])
def test_the_bound_is_below_the_distance(meshes, is_sheet):
    """Near, far, inside, at edges; whether the grid is fine or coarse there."""
    half = np.array([0.04, 0.02, 0.003])
    mesh = meshes.make_box(half)
    shape = mesh_shape(mesh, is_sheet=is_sheet)
    x = scatter(mesh[0], 100_000, margin=0.1)
    exact = meshes.box_distance(x, half)
    exact = np.abs(exact) if is_sheet else exact
    _, distance, bound = measure(shape, x)
    assert (bound <= exact + 1e-6).all()
    assert (bound <= distance).all()
    far = exact > 0.016 + 4 * shape.mesh.grid.spacing
    assert distance[far].min() > 0.012  # never mistaken for contact
    close = (exact > 0) & (exact < 0.01)
    assert (exact - bound)[close].max() < 3 * MM  # and of some use


def test_the_middle_of_a_grid_is_left_coarse(meshes):
    """Deep particles are still pushed out along the shortest way."""
    half = np.array([0.1, 0.1, 0.06])
    shape = mesh_shape(meshes.make_box(half))
    assert (shape.mesh.grid.fine_index < 0).mean() > 0.2
    x = scatter(np.array([[-0.03, -0.03, 0.012], [0.03, 0.03, 0.05]]), 2_000, margin=0)
    normals, distance, _ = measure(shape, x)
    assert normals[:, 2].min() > 0.99
    assert distance == pytest.approx(x[:, 2] - 0.06, abs=2 * MM)
    middle = measure(shape, np.zeros((1, 3)))
    assert np.linalg.norm(middle[0]) == pytest.approx(1, abs=1e-5)  # some way out


def test_overlapping_parts_are_one_body(meshes):
    """The surface of one within the other is no surface."""
    a, b = meshes.make_box([0.03, 0.03, 0.03]), meshes.make_box([0.02, 0.02, 0.05])
    vertices = np.concatenate([a[0], b[0] + [0.005, 0, 0]])
    x = scatter(vertices, 20_000)
    _, distance, _ = measure(mesh_shape((vertices, np.concatenate([a[1], b[1] + 8]))), x)
    exact = np.minimum(
        meshes.box_distance(x, [0.03] * 3),
        meshes.box_distance(x - [0.005, 0, 0], [0.02, 0.02, 0.05]),
    )
    clear = np.abs(exact) > 1 * MM
    assert ((distance < 0) == (exact < 0))[clear].all()
    assert np.abs(distance - exact)[(exact > 3 * MM) & (exact < 16 * MM)].max() < 0.7 * MM


def test_a_sheet_keeps_to_both_sides():
    """A square without thickness, and without an inside."""
    vertices = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * 0.05
    shape = mesh_shape((vertices, np.array([[0, 1, 2], [0, 2, 3]])), is_sheet=True)
    x = (
        scatter(vertices * 0.8, 4_000, margin=0)
        + [0, 0, 1] * np.linspace(-0.015, 0.015, 4_000)[:, None]
    )
    normals, distance, _ = measure(shape, x)
    off = np.abs(x[:, 2]) > shape.mesh.grid.spacing
    assert distance[off] == pytest.approx(np.abs(x[off, 2]), abs=1e-5)
    assert (normals[off, 2] * np.sign(x[off, 2])).min() > 0.999


def test_a_mesh_lies_where_its_pose_is(meshes):
    """Off its own origin, turned: as the same box at that place."""
    half, offset = np.array([0.03, 0.02, 0.01]), np.array([0.3, -0.2, 0.5])
    vertices, faces = meshes.make_box(half)
    q = np.array([np.cos(0.4), 0, np.sin(0.4), 0])
    pose = np.array([0.1, 0.2, 0.3, *q])
    mesh = CollisionMesh(vertices=vertices + offset, faces=faces)
    c, s = np.cos(0.8), np.sin(0.8)
    turn = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
    x = scatter(vertices, 5_000) @ turn.T + turn @ offset + pose[:3]
    box = Shape(kind="box", size=tuple(half), pose=np.array([*(turn @ offset + pose[:3]), *q]))
    expected = measure(box, x)[1]
    near = (expected > 0) & (expected < 0.01)
    distance = measure(Shape(kind="mesh", mesh=mesh, pose=pose), x)[1]
    assert np.abs(distance - expected)[near].max() < 1 * MM
    assert np.abs(distance - expected)[near].mean() < 0.05 * MM


def test_thin_things_get_fine_grids_and_big_ones_fit_in_memory(meshes):
    bar = CollisionMesh(
        **dict(zip(("vertices", "faces"), meshes.make_torus(0.1, 0.003), strict=True))
    )
    assert bar.grid.spacing == pytest.approx(0.0015, abs=1e-5)
    vertices, faces = meshes.make_box([0.3, 0.2, 0.9])
    for most in (50_000, 150_000):
        body = CollisionMesh(vertices=vertices, faces=faces, max_nodes=most)
        assert 0.4 * most < body.grid.node_count <= most
    assert body.grid.spacing > 0.0025
    with pytest.raises(
        MeshError, match=r"spacing 0.002 m needs \d+ nodes, more than .* \(100000\)"
    ):
        _ = CollisionMesh(vertices=vertices, faces=faces, spacing=0.002, max_nodes=100_000).grid


def test_hulls_hold_their_points():
    """Each point inside or on the surface; many in one plane, on one line, or twice."""
    rng = np.random.default_rng(3)
    lattice = np.stack(np.meshgrid(*[np.linspace(-0.1, 0.1, 6)] * 3), axis=-1).reshape(-1, 3)
    ball = rng.normal(size=(200, 3))
    ball *= 0.1 / np.linalg.norm(ball, axis=1, keepdims=True)
    for points, volume in (
        (np.concatenate([lattice, lattice]), 0.2**3),
        (np.concatenate([ball, 0.5 * ball]), 4 / 3 * np.pi * 0.1**3 * 0.95),
        (rng.uniform(-0.1, 0.1, (2_000, 3)), 0.2**3 * 0.97),
    ):
        hull = CollisionMesh.hull(points)
        assert hull.is_convex
        a, b, c = (hull.vertices[hull.faces[:, k]] for k in range(3))
        assert np.sum(a * np.cross(b, c)) / 6 == pytest.approx(volume, rel=0.03)
        normals = np.cross(b - a, c - a)
        size = np.linalg.norm(normals, axis=1)
        planes = normals[size > 1e-6] / size[size > 1e-6, None]
        outside = planes @ points.T - np.sum(planes * a[size > 1e-6], axis=1)[:, None]
        assert outside.max() < 2e-5


def test_bad_arrays_are_refused(meshes, unrefused):
    vertices, faces = meshes.make_box([0.1, 0.1, 0.1])
    rows = [
        ({"vertices": np.zeros((8, 2))}, r"vertices must have shape \(V, 3\) .* got \(8, 2\)"),
        ({"faces": np.zeros((0, 3), int)}, r"faces must have shape \(F, 3\) .* got \(0, 3\)"),
        ({"faces": np.zeros((12, 3))}, "faces must be integers; got float64"),
        ({"faces": np.full((12, 3), 8)}, r"faces must index 0\.\.7; got 8\.\.8"),
        ({"faces": np.zeros((12, 3), int)}, "no triangle has three corners at different places"),
    ]
    box = {"vertices": vertices, "faces": faces}
    rows = [(partial(CollisionMesh, **(box | change)), message) for change, message in rows]
    assert unrefused(rows, MeshError) == []


def test_bad_surfaces(meshes):
    vertices, faces = meshes.make_box([0.1, 0.1, 0.1])
    bad = vertices.copy()
    bad[3, 1] = np.nan
    with pytest.raises(MeshError, match="1 vertices are not finite, the first is 3"):
        CollisionMesh(vertices=bad, faces=faces)
    with pytest.raises(MeshError, match=r"3 of its edges are open.*is_sheet=True"):
        CollisionMesh(vertices=vertices, faces=faces[1:])
    CollisionMesh(vertices=vertices, faces=faces[1:], is_sheet=True)
    turned = faces.copy()
    turned[0] = turned[0, ::-1]
    with pytest.raises(MeshError, match="3 of its edges are open"):
        CollisionMesh(vertices=vertices, faces=turned)
    with pytest.raises(
        MeshError, match=r"counter-clockwise seen from outside; the volume is -0\.008"
    ):
        CollisionMesh(vertices=vertices, faces=faces[:, ::-1])
    line = np.array([[0, 0, 0], [0.1, 0, 0], [0.2, 0, 0]])
    with pytest.raises(MeshError, match="1 triangles have no area"):
        CollisionMesh(vertices=line, faces=np.array([[0, 1, 2]]), is_sheet=True)
    for points, message in (
        (vertices[:, :2], r"points must have shape \(N, 3\); got \(8, 2\)"),
        (vertices[:3], "a hull needs 4 different points; got 3"),
        (vertices * [1, 1, 0], "span a volume"),
        (bad, "points must be finite"),
    ):
        with pytest.raises(MeshError, match=message):
            CollisionMesh.hull(points)


def test_corners_at_the_same_place_are_one(meshes):
    """As files come that give each triangle corners of its own."""
    vertices, faces = meshes.make_box([0.1, 0.1, 0.1])
    mesh = CollisionMesh(
        vertices=vertices[faces].reshape(-1, 3), faces=np.arange(36).reshape(-1, 3)
    )
    assert mesh.vertices.shape == (8, 3)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"spacing": 0.0}, "spacing must be > 0; got 0"),
        ({"reach": 0.0}, "reach must be > 0; got 0"),
        ({"max_nodes": 0}, "max_nodes must be >= 1; got 0"),
    ],
)
def test_bad_settings(meshes, settings, message):
    vertices, faces = meshes.make_box([0.1, 0.1, 0.1])
    with pytest.raises(ValueError, match=message):
        CollisionMesh(vertices=vertices, faces=faces, **settings)


def test_shapes_and_their_meshes_must_fit(meshes, sheet):
    vertices, faces = meshes.make_box([0.1, 0.1, 0.1])
    box = CollisionMesh(vertices=vertices, faces=faces)
    torus = CollisionMesh(
        **dict(zip(("vertices", "faces"), meshes.make_torus(0.1, 0.03), strict=True))
    )
    with pytest.raises(ValueError, match=r"mesh must be given for kinds convex and mesh; .*'mesh'"):
        Shape(kind="mesh")
    with pytest.raises(ValueError, match=r"mesh must be given for .*'sphere'"):
        Shape(kind="sphere", size=(0.1, 0, 0), mesh=box)
    with pytest.raises(ValueError, match="size of a cylinder must be positive"):
        Shape(kind="cylinder", size=(0.1, 0, 0))
    with pytest.raises(ValueError, match="mesh of a convex must be convex"):
        Shape(kind="convex", mesh=torus)
    builder = ModelBuilder()
    builder.add_garment(*sheet(0.05, 0.05, 0.0125), material=ClothMaterial(rest_offset=0.015))
    builder.add_shape(Shape(kind="convex", mesh=box))
    with pytest.raises(
        ValueError, match=r"reach of a CollisionMesh must be >= 0\.019 m.* got 0\.016"
    ):
        builder.build()
