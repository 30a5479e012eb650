"""The code of `docs/eval.md` runs as it stands there."""

import re
from pathlib import Path

import gymnasium
import numpy as np
import pytest

from dgl_tasks.evaluation import run_episode
from dgl_tasks.motion import BimanualMotion
from dgl_tasks.policy import Method, Policy

PAGE = (Path(__file__).parents[1] / "docs/eval.md").read_text(encoding="utf-8")
SECTION = PAGE.split("## A policy of your own\n")[1]
POLICY, METHOD = re.findall(r"```python\n(.*?)```", SECTION, re.DOTALL)


def run(code):
    names: dict = {}
    exec(compile(code, "docs/eval.md", "exec"), names)
    return names


def test_the_policy_is_one():
    policy = run(POLICY)["make"](None)
    assert isinstance(policy, Policy)
    assert policy.act({"joint_state": np.zeros(60)}).shape == (1, 60)


def test_the_method_is_one():
    assert isinstance(run(METHOD)["make_method"](None), Method)


class Heights:
    """Notes how high the garment is."""

    def __init__(self, env):
        self.env, self.highest = env, 0.0

    def before_step(self, command, look):
        if look().step % 10 == 0:
            self.highest = max(self.highest, float(self.env.get_particles()[:, 2].max()))

    def note(self, mark, sensed):
        pass


@pytest.mark.slow
@pytest.mark.render
def test_the_method_lifts_the_garment_and_is_judged():
    env = gymnasium.make("FoldTops-v1", obs_mode="none", render_backend="cpu").unwrapped
    motion, heights = BimanualMotion(env.task), Heights(env)
    method = run(METHOD)["make_method"](env)
    result = run_episode(env, motion, method, seed=0, listener=heights)
    assert 0.25 < heights.highest < 0.5  # by 0.3 m
    assert not result.success
    assert result.verdict == result.first_try
    assert result.reason == "below the threshold"
    env.close()


def test_the_methods_of_the_table_are_those_of_the_command_line():
    from dexgarmentlab.learned_methods import METHODS
    from dgl_collect.evaluation.methods import SCRIPTED

    table = PAGE.split("| `--policy` | what it does |")[1].split("\n\n")[0]
    told = {
        name
        for line in table.splitlines()[2:]
        for name in re.findall(r"`([\w:-]+)`", line.split("|")[1])
    }
    assert told == {*SCRIPTED, *METHODS, "module:factory"}
