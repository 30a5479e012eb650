"""Props have the original's measures; collision shapes match what is drawn."""

import dataclasses

import numpy as np
import pytest

from dgl_assets.props import (
    PROP_KINDS,
    CoatHangerParameters,
    GloveStandParameters,
    HangerParameters,
    HatStandParameters,
    PersonParameters,
    PlatformParameters,
    PothookParameters,
    PropShape,
    TableParameters,
    make_prop,
    save_obj,
)
from dgl_assets.props import person as person_module
from dgl_assets.props.shapes import make_box, make_capsules, make_cylinder

COVER = 0.0045
"""Largest distance between the surface and its collision shapes [m]."""
SEATED = PersonParameters(pose="seated")
OTHERS = (
    HangerParameters(length=0.5, thickness=0.03, height=1.2, wood="walnut"),
    CoatHangerParameters(width=0.46, drop=0.11, sweep=0.04, hook_radius=0.03),
    PothookParameters(height=1.3, reach=0.3, bar_length=0.2, thickness=0.04),
    PlatformParameters(width=0.8, depth=0.4, height=0.2),
    HatStandParameters(height=0.9, column=0.06, seat_radius=0.1, dome_height=0.08),
    TableParameters(width=1.4, depth=0.7, height=0.72),
)


@pytest.fixture(scope="module", autouse=True)
def person_of_the_session(woman):
    """Props use the person that other tests use, too."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(person_module, "make_person", lambda *_, **__: woman)
        yield


@pytest.fixture(scope="module")
def props():
    return {kind: make_prop(kind) for kind in PROP_KINDS}


@pytest.fixture(
    scope="module",
    params=[*PROP_KINDS, SEATED, *(pytest.param(p, marks=pytest.mark.slow) for p in OTHERS)],
    ids=lambda p: p if isinstance(p, str) else "own",
)
def prop(request):
    return make_prop(request.param)


def sample_shape(shape, count=400):
    """Points on the surface of a collision shape, in the prop's frame."""
    rng = np.random.default_rng(0)
    if shape.kind == "box":
        local = rng.uniform(-1, 1, (count, 3))
        axis = rng.integers(3, size=count)
        local[np.arange(count), axis] = np.sign(local[np.arange(count), axis])
        local *= shape.half_size
    elif shape.kind in ("convex", "mesh"):
        local = shape.points[::20] if shape.kind == "mesh" else shape.points
    else:
        angle, z = rng.uniform(0, 2 * np.pi, count), rng.uniform(-1, 1, count)
        local = np.stack([shape.radius * np.cos(angle), shape.radius * np.sin(angle),
                          shape.half_length * z], axis=1)  # fmt: skip
    w, x, y, z = shape.wxyz
    R = np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ])  # fmt: skip
    return local @ R.T + shape.xyz


def sample_parts(prop, *, only_solid):
    """Vertices and middles of faces and edges."""
    points = []
    for part in prop.parts:
        if part.is_solid or not only_solid:
            corners = part.vertices[part.faces].astype(np.float64)
            points += [corners.reshape(-1, 3), corners.mean(axis=1), corners[:, :2].mean(axis=1)]
    return np.concatenate(points)


def test_shapes_cover_what_is_seen(prop):
    points = sample_parts(prop, only_solid=True)
    every = 40 if prop.kind == "person" else 1  # its shape is the mesh that is seen
    assert prop.compute_distance(points[::every]).max() < COVER


def test_shapes_go_no_farther_than_what_is_seen(prop):
    """A point of a shape's surface that no other shape covers is near the drawn surface."""
    from scipy.spatial import cKDTree

    surface = []
    for part in prop.parts:
        corners = part.vertices[part.faces].astype(np.float64)
        edge = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
        if prop.kind == "person" and part.name != "stool":  # its triangles are small
            surface.append(corners.reshape(-1, 3))
            continue
        for triangle, length in zip(corners, edge, strict=True):
            n = min(int(length / 0.004) + 2, 90)
            i, j = np.meshgrid(np.arange(n), np.arange(n))
            u, v = i[i + j < n] / (n - 1), j[i + j < n] / (n - 1)
            surface.append(np.stack([1 - u - v, u, v], axis=1) @ triangle)
    tree = cKDTree(np.concatenate(surface))
    outside = []
    for shape in prop.shapes:
        points = sample_shape(shape)
        outside.append(points[prop.compute_distance(points) > -1e-6])
    distance, _ = tree.query(np.concatenate(outside))
    # tables' legs are tapered within upright boxes, and boxes have sharper corners
    assert np.quantile(distance, 0.99) < 0.006
    assert distance.max() < 0.012


def join(parts):
    """One part of several, which are closed together."""
    starts = np.cumsum([0, *(len(part.vertices) for part in parts)])
    return dataclasses.replace(
        parts[0],
        vertices=np.concatenate([part.vertices for part in parts]),
        normals=np.concatenate([part.normals for part in parts]),
        uvs=np.concatenate([part.uvs for part in parts]),
        faces=np.concatenate([part.faces + k for part, k in zip(parts, starts, strict=False)]),
    )


def test_meshes_are_closed_and_face_outward(prop):
    # clothes are painted on a person: they end where skin begins
    for part in [join(prop.parts)] if prop.kind == "person" else prop.parts:
        _, place = np.unique(part.vertices.round(6), axis=0, return_inverse=True)
        faces = place.ravel()[part.faces]
        faces = faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)]
        half = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
        there = {tuple(edge) for edge in half.tolist()}
        assert all((b, a) in there for a, b in there), part.name
        a, b, c = (part.vertices[part.faces[:, k]].astype(np.float64) for k in range(3))
        assert np.einsum("fk,fk->", a, np.cross(b, c)) > 0, "volume"
        cross = np.cross(b - a, c - a)
        length = np.linalg.norm(cross, axis=1, keepdims=True)
        mean = part.normals[part.faces].mean(axis=1)
        facing = np.einsum("fk,fk->f", cross / np.maximum(length, 1e-12), mean)
        facing = facing[length[:, 0] > 1e-8]
        # between a person's fingers and toes skin folds sharply
        assert np.quantile(facing, 0.005 if prop.kind == "person" else 0.0) > 0.5, part.name
        np.testing.assert_allclose(np.linalg.norm(part.normals, axis=1), 1.0, atol=1e-4)
        assert part.uvs.shape == (len(part.vertices), 2)


def test_hanger_has_the_original_measures(props):
    (bar,) = props["hanger"].shapes
    assert (bar.kind, bar.half_size) == ("box", pytest.approx((0.375, 0.01, 0.01)))
    np.testing.assert_allclose(props["hanger"].landmarks["target"], [0, 0, 0.8])
    np.testing.assert_allclose(bar.xyz, [0, 0, 0.8])


def test_pothook_has_the_original_measures(props):
    arm, bar, post = props["pothook"].shapes
    # relative to the middle of the cross-bar at (dx, 0.985 + dy, 1.0)
    np.testing.assert_allclose(np.array(arm.half_size) * 2, [0.025, 0.20, 0.025])
    np.testing.assert_allclose(arm.xyz, [0, 1.075 - 0.985, 1.0])
    np.testing.assert_allclose(np.array(bar.half_size) * 2, [0.12, 0.025, 0.025])
    np.testing.assert_allclose(bar.xyz, [0, 0, 1.0])
    np.testing.assert_allclose(np.array(post.half_size) * 2, [0.05, 0.05, 0.8])
    np.testing.assert_allclose(post.xyz, [0, 1.2 - 0.985, 0.7])
    rod = next(part for part in props["pothook"].parts if part.name == "rod")
    assert not rod.is_solid


def test_platform_and_table_have_the_original_tops(props):
    for kind, size, height in (("platform", 0.5, 0.05), ("table", 1.0, 0.1)):
        prop = props[kind]
        low, high = prop.extent
        np.testing.assert_allclose(high - low, [size, size, height], atol=1e-6)
        assert low[2] == pytest.approx(0.0, abs=1e-6), "it stands on the ground"
        np.testing.assert_allclose(
            prop.landmarks["far_right"], [size / 2, size / 2, height], atol=1e-9
        )
        assert prop.compute_distance(np.array([[0.4 * size, -0.4 * size, height]])) == (
            pytest.approx(0.0, abs=1e-9)
        )
    np.testing.assert_allclose(props["platform"].landmarks["target"], 0.0)


def test_hat_stand_has_the_original_height_and_width(props):
    stand = props["hat_stand"]
    np.testing.assert_allclose(stand.landmarks["seat"], [0, 0, 0.6])
    assert stand.extent[0, 2] == pytest.approx(0.0)
    column = stand.parts[0].vertices
    middle = column[(column[:, 2] > 0.05) & (column[:, 2] < 0.55)]
    assert 2 * np.hypot(middle[:, 0], middle[:, 1]).max() == pytest.approx(0.07, abs=0.002)
    # a hat's rim lies on the seat, beside the dome
    rim = np.array([[0.07, 0.0, 0.6], [0.0, 0.0, 0.65]])
    np.testing.assert_allclose(stand.compute_distance(rim), 0.0, atol=1e-6)


def test_glove_stand_leaves_its_gap_between_the_boards(props):
    stand, p = props["glove_stand"], GloveStandParameters()
    np.testing.assert_allclose(stand.landmarks["target"], [0, 0, p.height])
    assert stand.extent[0, 2] == pytest.approx(0.0)
    middle = np.array([[0.0, y, z] for y in (-0.09, 0.09) for z in (p.height - 0.03, p.height)])
    np.testing.assert_allclose(stand.compute_distance(middle), p.gap / 2, atol=1e-6)


def test_coat_hanger_is_symmetric_and_hangs_by_its_hook(props):
    hanger = props["coat_hanger"]
    marks = hanger.landmarks
    np.testing.assert_allclose(marks["left_shoulder"] * [-1, 1, 1], marks["right_shoulder"])
    p = CoatHangerParameters()
    low, high = hanger.extent
    assert high[0] - low[0] == pytest.approx(p.width, abs=0.002)
    assert marks["neck"][2] - marks["left_shoulder"][2] == pytest.approx(p.drop, abs=1e-6)
    assert marks["left_shoulder"][1] == pytest.approx(-p.sweep)
    # a rail through the hook touches nothing but its bend: the hook is open below on the left
    rail = marks["hook_bend"] - [0, 0, 0.8 * p.hook_radius]
    assert hanger.compute_distance(rail[None])[0] > 0.6 * p.hook_radius
    way = rail + np.linspace(0, 1, 40)[:, None] * [-1.3 * p.hook_radius, 0, -1.75 * p.hook_radius]
    assert hanger.compute_distance(way).min() > 0.003
    closed = rail + np.linspace(0, 1, 40)[:, None] * [2.2 * p.hook_radius, 0, 0]
    assert hanger.compute_distance(closed).min() < 0


def test_who_is_seated_has_feet_on_the_ground_and_a_stool_under_the_seat(props):
    seated = make_prop(SEATED)
    assert set(seated.landmarks) == set(props["person"].landmarks)
    skin = np.concatenate([part.vertices for part in seated.parts if part.name != "stool"])
    shoes = next(part for part in seated.parts if part.name == "shoes").vertices
    assert skin[:, 2].min() == shoes[:, 2].min() == pytest.approx(0.0, abs=1e-6)
    stool = next(part for part in seated.parts if part.name == "stool").vertices
    top = stool[:, 2].max()
    above = skin[np.linalg.norm(skin[:, :2] - stool[:, :2].mean(axis=0), axis=1) < 0.05]
    assert above[:, 2].min() == pytest.approx(top, abs=0.01)
    lower = props["person"].landmarks["head_top"][2] - seated.landmarks["head_top"][2]
    assert 0.25 < lower < 0.45  # about the length of the thighs


def test_an_offered_hand_is_solid_by_capsules_and_the_rest_by_a_closed_mesh(props):
    offering = make_prop(PersonParameters(pose="offer_right"))
    body, *capsules = offering.shapes
    assert body.kind == "mesh"
    assert {shape.kind for shape in capsules} == {"capsule"}
    edges = np.sort(np.concatenate([body.faces[:, [k, (k + 1) % 3]] for k in range(3)]), axis=1)
    assert (np.unique(edges, axis=0, return_counts=True)[1] == 2).all()
    wrist = offering.landmarks["right_wrist"]
    fingers = [f"right_{name}_tip" for name in ("index", "middle", "ring", "little")]
    inward = [tip + 0.01 * (wrist - tip) / np.linalg.norm(wrist - tip)
              for tip in (offering.landmarks[name] for name in fingers)]  # fmt: skip
    assert (offering.compute_distance(np.array(inward)) < -0.003).all()
    assert (body.compute_distance(np.array(inward)) > 0.02).all()
    skin = sample_parts(offering, only_solid=True)
    hand = skin[np.linalg.norm(skin - offering.landmarks["right_hand"], axis=1) < 0.15]
    assert offering.compute_distance(hand).max() < 0.008
    assert [shape.kind for shape in props["person"].shapes] == ["mesh"]


def test_masses_are_those_of_the_materials(props):
    wood = 680 * 0.75 * 0.02 * 0.02
    assert wood * 0.9 < props["hanger"].mass < wood * 1.6, "wood with brass caps"
    assert 0.1 < props["coat_hanger"].mass < 0.35
    assert 7.0 < props["platform"].mass < 680 * 0.5 * 0.5 * 0.05
    assert 10.0 < props["table"].mass < 30.0


def test_landmarks_follow_the_pose(props):
    s = np.sqrt(0.5)
    there = props["hanger"].compute_landmarks(np.array([0.1, 0.85, 0.0, s, 0, 0, s]))
    np.testing.assert_allclose(there["target"], [0.1, 0.85, 0.8], atol=1e-12)
    np.testing.assert_allclose(there["right_end"], [0.1, 0.85 + 0.375, 0.8], atol=1e-12)
    with pytest.raises(ValueError, match=r"pose must have shape \(7,\); got \(3,\)"):
        props["hanger"].compute_landmarks(np.zeros(3))


def test_distances_of_the_primitives():
    capsule = make_capsules(np.array([[0.0, 0.0, 0.0], [0.3, 0.0, 0.4]]), 0.1)[0]
    middle = np.array([0.15, 0.0, 0.2])
    points = np.array([middle, [0.15, 0.25, 0.2], [0.6, 0.0, 0.8]])
    np.testing.assert_allclose(capsule.compute_distance(points), [-0.1, 0.15, 0.4], atol=1e-9)
    cylinder = make_cylinder(0.2, 0.5, 0.9)
    points = np.array([[0, 0, 0.7], [0.5, 0, 0.7], [0, 0, 1.0], [0.23, 0, 0.94], [0, 0.15, 0.85]])
    expected = [-0.2, 0.3, 0.1, 0.05, -0.05]
    np.testing.assert_allclose(cylinder.compute_distance(points), expected, atol=1e-9)
    box = make_box((-0.1, -0.2, 0.0), (0.1, 0.2, 0.1))
    hull = PropShape(kind="convex", points=np.array(
        [[x, y, z] for x in (-0.1, 0.1) for y in (-0.2, 0.2) for z in (0.0, 0.1)]
    ))  # fmt: skip
    points = np.array([[0.0, 0.0, 0.02], [0.4, 0.0, 0.05], [0.0, 0.0, 0.3]])
    for shape in (box, hull):
        np.testing.assert_allclose(shape.compute_distance(points), [-0.02, 0.3, 0.2], atol=1e-9)
    assert box.compute_distance(np.array([[0.13, 0.24, 0.05]]))[0] == pytest.approx(0.05)


def test_wrong_parameters_are_refused(find_unrefused):
    table = [
        (HangerParameters(), {"length": 3.0}, r"length must be in \[0.3, 1.5\]; got 3.0"),
        (HangerParameters(), {"height": float("nan")}, "height must be a finite number"),
        (CoatHangerParameters(), {"drop": 0.3}, r"drop must be in \[0.03, 0.14\]"),
        (PothookParameters(), {"reach": "long"}, "reach must be a finite number; got 'long'"),
        (PlatformParameters(), {"height": 0.0}, r"height must be in \[0.03, 0.5\]"),
        (HatStandParameters(), {"dome_radius": 0.1}, "dome_radius must be less than seat_radius"),
        (TableParameters(), {"width": -1.0}, r"width must be in \[0.4, 2.4\]"),
        (PersonParameters(), {"scale": 2.0}, r"scale must be in \[0.3, 1.5\]"),
        (PersonParameters(), {"pose": "sitting"}, "pose must be one of .* got 'sitting'"),
    ]
    rows = [(lambda p=p, c=c: dataclasses.replace(p, **c), message) for p, c, message in table]
    plastic = TableParameters(wood="plastic")
    rows += [
        (lambda: make_prop("shelf"), r"prop must be one of .*'hanger'.*got 'shelf'"),
        (lambda: make_prop(plastic), r"wood must be one of .*got 'plastic'"),
        (lambda: PropShape(kind="capsule", radius=0.1), "a capsule needs positive sizes"),
        (lambda: PropShape(kind="convex"), "points must be given for convex and mesh"),
    ]
    assert find_unrefused(rows) == []


def test_equal_parameters_give_equal_props():
    for kind in ("hanger", "coat_hanger", "pothook", "platform", "hat_stand"):
        for first, second in zip(make_prop(kind).parts, make_prop(kind).parts, strict=True):
            np.testing.assert_array_equal(first.vertices, second.vertices)


def test_an_obj_holds_all_parts(props, tmp_path):
    import trimesh

    prop = props["coat_hanger"]
    loaded = trimesh.load(save_obj(prop, tmp_path / "hanger.obj"), process=False, force="mesh")
    assert len(loaded.faces) == sum(len(part.faces) for part in prop.parts)
    np.testing.assert_allclose(loaded.bounds, prop.extent, atol=2e-6)
    assert "newmtl steel" in (tmp_path / "hanger.mtl").read_text()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["hanger.mtl", "hanger.obj"]
    with pytest.raises(ValueError, match=r"path must end in .obj"):
        save_obj(prop, tmp_path / "hanger.ply")
