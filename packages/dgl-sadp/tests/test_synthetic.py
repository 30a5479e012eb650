import h5py
import numpy as np
import pytest

from dgl_sadp import EpisodeDataset
from dgl_sadp.synthetic import SyntheticEnvironment, SyntheticMatcher, write_synthetic_episodes


@pytest.fixture
def environment():
    return SyntheticEnvironment(points=200, frames=16)


def test_the_expert_reaches_the_points_of_the_affordance(environment):
    for seed in range(5):
        environment.reset(seed=seed)
        assert environment.compute_error() > 0.3
        cloud = environment.see_stage()["garment_point_cloud"]
        found = cloud[environment.get_affordance().argmax(axis=0)]
        np.testing.assert_allclose(found, environment.goals, atol=1e-6)
        for target in environment.make_expert():
            environment.execute(target)
        assert environment.compute_error() < 0.02


def test_the_scene_does_not_show_where_the_hands_should_go(environment):
    environment.reset(seed=3)
    seen = environment.observe()
    places = environment.places
    environment.reset(seed=3, places=-places)
    assert np.linalg.norm(environment.places - places, axis=1).min() > 0.1
    for key, values in environment.observe().items():
        np.testing.assert_array_equal(values, seen[key])


def test_a_seed_gives_the_same_episode(tmp_path):
    first, again = (
        write_synthetic_episodes(tmp_path / name, 2, frames=6, points=40, seed=4)
        for name in ("a", "b")
    )
    assert [path.read_bytes() for path in first] == [path.read_bytes() for path in again]
    assert first[0].read_bytes() != first[1].read_bytes()
    assert len(list((tmp_path / "a").iterdir())) == 2  # Nothing is left beside them.


@pytest.mark.parametrize("has_object", [False, True])
def test_episodes_are_of_the_format_and_hold_the_commanded_targets(tmp_path, has_object):
    (path,) = write_synthetic_episodes(tmp_path, 1, frames=10, points=40, has_object=has_object)
    dataset = EpisodeDataset(tmp_path)
    assert len(dataset) == 10 + 2
    assert ("object_point_cloud" in dataset[0]) == has_object
    with h5py.File(path) as file:
        state, action = file["stage_1/joint_state"][()], file["stage_1/action"][()]
    # Joints go a share of the way to what was commanded.
    np.testing.assert_allclose(state[1:], state[:-1] + 0.6 * (action - state)[:-1], atol=1e-5)
    assert not np.allclose(action[:-1], state[1:], atol=1e-2)


def test_the_matcher_finds_the_same_places_of_other_sheets():
    environment = SyntheticEnvironment(points=2000)
    source, points = environment.see_stage()["garment_point_cloud"], environment.goals
    places = environment.places
    for seed in range(1, 6):
        environment.reset(seed=seed, places=places)
        target = environment.see_stage()["garment_point_cloud"]
        indices, similarity = SyntheticMatcher().match(source, points, target)
        assert similarity.shape == (2, 2000)
        assert (
            np.linalg.norm(target[indices] - environment.goals, axis=1).max() < 0.08
        )  # Of a sheet of 0.8 m.


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: SyntheticEnvironment(points=8), "points must be >= 16"),
        (lambda: SyntheticEnvironment(points=20).execute(np.zeros(59)), r"got \(59,\)"),
        (lambda: write_synthetic_episodes("nowhere", 0), "count must be at least 1; got 0"),
    ],
)
def test_what_makes_no_sense_is_refused(call, message):
    with pytest.raises(ValueError, match=message):
        call()
