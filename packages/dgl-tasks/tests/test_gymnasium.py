"""The environments under Gymnasium's and other libraries' own tools."""

import gymnasium
import numpy as np
import pytest
from mani_skill.utils.wrappers.gymnasium import CPUGymWrapper


def prepare():
    """A function that makes FoldTops as users of plain Gymnasium do, also in another process."""

    def make():
        import dgl_tasks  # noqa: F401 - registers the environments

        options = {"obs_mode": "state", "render_backend": "none", "max_episode_steps": 2}
        return CPUGymWrapper(gymnasium.make("FoldTops-v1", **options))

    return make


def test_one_wrapper_gives_arrays_without_a_batch_and_a_step_limit():
    env = prepare()()
    seen, info = env.reset(seed=0)
    assert isinstance(seen, np.ndarray)
    assert seen.shape == env.observation_space.shape == (134,)
    assert env.action_space.shape == (60,)
    ends = [env.step(env.action_space.sample())[1:4] for _ in range(2)]
    assert [type(value) for value in ends[0]] == [float, bool, bool]
    assert [truncated for _, _, truncated in ends] == [False, True]
    assert isinstance(info, dict)
    env.close()


@pytest.mark.slow
def test_two_environments_step_in_processes_of_their_own():
    vector = gymnasium.vector.AsyncVectorEnv([prepare()] * 2, context="forkserver")
    seen, _ = vector.reset(seed=[3, 3])
    assert seen.shape == (2, 134)
    np.testing.assert_array_equal(seen[0], seen[1])
    seen, rewards, terminated, truncated, _ = vector.step(vector.action_space.sample())
    assert rewards.shape == (2,)
    assert not terminated.any()
    assert not truncated.any()
    assert not np.array_equal(seen[0], seen[1])
    *_, truncated, _ = vector.step(vector.action_space.sample())
    assert truncated.all()
    vector.close()
