"""Facts about people."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import ConvexHull, KDTree
from scipy.spatial.transform import Rotation

from dgl_assets.garments.meshing import compute_edges
from dgl_assets.people import (
    PEOPLE,
    POSES,
    Person,
    PersonMeasures,
    make_person,
    sample_person,
)
from dgl_assets.people import person as person_module
from dgl_assets.people.skeleton import make_joints
from dgl_assets.people.solids import Blend, Cone, Ellipsoid
from dgl_assets.people.surface_nets import extract_surface, separate


@pytest.fixture(scope="module", params=["one", pytest.param("five", marks=pytest.mark.slow)])
def people(request, woman) -> dict[str, Person]:
    """A woman at 0.85; the heaviest and the smallest of the table, too, in slow tests."""
    if request.param == "one":
        return {"woman": woman}
    others = ("man", "heavy_man", "child_8", "child_5")
    return {"woman": woman} | {name: make_person(name, scale=0.85) for name in others}


def _measure_volume(person: Person) -> float:
    corners = person.vertices[person.faces].astype(np.float64)
    return np.einsum("ij,ij->", np.cross(corners[:, 0], corners[:, 1]), corners[:, 2]) / 6


def test_the_skin_is_one_closed_manifold(people):
    for person in people.values():
        edges, counts = compute_edges(person.faces)
        assert counts.min() == counts.max() == 2
        half_edges = np.concatenate(
            [person.faces[:, [0, 1]], person.faces[:, [1, 2]], person.faces[:, [2, 0]]]
        )
        assert len(np.unique(half_edges, axis=0)) == len(half_edges)
        assert len(person.vertices) - len(edges) + len(person.faces) == 2  # a sphere
        assert _measure_volume(person) > 0  # outward


def test_volume_is_that_of_a_body(people):
    """People weigh about a kilogram a litre; means are 80 to 86 kg, 68 to 73 kg and 26 kg."""
    for name, low, high in (("man", 65, 100), ("woman", 55, 85), ("child_8", 20, 34)):
        if name in people:
            assert low < 1000 * _measure_volume(people[name]) / 0.85**3 < high


def test_measures_are_kept(people):
    for name, person in people.items():
        m = PEOPLE[name]
        assert person.vertices[:, 2].max() == pytest.approx(0.85 * m.stature, rel=0.005)
        assert person.vertices[:, 2].min() == 0
        for level, girth, bones, tolerance in (
            (person.frames["brow"][1][2, 3], m.head_girth, ("head",), 0.05),
            (person.frames["neck"][1][2, 3], m.neck_girth, ("neck",), 0.06),
        ):
            ids = [person.skeleton.names.index(bone) for bone in bones]
            near = np.abs(person.vertices[:, 2] - level) < 0.007
            near &= person.weights[:, ids].sum(axis=1) > 0.5
            hull = ConvexHull(person.vertices[near, :2].astype(np.float64))
            assert hull.area == pytest.approx(
                0.85 * girth, rel=tolerance
            )  # in the plane: the girth


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


def test_bones_keep_their_lengths(woman):
    person = woman
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


def test_motions_go_where_their_names_say(woman):
    person = woman
    arms = {f"{side}_shoulder_abduction": 0.0 for side in ("left", "right")}
    names = ("left_middle_tip", "right_middle_tip", "head_top", "left_toe_tip")
    start = person.get_landmark_positions(names, arms)
    assert start[0, 0] > 0 > start[1, 0]  # its own left is +x

    def moved(angles):
        return person.get_landmark_positions(names, arms | angles) - start

    assert moved({"left_shoulder_flexion": 1.5})[0, 1] < -0.4  # forward
    assert moved({"right_shoulder_flexion": 1.5})[1, 1] < -0.4
    assert moved({"left_shoulder_abduction": 1.5})[0, 0] > 0.35  # outward
    assert moved({"right_shoulder_abduction": 1.5})[1, 0] < -0.35
    assert moved({"left_elbow_flexion": 1.5})[0, 1] < -0.2
    assert moved({"left_wrist_flexion": 1.0})[0, 0] < -0.08  # towards the palm, which faces inward
    assert moved({"right_wrist_flexion": 1.0})[1, 0] > 0.08
    assert moved({"left_middle1_flexion": 1.2})[0, 0] < -0.025
    assert moved({"chest_flexion": 0.5})[2, 1] < -0.08
    assert moved({"head_bending": 0.3})[2, 0] > 0.025
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


def test_frames_move_with_their_bones(woman):
    person = woman
    rest, there = person.compute_frames(), person.compute_frames("reach_right")
    assert np.allclose(rest["head_top"][1], [1, 0, 0, 0])
    assert np.allclose(rest["neck"][0], there["neck"][0])
    place, (w, x, y, z) = there["right_hand"]
    assert place[1] < -0.3
    along = np.array([1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)])
    out = np.array([2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)])
    assert along[1] < -0.95  # fingers to the front
    assert out[2] < -0.9  # palm down
    skin = person.pose("reach_right")
    tip = skin[person.landmarks["right_middle_tip"]]
    assert (tip - place) @ along > 0.06
    assert np.linalg.norm(there["right_middle_tip"][0] - tip) < 0.01
    assert -0.1 < (there["right_wrist"][0] - place) @ along < -0.03
    shoulder, acromion = there["right_shoulder"][0], skin[person.landmarks["right_acromion"]]
    assert np.linalg.norm(shoulder - acromion) < 0.05


def test_who_offers_a_hand_lets_it_hang_beside_the_body(woman):
    frames = woman.compute_frames("offer_right")
    place, quaternion = frames["right_hand"]
    along, out, _ = Rotation.from_quat(quaternion, scalar_first=True).as_matrix().T
    assert along[2] < -0.999  # fingers down
    assert out[0] > 0.999  # palm to the body
    for digit in ("index", "middle", "ring", "little"):
        assert (frames[f"right_{digit}_tip"][0] - frames["right_wrist"][0])[2] < -0.1
    trunk = woman.landmarks["right_acromion"]
    assert place[0] < woman.pose("offer_right")[trunk][0] - 0.2


def test_capsules_fill_the_body(people):
    for person in people.values():
        for pose in ("rest", "standing"):
            ends, radii = person.compute_capsules(pose)
            skin = person.pose(pose)[::7]
            along = ends[:, 1] - ends[:, 0]
            offset = skin[:, None] - ends[None, :, 0]
            share = (offset * along).sum(axis=2) / np.maximum((along**2).sum(axis=1), 1e-12)
            near = offset - np.clip(share, 0, 1)[..., None] * along
            depth = (np.linalg.norm(near, axis=2) - radii).min(axis=1)
            assert np.quantile(np.abs(depth), 0.9) < 0.03
            assert depth.max() < 0.06


def test_poses_keep_the_skin_in_one_piece(woman):
    edges, _ = compute_edges(woman.faces)
    rest = np.linalg.norm(woman.vertices[edges[:, 0]] - woman.vertices[edges[:, 1]], axis=1)
    for pose in POSES:
        skin = woman.pose(pose)
        length = np.linalg.norm(skin[edges[:, 0]] - skin[edges[:, 1]], axis=1)
        assert np.quantile(length / rest, 0.99) < 1.8, pose
        assert length.max() < 0.05, pose


def test_scale_scales_everything(woman, monkeypatch):
    whole_skin = woman.vertices.astype(np.float64) / 0.85
    monkeypatch.setattr(person_module, "make_skin", lambda _: (whole_skin, woman.faces))
    monkeypatch.setattr(person_module, "compute_weights", lambda *_: woman.weights)
    small = make_person("woman", scale=0.34)
    assert small.landmarks == woman.landmarks
    assert np.allclose(small.pose("standing"), 0.4 * woman.pose("standing"), atol=1e-5)
    for name, (origin, turn) in small.compute_frames("reach_right").items():
        expected = woman.compute_frames("reach_right")[name]
        assert np.allclose(origin, 0.4 * expected[0], atol=1e-6)
        assert np.allclose(turn, expected[1])
    for ours, theirs in zip(small.compute_capsules(), woman.compute_capsules(), strict=True):
        assert np.allclose(ours, 0.4 * theirs)


def test_random_people_differ_and_repeat():
    drawn = [sample_person(seed) for seed in range(200)]
    assert drawn[3] == sample_person(np.random.default_rng(3))
    ratios = [m.waist_girth / m.stature for m in drawn]
    assert max(ratios) / min(ratios) > 1.4


@pytest.mark.slow
def test_a_random_person_can_be_made():
    person = make_person(sample_person(11))
    assert len(person.vertices) > 10_000


def test_wrong_poses_are_refused(woman, find_unrefused):
    rows = [
        (lambda: woman.pose("sitting"), r"pose must be one of .*; got 'sitting'"),
        (
            lambda: woman.pose({"left_elbow_twist": 0.1}),
            r"unknown motions \['left_elbow_twist'\]",
        ),
        (
            lambda: woman.pose({"left_knee_flexion": -0.5}),
            r"left_knee_flexion must be in .* got -0\.500",
        ),
        (lambda: replace(woman, weights=0.5 * woman.weights), "sum to 1"),
        (lambda: replace(woman, weights=woman.weights[:, :3]), "weights must have shape"),
    ]
    assert find_unrefused(rows) == []
    with pytest.raises(KeyError, match="unknown landmarks"):
        woman.get_landmark_positions(("tail",))


def test_wrong_measures_are_refused(find_unrefused):
    man = PEOPLE["man"]
    rows = [
        (lambda: make_person("giant"), "got 'giant'"),
        (lambda: make_person("man", scale=2), r"scale must be in \[0\.3, 1\.5\]; got 2"),
        (lambda: replace(man, stature=3.0), "stature must be in"),
        (lambda: replace(man, crotch_height=0.6), "crotch_height must be 0"),
        (lambda: replace(man, shoulder_height=1.2), "shoulder_height must be 0"),
        (lambda: replace(man, shoulder_height=1.50, head_girth=0.63), "room for neck and head"),
    ]
    assert find_unrefused(rows) == []
    with pytest.raises(TypeError):
        PersonMeasures(1.7)


def test_limits_are_ordered_and_contain_the_rest():
    for joint in make_joints():
        for motion in joint.motions:
            assert motion.low <= motion.rest <= motion.high
            assert motion.low <= 0 <= motion.high


def test_solids_measure_distance():
    cone = Cone("b", np.zeros(3), np.array([0, 0, 0.2]), (0.05, 0.05))
    points = np.array([[0.08, 0, 0.1], [0, 0, 0.3], [0.01, 0, 0.1]])
    assert np.allclose(cone.distance(points), [0.03, 0.05, -0.04])
    ball = Ellipsoid("b", np.zeros(3), 0.1 * np.ones(3))
    assert np.allclose(ball.distance(np.array([[0.13, 0, 0], [0, 0.1, 0]])), [0.03, 0], atol=1e-9)
    assert len(Blend(0.01, [cone, Blend(0.01, [ball])]).list_solids()) == 2


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
