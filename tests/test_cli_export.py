"""The verb `export`, on stages of made-up episodes, in this process."""

import importlib
import json
import re
from pathlib import Path
from types import SimpleNamespace

import h5py
import pytest

from dexgarmentlab.cli import main
from dgl_assets.robots import DEFAULT_ROBOT
from dgl_collect import write_episode
from dgl_tasks import get_task

COLLECT_TESTS = Path(__file__).parents[1] / "packages/dgl-collect/tests"


@pytest.fixture
def folder(monkeypatch, tmp_path):
    """A folder with two episodes, exported by workers of this process."""
    monkeypatch.syspath_prepend(str(COLLECT_TESTS))
    fakes = importlib.import_module("dgl_collect_fakes")
    fakes.work_here(monkeypatch)
    for seed in range(2):
        write_episode(tmp_path / f"run/episodes/e{seed}.h5", fakes.make_episode(seed))
    env = SimpleNamespace(task=get_task("FoldTops-v1"), close=lambda: None)
    setup = SimpleNamespace(env=env, motion=SimpleNamespace(robot=DEFAULT_ROBOT))
    monkeypatch.setattr("dgl_collect.exporting.export.make_setup", lambda *_: setup)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_stages_of_a_folder_become_one_file(folder, capsys):
    line = ["export", "robomimic", "run", "--content", "stages", "--out", "out.hdf5", "--json"]
    assert main([*line, "--control-mode", "pd_hand_poses", "--size", "32", "24"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told == {"episodes": 4, "frames": 10, "left_out": {}, "out": "out.hdf5"}
    with h5py.File("out.hdf5") as file:
        assert file["data/demo_3/actions"].shape == (3, 22)
        assert file["data/demo_3/obs/img"].shape == (3, 24, 32, 3)
    assert not (folder / "out.hdf5.part").exists()


def test_episodes_without_commands_are_left_out_and_that_is_a_failure(folder, capsys):
    assert main(["export", "zarr", "run/episodes/e0.h5", "--out", "z"]) == 1
    assert "collect it again, or export its stages" in capsys.readouterr().err


def test_what_cannot_be_exported_is_told_in_a_line(folder, capsys, monkeypatch):
    (folder / "there").mkdir()
    (folder / "empty").mkdir()
    monkeypatch.setattr("dgl_collect.exporting.writers.entry_points", lambda **_: [])
    table = [
        (
            ["lerobot", "run", "--out", "a"],
            "not installed: pip install 'lerobot_env_dexgarmentlab'",
        ),
        (["zarr", "nowhere", "--out", "a"], "there is no episode file or folder nowhere"),
        (["zarr", "empty", "--out", "a"], r"no episodes \(\*.h5\) in empty"),
        (["zarr", "run", "--out", "there"], "there is there already; choose another --out"),
        (["zarr", "run", "run", "--out", "a"], "different names"),
    ]
    for words, message in table:
        assert main(["export", *words]) == 1, words
        line = capsys.readouterr().err.strip().splitlines()[-1]
        assert re.search(message, line), line
