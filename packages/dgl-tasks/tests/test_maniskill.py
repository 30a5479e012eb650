"""ManiSkill's and Gymnasium's own wrappers and tools work with the tasks."""

import dataclasses
import subprocess
import sys
import warnings

import gymnasium
import h5py
import numpy as np
import pytest
import torch
from mani_skill.utils.wrappers import RecordEpisode
from mani_skill.vector.wrappers.gymnasium import ManiSkillVectorEnv

import dgl_tasks

pytestmark = pytest.mark.usefixtures("coarse_garments")
TASK = dgl_tasks.get_task("FoldTops-v1")
HARDLY_SETTLED = dataclasses.replace(TASK, start=dataclasses.replace(TASK.start, settle_frames=2))


def make(**changes):
    given = {"task": HARDLY_SETTLED, "obs_mode": "state", "render_backend": "none"}
    return gymnasium.make("FoldTops-v1", **(given | {"reconfiguration_freq": 0} | changes))


def hold(env):
    """The action that leaves the robot where it is."""
    return env.unwrapped.agent.read_joints()


@pytest.mark.parametrize("auto_reset", [False, True])
def test_maniskills_vector_environment_ends_episodes_in_time(auto_reset):
    env = ManiSkillVectorEnv(
        make(max_episode_steps=2),
        auto_reset=auto_reset,
        ignore_terminations=True,
        record_metrics=True,
    )
    env.reset(seed=0)
    ends = []
    for _ in range(4):
        *_, terminated, truncated, info = env.step(hold(env.base_env))
        assert terminated.shape == truncated.shape == (1,)
        assert not terminated.any()
        ends.append(bool(truncated[0]))
        final = info["final_info"] if auto_reset and ends[-1] else info
        assert final["episode"]["episode_len"] == len(ends) % 2 or ends[-1]
    assert ends == ([False, True] * 2 if auto_reset else [False, True, True, True])
    env.close()


@pytest.mark.parametrize(("limit", "expected"), [(2, [False, True]), (None, [False, False])])
def test_gymnasiums_time_limit_is_kept_as_a_tensor(limit, expected):
    env = make(max_episode_steps=limit)
    env.reset(seed=0)
    ends = [env.step(hold(env))[3] for _ in range(2)]
    assert all(isinstance(end, torch.Tensor) and end.dtype == torch.bool for end in ends)
    assert [end.tolist() for end in ends] == [[end] for end in expected]
    env.close()


def test_an_environment_is_made_again_from_its_specification():
    env = make(max_episode_steps=2)
    assert env.spec.id == "dgl_tasks:FoldTops-v1"  # found by processes that have not imported us
    again = gymnasium.make(env.spec)
    assert str(again) == str(env)
    for made in (env, again):
        made.close()


def record(env, folder):
    """Record two steps by ManiSkill's wrapper; return the file."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # ManiSkill calls `Logger.warn`
        recorder = RecordEpisode(env, str(folder), trajectory_name="short", save_video=False)
    recorder.reset(seed=0)
    action = hold(env)
    for k in range(2):
        recorder.step(action + np.float32(0.02 * (k + 1)))
    recorder.close()
    return folder / "short.h5"


@pytest.mark.slow
def test_maniskill_replays_its_recording_in_a_process_of_its_own(tmp_path, fine_garments):
    env = gymnasium.make(
        "FoldTops-v1", obs_mode="state", render_backend="none", max_episode_steps=2
    )
    recording = record(env, tmp_path)
    command = [sys.executable, "-m", "mani_skill.trajectory.replay_trajectory"]
    options = ["--traj-path", str(recording), "--allow-failure", "--save-traj"]
    done = subprocess.run([*command, *options], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-800:]
    assert "1/1=100.00% demos saved" in done.stdout
    with (
        h5py.File(recording) as first,
        h5py.File(recording.with_suffix(".state.pd_joint_pos.physx_cpu.h5")) as second,
    ):
        for name in ("actions", "obs", "env_states/garment/positions"):
            np.testing.assert_array_equal(first[f"traj_0/{name}"], second[f"traj_0/{name}"])


def test_recorded_states_are_restored(tmp_path):
    """ManiSkill hands them back as vectors of NumPy."""
    from mani_skill.trajectory.utils import dict_to_list_of_dicts

    recording = record(make(task="FoldTops-v1", max_episode_steps=2), tmp_path)
    env = make(task="FoldTops-v1").unwrapped
    env.reset(seed=0)
    with h5py.File(recording) as file:
        *_, last = dict_to_list_of_dicts(file["traj_0/env_states"])
        env.set_state_dict(last)
        observation = env.get_obs()[0].numpy()
        np.testing.assert_allclose(observation, file["traj_0/obs"][-1], atol=1e-6)
    np.testing.assert_array_equal(
        env.get_state_dict()["garment"]["positions"][0].numpy(), last["garment"]["positions"]
    )
    env.close()
