"""Arguments of an environment are checked, and each fault is named in one line."""

import dataclasses

import gymnasium
import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

import dgl_tasks
from dgl_tasks.errors import EnvironmentClosedError, RenderingUnavailableError
from dgl_tasks.inputs import check_reset_options, read_action, read_seed

TASK = dgl_tasks.get_task("FoldTops-v1")
HARDLY_SETTLED = dataclasses.replace(TASK, start=dataclasses.replace(TASK.start, settle_frames=2))
few = settings(max_examples=60, deadline=None, derandomize=True, database=None)


def make(**changes):
    given_ = {"task": HARDLY_SETTLED, "obs_mode": "state", "render_backend": "none"}
    return gymnasium.make("FoldTops-v1", **(given_ | {"reconfiguration_freq": 0} | changes))


@pytest.fixture(scope="module")
def env(coarse_garments):
    made = make()
    made.reset(seed=0)
    yield made
    made.close()


# Settings --------------------------------------------------------------------------------------


@pytest.mark.filterwarnings("ignore:.*is not in the possible render_modes")
def test_an_unknown_setting_is_refused_with_the_known_ones(refuse):
    table = [
        ({"num_envs": 2}, r"num_envs must be 1 .*; got 2"),
        ({"sim_backend": "physx_cuda"}, "sim_backend should be 'auto', .*; got 'physx_cuda'"),
        ({"sim_backend": None}, "sim_backend should be .*; got None"),
        ({"render_mode": "movie"}, "render_mode should be 'human', .*; got 'movie'"),
        ({"reward_mode": "rich"}, "reward_mode should be .*'dense'.*; got 'rich'"),
        ({"control_mode": "pd"}, "control_mode should be 'pd_joint_pos'.*; got 'pd'"),
        ({"look": 3}, "look should be 'studio' or 'random'; got 3"),
        ({"robot": 5}, 'robot must be a name, such as "ur10e.shadow", or a `Robot`; got 5'),
        ({"robot_uids": "panda"}, 'robot="ARM.HAND" names arms and hands here; got robot_uids'),
        ({"task": 5}, "a task must be an id.*; got 5"),
    ]
    assert not refuse((lambda c=change: make(**c), message) for change, message in table)


def test_a_window_without_a_renderer_is_refused():
    with pytest.raises(RenderingUnavailableError, match=r'"human" needs a renderer.*got "none"'):
        make(render_mode="human")


@pytest.mark.render
def test_a_window_without_a_display_is_refused(monkeypatch):
    for variable in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(variable, raising=False)
    with pytest.raises(
        RenderingUnavailableError, match=r"needs a display for its window.*rgb_array"
    ):
        make(render_mode="human", render_backend="cpu")


def test_pictures_without_a_renderer_are_refused(env):
    with pytest.raises(
        RenderingUnavailableError, match='render_backend="cpu" or "gpu"; got "none"'
    ):
        make(obs_mode="rgb")
    with pytest.raises(RenderingUnavailableError, match="pictures need a renderer"):
        env.unwrapped.render_rgb_array()


@pytest.mark.render
def test_a_device_that_is_not_there_is_named():
    with pytest.raises(RenderingUnavailableError, match=r'render_backend must be .*"abacus"'):
        make(render_backend="abacus")


# Actions ---------------------------------------------------------------------------------------


def set_at(index, value):
    action = np.zeros(60)
    action[index] = value
    return action


def test_a_wrong_action_is_refused_and_nothing_moves(env, refuse):
    table = [
        ("wave", "action must be 60 numbers; got 'wave'"),
        ([None] * 60, "action must be 60 numbers; got"),
        (np.array(["a"] * 60), "action must be 60 numbers; got"),
        (np.zeros(60, bool), "action must be real numbers; got torch.bool"),
        (np.zeros(60, complex), "action must be real numbers; got torch.complex128"),
        (np.zeros(59), r"action must have shape \(60,\) or \(1, \*\); got \(59,\)"),
        (np.zeros((2, 60)), r"action must have shape \(60,\) or \(1, \*\); got \(2, 60\)"),
        (0.5, r"action must have shape \(60,\) or \(1, \*\); got \(\)"),
        (set_at(7, np.nan), "action must be finite; got nan at index 7"),
        (set_at(59, -np.inf), "action must be finite; got -inf at index 59"),
        (set_at(3, 1e300), r"action must be finite; got 1e\+300 at index 3"),
        ({"arm": 1}, 'a dict of "control_mode" and "action"; got'),
        ({"control_mode": "pd", "action": np.zeros(60)}, "control_mode should be .*'pd'"),
    ]
    before = env.unwrapped.get_state()
    assert not refuse((lambda a=action: env.step(a), message) for action, message in table)
    assert not refuse(
        (lambda a=action: env.unwrapped.advance(a), message)
        for action, message in table
        if not isinstance(action, dict)
    )
    torch.testing.assert_close(env.unwrapped.get_state(), before, rtol=0, atol=0)


def test_actions_of_any_numeric_type_are_taken(env):
    joints = torch.from_numpy(env.unwrapped.agent.read_joints())
    for action in (joints, joints.numpy(), joints.tolist(), joints.double()[None]):
        env.step(action)


def try_to(read, *arguments):
    """Return the value and the message of a refusal."""
    try:
        return read(*arguments), ""
    except ValueError as err:
        return None, str(err)


anything = st.one_of(
    st.none(), st.text(max_size=4), st.binary(max_size=4), st.booleans(), st.integers(),
    st.floats(), st.complex_numbers(), st.lists(st.floats(), max_size=4),
    st.lists(st.text(max_size=2), max_size=3), st.dictionaries(st.text(max_size=2), st.none()),
)  # fmt: skip


@few
@given(anything | st.lists(st.floats(), min_size=4, max_size=4))
def test_any_action_is_read_or_refused(action):
    read, told = try_to(read_action, action, (4,))
    assert told == "" or (told.startswith("action must ") and "\n" not in told)
    if not told:
        assert read.shape == (1, 4)
        assert torch.isfinite(read.float()).all()


# Resets ----------------------------------------------------------------------------------------


def test_a_wrong_seed_is_refused(env, refuse):
    seeds = ["x", "", 1.5, -1, 2**32, [], [1, 2], [None], ["3"], {}, np.nan]
    message = r"seed must be None, an integer in \[0, .* of one; got"
    assert not refuse((lambda s=seed: env.reset(seed=s), message) for seed in seeds)


@pytest.mark.parametrize(
    ("seed", "read"),
    [
        (None, None),
        (3, 3),
        (np.int64(3), 3),
        (2**32 - 1, 2**32 - 1),
        ([3], 3),
        ((3,), 3),
        (np.array([3]), 3),
        (torch.tensor([3]), 3),
        (torch.tensor(3), 3),
    ],
)
def test_seeds_of_any_integer_type_are_read(seed, read):
    assert read_seed(seed) == read


def test_wrong_options_are_refused(env, refuse):
    table = [
        ([], r"options must be a dict; got \[\]"),
        ("fast", "options must be a dict; got 'fast'"),
        ({"garmet": 1, 5: 2}, r"options must be among \['garment', .*; got \['garmet', 5\]"),
        ({"garment": 5}, r"a garment must be an id.*; got 5"),
        ({"reconfigure": "yes"}, "\"reconfigure\" must be a bool; got 'yes'"),
        ({"env_idx": 0}, r'"env_idx" must be \[0\], .*; got 0'),
        ({"env_idx": [1]}, r'"env_idx" must be \[0\], .*; got \[1\]'),
        ({"env_idx": []}, r'"env_idx" must be \[0\], .*; got \[\]'),
        ({"reset_to_env_states": {}}, 'must be a dict with "env_states"; got {}'),
    ]
    assert not refuse((lambda o=o: env.reset(seed=0, options=o), message) for o, message in table)


@few
@given(anything)
def test_any_seed_and_any_options_are_read_or_refused(value):
    for read, name in ((read_seed, "seed"), (check_reset_options, "option")):
        _, told = try_to(read, value)
        assert told == "" or (told.startswith(name) and "\n" not in told)


# After closing ---------------------------------------------------------------------------------


def test_a_closed_environment_says_so(coarse_garments):
    made = make().unwrapped
    made.reset(seed=0)
    made.close()
    made.close()
    uses = {
        "reset": lambda: made.reset(seed=0),
        "step": lambda: made.step(np.zeros(60)),
        "advance": lambda: made.advance(None),
        "drawing": made.render_human,
        "get_state_dict": made.get_state_dict,
    }
    for name, use in uses.items():
        with pytest.raises(EnvironmentClosedError, match=f"{name} needs an open environment"):
            use()
