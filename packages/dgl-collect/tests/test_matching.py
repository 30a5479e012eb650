"""The exact matcher: the same places on other garments, wherever those lie."""

import numpy as np
import pytest

from dgl_assets import load_garment
from dgl_collect.demonstration import load_demonstration
from dgl_collect.matching import ExactMatcher, make_find_matcher
from dgl_gam import GarmentAffordanceModel, Matcher
from dgl_tasks.coverage import sample_visible_surface

DEMONSTRATION = load_demonstration("FoldTops-v1")
OTHERS = ("Tops_LongSleeve/000001", "Tops_LongSleeve/000042", "Tops_LongSleeve/008123")
NAMES = tuple(DEMONSTRATION.points)
POINTS = np.array([DEMONSTRATION.points[name] for name in NAMES])
# Landmarks of the same places; the chest points are named differently on the garment.
LANDMARKS = {"left_chest": "left_upper_chest", "right_chest": "right_upper_chest"}


@pytest.fixture(scope="module")
def source():
    return load_garment(DEMONSTRATION.garment)


def move(points, *, degrees=0.0, shift=(0.0, 0.0, 0.0)):
    a = np.radians(degrees)
    R = np.array([[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1]])
    return points @ R.T + np.array(shift)


def place(garment, **pose):
    return move(garment.vertices, **pose)


def match(source, target, particles):
    cloud = sample_visible_surface(particles, target.faces)
    matcher: Matcher = ExactMatcher(source, target, particles)
    indices, similarity = matcher.match(source.vertices, POINTS, cloud)
    return cloud, indices, similarity


def test_it_is_a_matcher(source):
    assert isinstance(ExactMatcher(source, source, source.vertices), Matcher)


def test_on_its_own_garment_it_finds_the_marked_points(source):
    cloud, indices, similarity = match(source, source, place(source))
    assert indices.shape == (len(NAMES),)
    assert np.issubdtype(indices.dtype, np.integer)
    assert similarity.shape == (len(NAMES), len(cloud))
    assert similarity.dtype == np.float32
    assert np.linalg.norm(cloud[indices] - POINTS, axis=1).max() < 0.015
    np.testing.assert_array_equal(similarity.argmax(axis=1), indices)
    assert similarity.min() >= 0
    assert similarity.max() <= 1
    assert similarity.max(axis=1).min() > 0.95


@pytest.mark.parametrize("garment_id", OTHERS)
@pytest.mark.parametrize(
    ("degrees", "shift"), [(0.0, (0.0, 0.0, 0.0)), (130.0, (0.08, 0.85, 0.01))]
)
def test_on_another_garment_it_finds_the_landmarks(source, garment_id, degrees, shift):
    target = load_garment(garment_id)
    particles = place(target, degrees=degrees, shift=shift)
    cloud, indices, _ = match(source, target, particles)
    for name, index in zip(NAMES, indices, strict=True):
        landmark = particles[target.landmarks[LANDMARKS.get(name, name)]]
        assert np.linalg.norm(cloud[index] - landmark) < 0.025, name


def test_the_match_does_not_depend_on_where_the_garment_lies(source):
    target = load_garment(OTHERS[0])
    cloud, indices, similarity = match(source, target, place(target))
    pose = {"degrees": -75.0, "shift": (0.1, 0.7, 0.0)}
    matcher = ExactMatcher(source, target, place(target, **pose))
    again, same = matcher.match(source.vertices, POINTS, move(cloud, **pose))
    # points that are equally near to two particles may change places by rounding
    assert np.linalg.norm(cloud[indices] - cloud[again], axis=1).max() < 0.01
    assert np.abs(similarity - same).mean() < 0.005


def test_a_folded_garment_is_matched_by_its_cloth_not_by_its_outline(source):
    """The left half is folded onto the right: the left cuff is found where its particles are."""
    target = load_garment(OTHERS[0])
    folded = place(target)
    left = folded[:, 0] < 0
    folded[left, 0] *= -1
    folded[left, 2] += 0.03
    cloud, indices, _ = match(source, target, folded)
    found = cloud[indices[NAMES.index("left_cuff")]]
    landmark = folded[target.landmarks["left_cuff"]]
    assert found[0] > 0.2
    assert np.linalg.norm(found[:2] - landmark[:2]) < 0.03


def test_similarity_falls_with_the_distance_on_the_garment(source):
    cloud, indices, similarity = match(source, source, place(source))
    cuff = NAMES.index("left_cuff")
    distance = np.linalg.norm(cloud - cloud[indices[cuff]], axis=1)
    near = similarity[cuff][np.abs(distance - ExactMatcher.SIMILARITY_SCALE) < 0.003]
    assert near.mean() == pytest.approx(np.exp(-0.5), abs=0.1)
    assert similarity[cuff][distance > 0.4].max() < 1e-3


def test_particles_of_another_garment_are_refused(source):
    target = load_garment(OTHERS[0])
    with pytest.raises(ValueError, match=r"target_particles must have shape \(\d+, 3\); got"):
        ExactMatcher(source, target, source.vertices[:-1])


class FakeEnv:
    """As much of an environment as a matcher looks at."""

    def __init__(self, garment):
        self.garment = garment

    def get_particles(self):
        return self.garment.vertices


def test_the_exact_matcher_is_made_for_the_garment_of_the_environment(source):
    find = make_find_matcher("exact", source)
    for name in OTHERS[:2]:
        garment = load_garment(name)
        found = find(FakeEnv(garment)).match(source.vertices, POINTS, garment.vertices)
        wanted = ExactMatcher(source, garment, garment.vertices).match(
            source.vertices, POINTS, garment.vertices
        )
        for a, b in zip(found, wanted, strict=True):
            np.testing.assert_array_equal(a, b)


def test_the_learned_matcher_is_loaded_once_for_the_category(source, monkeypatch):
    asked = []

    def load(category):
        asked.append(category)
        return object()

    monkeypatch.setattr(GarmentAffordanceModel, "load", load)
    find = make_find_matcher("gam", source)
    assert find(FakeEnv(source)) is find(FakeEnv(load_garment(OTHERS[0])))
    assert asked == ["Tops_LongSleeve"]


def test_the_learned_matcher_finds_points_in_clouds(source):
    matcher = make_find_matcher("gam", source)(FakeEnv(source))
    assert isinstance(matcher, GarmentAffordanceModel)
    assert isinstance(matcher, Matcher)
    assert matcher.category == "Tops_LongSleeve"


def test_an_unknown_matcher_is_refused(source):
    with pytest.raises(ValueError, match=r"matcher must be one of \['exact', 'gam'\]; got 'gan'"):
        make_find_matcher("gan", source)
