"""Whole attempts: the same files for the same seed, and honest failures."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

from dgl_assets.robots import DEFAULT_ROBOT, SIDES
from dgl_collect import AttemptRequest, read_episode
from dgl_collect.actors import Expert
from dgl_collect.attempt import make_attempt_runner
from dgl_collect.demonstration import load_demonstration
from dgl_collect.options import RecordOptions, RunOptions
from dgl_collect.stage_runner import TRIES
from dgl_collect.steps import Approach
from dgl_tasks import get_task
from dgl_tasks.policy import Nothing

joint_slice = DEFAULT_ROBOT.joint_slice

TASK_ID = "FoldTops-v1"


@pytest.fixture(scope="module")
def runner(coarse_garments):
    made = make_attempt_runner(TASK_ID, RecordOptions())
    yield made
    made.close()


def run(runner, folder, *, seed=0):
    folder.mkdir()
    return runner.run(AttemptRequest(index=0, seed=seed, episode_id="episode"), folder)


def reach_high(monkeypatch, runner, **changes):
    """Move the garment cloud 3 m up: attempts fail early, since nothing can be grasped."""
    demonstration = load_demonstration(TASK_ID)
    first = demonstration.stages[0]
    steps = (Approach(height=3.0), *first.steps[1:])
    demonstration = dataclasses.replace(
        demonstration, stages=(dataclasses.replace(first, steps=steps),)
    )
    setup = dataclasses.replace(runner._setup, demonstration=demonstration, **changes)
    monkeypatch.setattr(runner, "_setup", setup)
    monkeypatch.setattr(runner, "_method", setup.make_runner(Expert()))
    return setup


def test_wrong_options_are_refused():
    refused = {
        "garment must be .*got ''": {"garment": ""},
        "garment should be a valid string; got 7": {"garment": 7},
        "rounds should be greater than or equal to 1; got 0": {"rounds": 0},
        "matcher should be 'exact' or 'gam'; got 'magic'": {"matcher": "magic"},
        "record should be 'stages' or 'approaches'; got 'all'": {"record": "all"},
        "robots should be an instance of Path; got 3": {"robots": 3},
    }
    for text, options in refused.items():
        with pytest.raises(ValueError, match=text):
            RecordOptions(**options)
    with pytest.raises(ValueError, match="speed"):
        RecordOptions.from_plain({"speed": 2})


def test_options_are_recorded_and_read_again():
    assert RecordOptions().to_plain() == {}
    options = RecordOptions(garment="a", rounds=2, robots=Path("r"), record="approaches")
    plain = options.to_plain()
    assert plain == {"garment": "a", "rounds": 2, "robots": "r", "record": "approaches"}
    assert RecordOptions.from_plain(json.loads(json.dumps(plain))) == options


@pytest.mark.render
def test_what_is_out_of_reach_fails_with_its_reason_and_leaves_film_and_picture(
    runner, tmp_path, monkeypatch
):
    garment = "Tops_LongSleeve/001294"
    reach_high(monkeypatch, runner, options=RecordOptions(garment=garment))
    result = run(runner, tmp_path / "far")
    assert not result.success
    assert result.value is None
    assert result.reason == "unreachable"
    assert "left arm cannot reach" in result.detail
    assert set(result.files) == {"video", "picture"}
    for name in result.files.values():
        assert (tmp_path / "far" / name).stat().st_size > 1000
    assert result.garment_id == result.randomisation["garment"] == garment
    assert result.frames == 0


@pytest.mark.render
def test_a_matcher_is_asked_for_the_demonstrations_points(runner, tmp_path, monkeypatch):
    asked = []

    class Recorder:
        """Takes points far apart."""

        def match(self, source_cloud, source_points, target_cloud):
            asked.append((source_cloud, source_points))
            count = len(source_points)
            indices = np.linspace(0, len(target_cloud) - 1, count).astype(np.int64)
            return indices, np.zeros((count, len(target_cloud)), np.float32)

    setup = reach_high(monkeypatch, runner, find_matcher=lambda env: Recorder())
    assert run(runner, tmp_path / "asked").reason == "unreachable"
    cloud, points = asked[0]
    np.testing.assert_array_equal(cloud, setup.demo_cloud)
    np.testing.assert_array_equal(points, list(setup.demonstration.points.values()))


def test_the_rounds_can_be_chosen(runner):
    assert runner._method.rounds is None
    setup = dataclasses.replace(runner._setup, options=RunOptions(rounds=2))
    assert setup.make_runner(Expert()).rounds == 2
    assert setup.make_runner(Expert(), rounds=1).rounds == 1


@pytest.mark.render
def test_a_method_that_does_nothing_is_judged_by_what_is_true(runner, tmp_path, monkeypatch):
    monkeypatch.setattr(runner, "_method", Nothing())
    result = run(runner, tmp_path / "nothing")
    assert not result.success
    assert not result.first_try
    assert 0 <= result.value < 0.85
    assert result.reason == "below the threshold"
    assert result.beliefs == {}
    assert result.measurements["steps"] > 0
    assert set(result.files) == {"video", "picture"}


def test_what_an_environment_is_the_environment_of_cannot_be_changed(runner):
    with pytest.raises(AttributeError):
        runner.env.task = get_task("FoldDress-v1")


@pytest.mark.slow
@pytest.mark.timeout(1800)
@pytest.mark.render
def test_equal_seeds_give_equal_files(runner, tmp_path, fine_garments):
    first, second = (run(runner, tmp_path / name) for name in ("first", "second"))
    assert first.success, (first.reason, first.detail)
    assert first.value == second.value >= 0.85
    for name in first.files.values():
        one, other = (tmp_path / folder / name for folder in ("first", "second"))
        assert one.read_bytes() == other.read_bytes(), name
    check_episode(read_episode(tmp_path / "first" / first.files["episode"]), first)


def check_episode(episode, result):
    """Recorded stages are complete, in order, each from open hand to open hand."""
    stages = load_demonstration(TASK_ID).stages
    assert [stage.name for stage in episode.stages] == [stage.name for stage in stages]
    assert episode.success
    assert episode.success_value == result.value
    assert sum(stage.frame_count for stage in episode.stages) == result.frames
    for declared, stage in zip(stages, episode.stages, strict=True):
        assert stage.frame_count >= 15
        # commanded and measured joints agree but for the lag of the drives
        arms = np.r_[tuple(joint_slice(side, "arm") for side in SIDES)]
        assert np.abs(stage.action - stage.joint_state)[:, arms].max() < 0.35
        # the channels peak where the hands took hold
        for column, side in enumerate(SIDES):
            if side in declared.grasp:
                best = stage.points_affordance_feature[:, column].argmax()
                points = [stage.points[n]["xyz"] for n in declared.grasp[side].points]
                gap = stage.garment_point_cloud[best][:2] - np.mean(points, axis=0)[:2]
                assert np.linalg.norm(gap) < 0.15


@pytest.mark.slow
@pytest.mark.timeout(1800)
@pytest.mark.render
def test_without_friction_and_adhesion_nothing_is_carried(
    runner, tmp_path, monkeypatch, fine_garments
):
    task = get_task(TASK_ID)
    material = dataclasses.replace(task.material, friction=0.0, adhesion=0.0)
    # the environment reads it at each reset
    monkeypatch.setattr(runner.env, "_task", dataclasses.replace(task, material=material))
    result = run(runner, tmp_path / "slippery")
    assert not result.success
    # fingers may shovel cloth up by a few centimetres, or in several tries away from where it lay,
    # but not carry it
    assert result.reason in ("missed grasp", "slipped", "perception"), result.detail
    # the first stage was begun again as often as can be: the hand was seen to hold nothing each
    # time
    assert result.measurements["further_tries"] >= TRIES - 1
    assert "episode" not in result.files
