"""The verb `replay`, with a replay that was made up."""

import importlib
import json
from pathlib import Path

import h5py
import pytest

from dexgarmentlab.cli import replay as verb
from dgl_collect import NotReplayableError, write_episode
from dgl_collect.replay import Difference, Replay

COLLECT_TESTS = Path(__file__).parents[1] / "packages/dgl-collect/tests"


@pytest.fixture
def path(monkeypatch, tmp_path):
    monkeypatch.syspath_prepend(str(COLLECT_TESTS))
    fakes = importlib.import_module("dgl_collect_fakes")
    return write_episode(tmp_path / "e.h5", fakes.make_episode())


def use(monkeypatch, joints=0.0, success=True, draws=None):
    """Let the replay come to what is given."""
    replay = Replay(
        task="FoldTops-v1",
        seed=7,
        garment_id="tops/7",
        steps=3,
        differences=(Difference(name="joint_state", count=60, largest=joints, unit="rad"),),
        changed_draws=draws or {},
        recorded=(True, 0.91),
        replayed=(success, 0.91 if success else 0.4),
    )
    monkeypatch.setattr("dgl_collect.replay.replay_episode", lambda *_, **__: replay)


def test_what_reproduces_is_said_and_is_a_success(monkeypatch, path, capsys):
    use(monkeypatch)
    assert verb.run(verb.ReplayOptions(episode=path)) == 0
    out = capsys.readouterr().out
    assert "FoldTops-v1, seed 7, tops/7: 3 steps" in out
    assert "joint_state  60       equal" in out
    assert "recorded: success, 0.9100\nreplayed: success, 0.9100" in out


@pytest.mark.parametrize(
    ("change", "fault"),
    [
        ({"joints": 0.02}, "joint_state differs by up to 0.02 rad"),
        ({"success": False}, "the verdict was success, 0.9100 and is failure, 0.4000"),
        ({"draws": {"x": (0.1, 0.2)}}, "draw x was 0.1 and is 0.2"),
        ({"joints": float("inf")}, "joint_state differs by up to inf rad"),
    ],
)
def test_what_does_not_is_named_and_fails(monkeypatch, path, capsys, change, fault):
    use(monkeypatch, **change)
    assert verb.run(verb.ReplayOptions(episode=path, json=True)) == 1
    out, err = capsys.readouterr()
    assert json.loads(out)["reproduces"] is False
    assert err.strip().splitlines()[-1].endswith(f"e.h5 does not reproduce: {fault}")


def test_a_tolerance_lets_small_differences_pass(monkeypatch, path):
    use(monkeypatch, joints=0.02)
    assert verb.run(verb.ReplayOptions(episode=path, tolerance=0.05)) == 0
    with pytest.raises(ValueError, match="must be a finite number of at least 0; got -1"):
        verb.run(verb.ReplayOptions(episode=path, tolerance=-1.0))


def test_a_task_of_ones_own_is_named_by_its_file(tmp_path, path):
    with h5py.File(path, "r+") as file:
        file.attrs["task"] = "FoldScarf-v1"
    with pytest.raises(ValueError, match=r"'FoldScarf-v1' .* is not known; name .* --task FILE"):
        verb.run(verb.ReplayOptions(episode=path))


def test_an_episode_without_its_commands_is_refused(path):
    with pytest.raises(NotReplayableError, match="collect it again"):
        verb.run(verb.ReplayOptions(episode=path))
