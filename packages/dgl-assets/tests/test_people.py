"""Facts about people."""

import sys
import types
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import ConvexHull, KDTree

from dgl_assets import AssetError, AssetNotFoundError
from dgl_assets.garments.meshing import compute_edges
from dgl_assets.people import (
    PEOPLE,
    POSES,
    Person,
    PersonMeasures,
    load_smplx,
    make_person,
    sample_person,
)
from dgl_assets.people.skeleton import make_joints
from dgl_assets.people.solids import Blend, Cone, Ellipsoid
from dgl_assets.people.surface_nets import extract_surface, separate

SHAPES = ("man", "woman", "child_8")


@pytest.fixture(scope="module")
def people() -> dict[str, Person]:
    return {name: make_person(name) for name in SHAPES}


def test_the_skin_is_one_closed_manifold(people):
    for person in people.values():
        edges, counts = compute_edges(person.faces)
        assert counts.min() == counts.max() == 2
        half_edges = np.concatenate(
            [person.faces[:, [0, 1]], person.faces[:, [1, 2]], person.faces[:, [2, 0]]]
        )
        assert len(np.unique(half_edges, axis=0)) == len(half_edges)
        assert len(person.vertices) - len(edges) + len(person.faces) == 2  # a sphere
        corners = person.vertices[person.faces].astype(np.float64)
        volume = np.einsum("ij,ij->", np.cross(corners[:, 0], corners[:, 1]), corners[:, 2]) / 6
        assert volume > 0  # outward


def test_volume_is_that_of_a_body(people):
    """People weigh about a kilogram a litre; means are 80 to 86 kg, 68 to 73 kg and 26 kg."""
    for name, low, high in (("man", 65, 100), ("woman", 55, 85), ("child_8", 20, 34)):
        person = people[name]
        corners = person.vertices[person.faces].astype(np.float64)
        volume = np.einsum("ij,ij->", np.cross(corners[:, 0], corners[:, 1]), corners[:, 2]) / 6
        assert low < 1000 * volume < high


def test_measures_are_kept(people):
    for name, person in people.items():
        m = PEOPLE[name]
        assert person.vertices[:, 2].max() == pytest.approx(m.stature, rel=0.005)
        assert person.vertices[:, 2].min() == 0
        for level, girth, bones, tolerance in (
            (person.frames["brow"][1][2, 3], m.head_girth, ("head",), 0.05),
            (person.frames["neck"][1][2, 3], m.neck_girth, ("neck",), 0.06),
        ):
            ids = [person.skeleton.names.index(bone) for bone in bones]
            near = np.abs(person.vertices[:, 2] - level) < 0.008
            near &= person.weights[:, ids].sum(axis=1) > 0.5
            hull = ConvexHull(person.vertices[near, :2].astype(np.float64))
            assert hull.area == pytest.approx(girth, rel=tolerance)  # in the plane: the girth


def test_weights_sum_to_one_and_are_smooth(people):
    for person in people.values():
        assert np.abs(person.weights.sum(axis=1) - 1).max() < 1e-5
        assert (person.weights > 0).sum(axis=1).max() <= 6
        edges, _ = compute_edges(person.faces)
        jump = np.abs(person.weights[edges[:, 0]] - person.weights[edges[:, 1]]).sum(axis=1)
        assert np.quantile(jump, 0.99) < 0.8
        # Fingers do not move each other.
        names = person.skeleton.names
        index, little = names.index("left_index3"), names.index("left_little3")
        assert np.all(person.weights[:, index] * person.weights[:, little] < 1e-6)


def test_the_rest_pose_is_the_rest_pose(people):
    for person in people.values():
        assert np.allclose(person.pose("rest"), person.vertices, atol=1e-6)
        assert np.allclose(person.pose({}), person.vertices, atol=1e-6)
        resting = {
            f"{joint.name}_{motion.name}": motion.rest
            for joint in person.skeleton.joints
            for motion in joint.motions
        }
        assert np.allclose(person.pose(resting), person.vertices, atol=1e-6)


def test_bones_keep_their_lengths(people):
    person = people["woman"]
    rng = np.random.default_rng(0)
    positions, parents = person.skeleton.positions, person.skeleton.parents
    for _ in range(10):
        angles = {name: rng.uniform(*limits) for name, limits in person.skeleton.limits.items()}
        transforms = person.skeleton.compute_transforms(angles)
        moved = np.einsum("jab,jb->ja", transforms[:, :3, :3], positions) + transforms[:, :3, 3]
        for k, parent in enumerate(parents):
            if parent >= 0:
                before = np.linalg.norm(positions[k] - positions[parent])
                assert np.linalg.norm(moved[k] - moved[parent]) == pytest.approx(before, abs=1e-9)


def test_motions_go_where_their_names_say(people):
    person = people["man"]
    arms = {f"{side}_shoulder_abduction": 0.0 for side in ("left", "right")}
    names = ("left_middle_tip", "right_middle_tip", "head_top", "left_toe_tip")
    start = person.get_landmark_positions(names, arms)
    assert start[0, 0] > 0 > start[1, 0]  # its own left is +x

    def moved(angles):
        return person.get_landmark_positions(names, arms | angles) - start

    assert moved({"left_shoulder_flexion": 1.5})[0, 1] < -0.5  # forward
    assert moved({"right_shoulder_flexion": 1.5})[1, 1] < -0.5
    assert moved({"left_shoulder_abduction": 1.5})[0, 0] > 0.4  # outward
    assert moved({"right_shoulder_abduction": 1.5})[1, 0] < -0.4
    assert moved({"left_elbow_flexion": 1.5})[0, 1] < -0.2
    assert moved({"left_wrist_flexion": 1.0})[0, 0] < -0.1  # towards the palm, which faces inward
    assert moved({"right_wrist_flexion": 1.0})[1, 0] > 0.1
    assert moved({"left_middle1_flexion": 1.2})[0, 0] < -0.03
    assert moved({"chest_flexion": 0.5})[2, 1] < -0.1
    assert moved({"head_bending": 0.3})[2, 0] > 0.03
    assert moved({"left_hip_flexion": 1.0})[3, 1] < -0.3
    assert moved({"left_knee_flexion": 1.0})[3, 1] > 0.1


def test_left_and_right_mirror_each_other(people):
    for person in people.values():
        tree = KDTree(person.vertices)
        for name, vertex in person.landmarks.items():
            if name.startswith("left_"):
                other = person.vertices[person.landmarks["right_" + name[5:]]]
                assert np.allclose(person.vertices[vertex] * [-1, 1, 1], other, atol=0.008)
        assert tree.query(person.vertices * [-1, 1, 1])[0].max() < 0.006


def test_landmarks_are_where_they_are_named(people):
    for person in people.values():
        at = dict(
            zip(
                person.landmarks,
                person.get_landmark_positions(tuple(person.landmarks)),
                strict=True,
            )
        )
        assert at["head_top"][2] > at["brow"][2] > at["nose_tip"][2] > at["chin"][2]
        assert at["chin"][2] > at["neck_front"][2] - 0.02
        assert at["brow"][1] < at["occiput"][1]
        assert at["neck_front"][1] < at["neck_back"][1]
        assert at["neck_right"][0] < 0 < at["neck_left"][0]
        assert at["nose_tip"][1] == min(
            at[name][1] for name in ("nose_tip", "brow", "chin", "neck_front")
        )
        for side in ("left", "right"):
            tips = [at[f"{side}_{f}_tip"] for f in ("index", "middle", "ring", "little")]
            assert np.all(np.diff([tip[1] for tip in tips]) > 0)  # the index finger is in front
            assert at[f"{side}_palm_centre"][2] < at[f"{side}_hand_back"][2]


def test_frames_move_with_their_bones(people):
    person = people["man"]
    rest, there = person.compute_frames(), person.compute_frames("reach_right")
    assert np.allclose(rest["head_top"][1], [1, 0, 0, 0])
    assert np.allclose(rest["neck"][0], there["neck"][0])
    place, (w, x, y, z) = there["right_hand"]
    assert place[1] < -0.4
    along = np.array([1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)])
    out = np.array([2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)])
    assert along[1] < -0.95  # fingers to the front
    assert out[2] < -0.9  # palm down
    skin = person.pose("reach_right")
    tip = skin[person.landmarks["right_middle_tip"]]
    assert (tip - place) @ along > 0.08


def test_capsules_fill_the_body(people):
    for person in people.values():
        for pose in ("rest", "standing"):
            ends, radii = person.compute_capsules(pose)
            skin = person.pose(pose)
            along = ends[:, 1] - ends[:, 0]
            offset = skin[:, None] - ends[None, :, 0]
            share = (offset * along).sum(axis=2) / np.maximum((along**2).sum(axis=1), 1e-12)
            near = offset - np.clip(share, 0, 1)[..., None] * along
            depth = (np.linalg.norm(near, axis=2) - radii).min(axis=1)
            assert np.quantile(np.abs(depth), 0.9) < 0.03
            assert depth.max() < 0.06


@pytest.mark.parametrize("pose", sorted(POSES))
def test_poses_keep_the_skin_in_one_piece(people, pose):
    person = people["man"]
    skin = person.pose(pose)
    edges, _ = compute_edges(person.faces)
    rest = np.linalg.norm(person.vertices[edges[:, 0]] - person.vertices[edges[:, 1]], axis=1)
    length = np.linalg.norm(skin[edges[:, 0]] - skin[edges[:, 1]], axis=1)
    assert np.quantile(length / rest, 0.99) < 1.8
    assert length.max() < 0.06


def test_scale_scales_everything(people):
    whole, small = people["child_8"], make_person("child_8", scale=0.5)
    assert np.allclose(small.pose("standing"), 0.5 * whole.pose("standing"), atol=1e-5)
    assert np.allclose(
        small.compute_frames()["neck"][0], 0.5 * whole.compute_frames()["neck"][0], atol=1e-6
    )
    assert np.allclose(small.compute_capsules()[1], 0.5 * whole.compute_capsules()[1])


def test_random_people_differ_and_repeat():
    drawn = [sample_person(seed) for seed in range(200)]
    assert drawn[3] == sample_person(np.random.default_rng(3))
    ratios = [m.waist_girth / m.stature for m in drawn]
    assert max(ratios) / min(ratios) > 1.4


def test_a_random_person_can_be_made():
    person = make_person(sample_person(11))
    assert len(person.vertices) > 10_000


def test_wrong_poses_are_refused(people):
    person = people["man"]
    with pytest.raises(ValueError, match=r"pose must be one of .*; got 'sitting'"):
        person.pose("sitting")
    with pytest.raises(ValueError, match=r"unknown motions \['left_elbow_twist'\]"):
        person.pose({"left_elbow_twist": 0.1})
    with pytest.raises(ValueError, match=r"left_knee_flexion must be in .* got -0\.500"):
        person.pose({"left_knee_flexion": -0.5})
    with pytest.raises(KeyError, match="unknown landmarks"):
        person.get_landmark_positions(("tail",))


def test_wrong_measures_are_refused():
    man = PEOPLE["man"]
    with pytest.raises(ValueError, match="got 'giant'"):
        make_person("giant")
    with pytest.raises(ValueError, match=r"scale must be in \[0\.3, 1\.5\]; got 2"):
        make_person("man", scale=2)
    with pytest.raises(ValueError, match="stature must be in"):
        replace(man, stature=3.0)
    with pytest.raises(ValueError, match="crotch_height must be 0"):
        replace(man, crotch_height=0.6)
    with pytest.raises(ValueError, match="shoulder_height must be 0"):
        replace(man, shoulder_height=1.2)
    with pytest.raises(ValueError, match="room for neck and head"):
        replace(man, shoulder_height=1.50, head_girth=0.63)


def test_weights_that_do_not_sum_to_one_are_refused(people):
    person = people["man"]
    with pytest.raises(ValueError, match="sum to 1"):
        replace(person, weights=0.5 * person.weights)
    with pytest.raises(ValueError, match="weights must have shape"):
        replace(person, weights=person.weights[:, :3])


def test_limits_are_ordered_and_contain_the_rest():
    for joint in make_joints():
        for motion in joint.motions:
            assert motion.low <= motion.rest <= motion.high
            assert motion.low <= 0 <= motion.high


def test_solids_measure_distance():
    cone = Cone(bone="b", start=np.zeros(3), end=np.array([0, 0, 0.2]), radii=(0.05, 0.05))
    points = np.array([[0.08, 0, 0.1], [0, 0, 0.3], [0.01, 0, 0.1]])
    assert np.allclose(cone.distance(points), [0.03, 0.05, -0.04])
    ball = Ellipsoid(bone="b", centre=np.zeros(3), radii=0.1 * np.ones(3))
    assert np.allclose(ball.distance(np.array([[0.13, 0, 0], [0, 0.1, 0]])), [0.03, 0], atol=1e-9)
    assert (
        len(Blend(parts=(cone, Blend(parts=(ball,), radius=0.01)), radius=0.01).list_solids()) == 2
    )


def test_surface_nets_mesh_a_sphere():
    axis = np.linspace(-0.13, 0.13, 27)
    grid = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1)
    vertices, faces = extract_surface(np.linalg.norm(grid, axis=-1) - 0.1, (axis, axis, axis))
    _, counts = compute_edges(faces)
    assert counts.min() == counts.max() == 2
    assert np.abs(np.linalg.norm(vertices, axis=1) - 0.1).max() < 0.002
    corners = vertices[faces]
    volume = np.einsum("ij,ij->", np.cross(corners[:, 0], corners[:, 1]), corners[:, 2]) / 6
    assert volume == pytest.approx(4 / 3 * np.pi * 0.1**3, rel=0.03)


def test_separate_makes_random_fields_manifold():
    rng = np.random.default_rng(0)
    axes = tuple(np.arange(9.0) for _ in range(3))
    for _ in range(20):
        values = np.pad(rng.normal(size=(7, 7, 7)), 1, constant_values=1.0)
        _, faces = extract_surface(separate(values), axes)
        _, counts = compute_edges(faces)
        assert counts.max() == 2


def _install_fake_smplx(monkeypatch, person: Person) -> None:
    """A stand-in with the attributes of the real library's model, holding a person of ours in its frame."""
    to_theirs = np.array([[1.0, 0, 0], [0, 0, 1.0], [0, -1.0, 0]])
    names = person.skeleton.names
    count = len(person.vertices)
    regressor = np.zeros((len(names), count))
    for k in range(len(names)):
        rows = np.flatnonzero(person.weights[:, k] > 0.1)
        regressor[k, rows] = 1 / len(rows)
    model = types.SimpleNamespace(
        v_template=person.vertices @ to_theirs.T + 0.3,
        shapedirs=np.zeros((count, 3, 10)) + 0.01,
        J_regressor=regressor,
        parents=person.skeleton.parents,
        lbs_weights=person.weights,
        faces=person.faces,
    )
    module = types.ModuleType("smplx")
    module.create = lambda *_args, **_kwargs: model
    joint_names = types.ModuleType("smplx.joint_names")
    joint_names.JOINT_NAMES = [*names, "nose"]
    ids = types.ModuleType("smplx.vertex_ids")
    ids.vertex_ids = {"smplx": {"nose": person.landmarks["nose_tip"], "lindex": 5}}
    for name, value in (
        ("smplx", module),
        ("smplx.joint_names", joint_names),
        ("smplx.vertex_ids", ids),
    ):
        monkeypatch.setitem(sys.modules, name, value)


def test_smplx_is_turned_to_the_person_frame(monkeypatch, tmp_path, people):
    original = people["man"]
    _install_fake_smplx(monkeypatch, original)
    file = tmp_path / "SMPLX_NEUTRAL.npz"
    file.write_bytes(b"")
    person = load_smplx(file)
    moved = person.vertices - original.vertices
    assert np.allclose(moved, moved[0], atol=1e-5)
    assert person.vertices[:, 2].min() == 0
    assert person.landmarks["nose_tip"] == original.landmarks["nose_tip"]
    assert {"head_top", "neck_front", "neck_back"} <= set(person.landmarks)
    turned = person.pose({"left_shoulder_y": -0.5})
    assert np.ptp(turned - person.vertices, axis=0).max() > 0.1
    with pytest.raises(ValueError, match=r"betas must have shape \(S,\) with S <= 10; got \(11,\)"):
        load_smplx(file, betas=np.zeros(11))


def test_what_smplx_lacks_is_named(monkeypatch, tmp_path):
    with pytest.raises(AssetNotFoundError, match=r"no SMPL-X model at .*SMPLX_FEMALE\.npz"):
        load_smplx(tmp_path, gender="female")
    (tmp_path / "smplx").mkdir()
    (tmp_path / "smplx" / "SMPLX_NEUTRAL.npz").write_bytes(b"")
    monkeypatch.setitem(sys.modules, "smplx", None)
    with pytest.raises(AssetError, match="needs the library smplx"):
        load_smplx(tmp_path)


def test_measures_are_keyword_only():
    with pytest.raises(TypeError):
        PersonMeasures(1.7)
