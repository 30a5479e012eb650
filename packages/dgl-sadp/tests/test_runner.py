import dataclasses

import numpy as np
import pytest
import torch

from dgl_sadp import DiffusionPolicy, ObservationError, PolicyRunner
from dgl_sadp.normalizer import Range


def make_observation(number: int = 0, points: int = 50) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(number)
    return {
        "joint_state": np.full(60, number, np.float32),
        "env_point_cloud": rng.uniform(-1, 1, (points, 6)),
        "image": rng.integers(0, 256, (40, 48, 3), dtype=np.uint8),
        "garment_point_cloud": rng.uniform(-1, 1, (points, 3)),
        "points_affordance_feature": rng.uniform(0, 1, (points, 2)),
        "object_point_cloud": rng.uniform(-1, 1, (points, 3)),
        "ee_pose": np.zeros((2, 7)),
    }


@pytest.fixture
def runner(method, tiny_config):
    return PolicyRunner(DiffusionPolicy.make(tiny_config(method), seed=0), seed=3)


@pytest.fixture
def queue(tiny_config, monkeypatch):
    """Make a runner that notes the joint states of each prediction."""
    policy = DiffusionPolicy.make(tiny_config("dp3"), seed=0)
    seen = []
    original = policy.predict
    monkeypatch.setattr(
        policy,
        "predict",
        lambda observation, *others: (
            seen.append(observation["joint_state"][0, :, 0].tolist())
            or original(observation, *others)
        ),
    )
    return PolicyRunner(policy), seen


def run_chunks(runner, chunks, *, seed=None):
    """Run chunks, counting observations; return all targets."""
    runner.reset(make_observation(), seed=seed)
    number, targets = 0, []
    for _ in range(chunks):
        targets.append(runner.act(make_observation(number)))
        for _ in range(3):
            number += 1
            runner.observe(make_observation(number))
        number += 1
    return np.stack(targets)


def test_each_observation_enters_the_queue_once(queue):
    runner, seen = queue
    run_chunks(runner, 4)
    # The first stands for those before it; then consecutive frames, up to the newest.
    assert seen == [[0, 0, 0], [2, 3, 4], [6, 7, 8], [10, 11, 12]]


def test_windows_are_those_of_training(queue, tmp_path, make_episode):
    from dgl_sadp import EpisodeDataset

    runner, seen = queue
    run_chunks(runner, 3)
    make_episode(tmp_path / "0.h5", frames=20)  # Its joint states count the frames too.
    known = [window["joint_state"][:, 0].tolist() for window in EpisodeDataset(tmp_path)]
    assert all(window in known for window in seen)


def test_a_reset_forgets(queue):
    runner, seen = queue
    run_chunks(runner, 2)
    runner.reset(make_observation())
    runner.act(make_observation(7))
    assert seen[-1] == [7, 7, 7]


def test_targets_are_those_with_the_indices_two_to_five(method, tiny_config, monkeypatch):
    policy = DiffusionPolicy.make(tiny_config(method), seed=0)
    chunk = torch.arange(8.0).reshape(1, 8, 1).expand(1, 8, 60)
    monkeypatch.setattr(policy, "predict", lambda *_: chunk)
    runner = PolicyRunner(policy)
    runner.reset(make_observation())
    targets = runner.act(make_observation())
    assert targets.shape == (4, 60)
    assert targets.dtype == np.float32
    assert targets[:, 0].tolist() == [2, 3, 4, 5]


def test_the_seed_decides(runner):
    first, again = run_chunks(runner, 2, seed=1), run_chunks(runner, 2, seed=1)
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, run_chunks(runner, 2, seed=2))
    np.testing.assert_array_equal(run_chunks(runner, 2), run_chunks(runner, 2, seed=3))
    assert not np.array_equal(first[0], first[1])


@pytest.mark.parametrize("points", [1, 7, 300])
def test_clouds_may_have_any_number_of_points(runner, points):
    runner.reset(make_observation(points=points))
    targets = runner.act(make_observation(points=points))
    assert np.isfinite(targets).all()
    for count in (points + 1, 2, 90):  # ... and another one in each observation.
        runner.observe(make_observation(points=count))
    assert np.isfinite(runner.act(make_observation(points=points))).all()


def test_observations_are_copied(runner):
    wanted = run_chunks(runner, 2)
    runner.reset(make_observation())
    observation = make_observation(0)
    runner.act(observation)
    for number in range(1, 4):
        fresh = make_observation(number)
        for key, array in observation.items():
            array[:] = fresh[key]
        runner.observe(observation)
    np.testing.assert_array_equal(runner.act(make_observation(4)), wanted[1])


def test_the_stage_is_encoded_at_its_beginning_only(tiny_config, monkeypatch):
    policy = DiffusionPolicy.make(tiny_config("sadp"), seed=0)
    calls = []
    original = policy.encoder.encode_stage
    monkeypatch.setattr(
        policy.encoder, "encode_stage", lambda *a, **k: calls.append(1) or original(*a, **k)
    )
    run_chunks(PolicyRunner(policy), 3)
    assert len(calls) == 1


def test_targets_are_in_radians_of_the_data(tiny_config):
    policy = DiffusionPolicy.make(tiny_config("dp3", relative_joints=()), seed=0)
    policy.normalizer.of("action").fit(Range(np.full(60, 5.0), np.full(60, 6.0)))
    targets = run_chunks(PolicyRunner(policy), 2)
    assert (targets > 4.99).all()
    assert (targets < 6.01).all()


def test_each_stage_begins_where_the_arms_are_when_it_first_acts(tiny_config):
    policy = DiffusionPolicy.make(tiny_config("dp3"), seed=0)
    policy.normalizer.of("action").fit(Range(np.zeros(60), np.zeros(60)))  # arms that never moved
    runner = PolicyRunner(policy)
    arms = [*range(6), *range(30, 36)]
    for start in (0.5, -1.0):
        runner.reset({})
        for later in (0.0, 0.3):  # pushed away, they go back
            seen = {**make_observation(), "joint_state": np.full(60, start + later, np.float32)}
            targets = runner.act(seen)
            assert (targets[:, arms] == np.float32(start)).all()
            assert not np.delete(targets, arms, axis=1).any()
            for _ in targets[:-1]:
                runner.observe(seen)


def _without(key):
    return lambda o: o.pop(key)


def _set(key, value):
    return lambda o: o.update({key: value})


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (_without("joint_state"), r"must have \['joint_state', 'env_point_cloud'\]; missing"),
        (_set("joint_state", np.zeros(59)), r"joint_state must have shape \(60,\); got \(59,\)"),
        (_set("joint_state", np.full(60, np.nan)), "joint_state must be finite"),
        (_set("joint_state", np.array(["x"] * 60)), "joint_state must be numbers"),
        (_set("env_point_cloud", np.zeros((0, 6))), r"\('any', 6\); got \(0, 6\)"),
        (_set("env_point_cloud", np.zeros((5, 4))), r"\('any', 6\); got \(5, 4\)"),
        (_set("env_point_cloud", np.full((5, 6), np.inf)), "env_point_cloud must be finite"),
    ],
)
def test_bad_observations_are_refused_and_not_remembered(tiny_config, change, message):
    runner = PolicyRunner(DiffusionPolicy.make(tiny_config("sadp"), seed=0))
    runner.reset(make_observation())
    observation = make_observation()
    change(observation)
    with pytest.raises(ObservationError, match=message):
        runner.act(observation)
    assert np.isfinite(runner.act(make_observation())).all()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (_without("object_point_cloud"), "missing .*object_point_cloud"),
        (_set("garment_point_cloud", np.zeros((50, 6))), r"must have shape \('any', 3\)"),
        (_set("garment_point_cloud", np.zeros((49, 3))), "each of the 49 garment points; got 50"),
        (_set("points_affordance_feature", np.full((50, 2), np.nan)), "must be finite"),
    ],
)
def test_bad_stages_are_refused(tiny_config, change, message):
    runner = PolicyRunner(DiffusionPolicy.make(tiny_config("sadp"), seed=0))
    observation = make_observation()
    change(observation)
    with pytest.raises(ObservationError, match=message):
        runner.reset(observation)


def test_a_runner_tells_the_policy_its_stage(tiny_config):
    policy = DiffusionPolicy.make(tiny_config("dp3", stages=3), seed=0)
    chunks = []
    for stage in (1, 2, 3):
        runner = PolicyRunner(policy, stage=stage)
        runner.reset({}, seed=5)
        chunks.append(runner.act(make_observation()))
    assert len({chunk.tobytes() for chunk in chunks}) == 3
    seen, predict = [], policy.predict
    policy.predict = lambda batch, *rest: (
        seen.append(batch["stage"].tolist()) or predict(batch, *rest)
    )
    runner.reset({})
    runner.act(make_observation())
    assert seen == [[2]]  # from 0, as in training
    for stage in (0, 4):
        with pytest.raises(ValueError, match=rf"stage must lie in 1 ... 3; got {stage}"):
            PolicyRunner(policy, stage=stage)


def test_pictures_must_be_bytes(tiny_config):
    runner = PolicyRunner(DiffusionPolicy.make(tiny_config("dp"), seed=0))
    runner.reset({})
    with pytest.raises(ObservationError, match="image must be uint8; got float64"):
        runner.act({**make_observation(), "image": np.zeros((40, 48, 3))})


def test_colour_must_be_there_if_it_is_seen(tiny_config):
    config = tiny_config("dp3")
    seen = dataclasses.replace(config.environment, use_color=True)
    runner = PolicyRunner(
        DiffusionPolicy.make(dataclasses.replace(config, environment=seen), seed=0)
    )
    runner.reset({})
    observation = {**make_observation(), "env_point_cloud": np.zeros((5, 3))}
    with pytest.raises(ObservationError, match=r"must have 6 channels; got shape \(5, 3\)"):
        runner.act(observation)


@pytest.mark.parametrize("given", [0, 1, 2])
def test_an_observation_for_each_target_is_demanded(runner, given):
    runner.reset(make_observation())
    runner.act(make_observation())
    for _ in range(given):
        runner.observe(make_observation())
    with pytest.raises(ObservationError, match=f"each of the 4 .* got {given} by observe"):
        runner.act(make_observation())


def test_no_more_observations_than_targets_are_taken(runner):
    runner.reset(make_observation())
    runner.act(make_observation())
    for _ in range(4):
        runner.observe(make_observation())
    with pytest.raises(ObservationError, match="got more than 4"):
        runner.observe(make_observation())


def test_a_stage_must_be_begun(runner):
    with pytest.raises(RuntimeError, match="reset must be called"):
        runner.act(make_observation())
