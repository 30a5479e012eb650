"""The examples of other libraries run."""

import runpy
import sys
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[1] / "examples"


@pytest.mark.slow
@pytest.mark.filterwarnings("default")  # of the libraries
def test_sac_learns_for_some_steps_and_is_saved(tmp_path, monkeypatch):
    pytest.importorskip("stable_baselines3")
    out = tmp_path / "sac.zip"
    words = ["--steps", "8", "--episode", "4", "--out", str(out)]
    monkeypatch.setattr(sys, "argv", ["stable_baselines.py", *words])
    runpy.run_path(str(EXAMPLES / "stable_baselines.py"), run_name="__main__")
    assert out.is_file()


@pytest.mark.slow
@pytest.mark.filterwarnings("default")  # of the libraries
def test_a_rollout_is_a_tensordict():
    pytest.importorskip("torchrl")
    env = runpy.run_path(str(EXAMPLES / "torch_rl.py"))["make_env"]("HangTops-v1")
    env.set_seed(0)
    steps = env.rollout(max_steps=2)
    assert steps["action"].shape == (2, 22)
    assert steps["next", "observation"].shape == (2, 134)
    assert not steps["observation"][1].equal(steps["observation"][0])
    env.close()
