"""An episode reproduces from its file, and one that was changed does not."""

import dataclasses

import numpy as np
import pytest

from dgl_collect import (
    AttemptRequest,
    NotReplayableError,
    read_episode,
)
from dgl_collect.episodes import FINAL_PARTICLES
from dgl_collect.replay import Difference, Replay, replay_episode, replay_in

COMPARED = {
    "garment_point_cloud", "object_point_cloud", "joint_state", "ee_pose", "image",
        "env_point_cloud",
    "action", FINAL_PARTICLES,
}  # fmt: skip


@pytest.mark.render
def test_an_episode_reproduces_from_its_file_to_the_last_bit(recorded, attempts):
    episode = read_episode(recorded)
    frames, steps = [], []
    attempts.env.reset(seed=99)  # what was there before leaves no trace
    replay = replay_in(attempts.env, episode, film=frames.append, on_step=steps.append)
    assert {d.name for d in replay.differences} == COMPARED
    assert [d for d in replay.differences if d.largest] == []
    assert replay.changed_draws == {}
    assert replay.replayed == replay.recorded == (False, episode.success_value)
    assert replay.reproduces()
    assert steps[-1] == replay.steps == len(episode.commands)
    assert len(frames) == -(-replay.steps // 5)
    joints = next(d for d in replay.differences if d.name == "joint_state")
    assert joints.count == episode.stages[0].joint_state.size


@pytest.mark.render
def test_what_was_changed_in_a_file_is_found(recorded, attempts):
    """A command changed on the way, an action that was not sent, and a draw of another garment."""
    episode = read_episode(recorded)
    commands = episode.commands.copy()
    first = episode.stages[0].first_step
    commands[first + 5, 0] += 0.01  # one joint of the left arm for a sixtieth of a second
    action = episode.stages[0].action.copy()
    action[1, 7] += 0.5
    stage = dataclasses.replace(episode.stages[0], action=action)
    draws = {**episode.randomisation, "x": 0.05}
    changed = dataclasses.replace(episode, commands=commands, stages=(stage,), randomisation=draws)
    replay = replay_in(attempts.env, changed)
    largest = {d.name: d.largest for d in replay.differences}
    assert largest["action"] == pytest.approx(0.5, abs=1e-6)
    assert 1e-5 < largest["joint_state"] < 0.01
    assert largest["image"] > 0
    assert replay.changed_draws == {"x": (0.05, episode.randomisation["x"])}
    assert not replay.reproduces()
    assert not replay.reproduces(0.6)  # whatever is tolerated, the draws have to agree


def test_what_an_episode_must_hold(fakes):
    stage = fakes.make_stage(frames=2, cloud_step=0, first_step=4)
    commands = np.zeros((10, 60), np.float32)
    particles = {FINAL_PARTICLES: np.zeros((4, 3), np.float32)}
    whole = fakes.make_episode(stages=(stage,), commands=commands, extra=particles)
    for changes, message in (
        ({"commands": None}, "recorded before they were kept: collect it again"),
        ({"extra": {}}, "must hold extra/final_particles"),
        ({"stages": (fakes.make_stage(),)}, "'left_sleeve' must say when it was seen"),
        ({"commands": commands[:9]}, "must reach step 9 of stage 'left_sleeve'; got 9"),
    ):
        with pytest.raises(NotReplayableError, match=message):
            replay_episode(dataclasses.replace(whole, **changes))


def test_a_tolerance_applies_to_numbers_and_never_to_the_verdict():
    def make(joints=0.0, image=0.0, value=0.9, success=True):
        return Replay(
            task="FoldTops-v1", seed=0, garment_id="a/0", steps=1, changed_draws={},
            differences=(
                Difference(name="joint_state", count=60, largest=joints, unit="rad"),
                Difference(name="image", count=60, largest=image, unit="levels"),
            ),
            recorded=(True, 0.9), replayed=(success, value),
        )  # fmt: skip

    assert make().reproduces()
    assert not make(image=1.0).reproduces()
    assert make(joints=0.01, image=1.0, value=0.905).reproduces(0.01)
    assert not make(joints=0.02).reproduces(0.01)
    assert not make(value=0.8).reproduces(0.01)
    assert not make(success=False).reproduces(1.0)
    with pytest.raises(ValueError, match="tolerance must be at least 0; got -1"):
        make().reproduces(-1.0)


@pytest.mark.slow
@pytest.mark.timeout(1800)
@pytest.mark.render
def test_a_whole_attempt_reproduces(attempts, tmp_path, fine_garments):
    result = attempts.run(AttemptRequest(index=0, seed=0, episode_id="e"), tmp_path)
    episode = read_episode(tmp_path / result.files["episode"])
    replay = replay_episode(episode)  # in an environment of its own
    assert replay.reproduces(), replay
    assert replay.recorded[0]
