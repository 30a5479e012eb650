"""The verb `relabel`, on made-up episodes."""

import dataclasses
import json
import re

import h5py
import pytest

from dexgarmentlab.cli import main
from dgl_collect import RunOptions, read_episode
from dgl_sadp.synthetic import write_synthetic_episodes


class StubRelabeller:
    """Matcher whose points lie 0.1 m away in the first episode, and farther in the next."""

    distance = 0.0

    def __init__(self, task, options, *, weights=None):
        assert (task, options, weights) == ("FoldTops-v1", RunOptions(), None)

    def relabel(self, episode):
        self.distance += 0.1
        return dataclasses.replace(episode, affordance_matcher="gam"), self.distance


def name_task(path, task):
    with h5py.File(path, "r+") as file:
        file.attrs["task"] = task


@pytest.fixture
def episodes(tmp_path):
    paths = write_synthetic_episodes(tmp_path / "episodes", 3, frames=4, image_size=(480, 640))
    for path in paths:
        name_task(path, "FoldTops-v1")
    paths[0].write_bytes(paths[0].read_bytes()[:4000])
    return paths


def test_it_says_what_became_of_each_episode(episodes, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("dgl_collect.relabel.Relabeller", StubRelabeller)
    out = tmp_path / "out"
    command = ["relabel", str(episodes[0].parent), "--out", str(out)]
    assert main([*command, "--json"]) == 0
    told = capsys.readouterr()
    result = json.loads(told.out)
    assert result["written"] == [episodes[1].name]
    assert result["left_out"] == {episodes[2].name: pytest.approx(0.2)}
    assert list(result["refused"]) == [episodes[0].name]
    assert episodes[0].name in told.err
    assert read_episode(out / episodes[1].name).affordance_matcher == "gam"

    assert main([*command, "--within", "0.05"]) == 0
    said = capsys.readouterr().out
    assert "0 relabelled, 1 were there, 1 left out" in said
    assert "1 damaged or foreign" in said


def test_folders_without_readable_episodes_are_refused(episodes, tmp_path, capsys):
    command = ["relabel", "--out", str(tmp_path / "out")]
    none = tmp_path / "none"
    none.mkdir()
    assert main([*command, str(none)]) == 1
    assert f"no episodes (*.h5) in {none}" in capsys.readouterr().err
    for path in episodes[1:]:
        path.unlink()
    assert main([*command, str(episodes[0].parent)]) == 1
    assert "none of 1 episodes can be read" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_what_cannot_be_used_is_told_before_the_work(episodes, tmp_path, capsys):
    for task, arguments, message in (
        ("FoldTops-v1", ["--out", str(episodes[0] / "out")], "Not a directory"),
        ("FoldScarf-v1", ["--out", str(tmp_path / "out")], "not known; name .* --task FILE"),
        ("FoldScarf-v1", ["--out", str(tmp_path / "out"), "--task", "FoldTops-v1"],
         "must declare 'FoldScarf-v1'"),
    ):  # fmt: skip
        name_task(episodes[1], task)
        assert main(["relabel", str(episodes[0].parent), *arguments]) == 1
        told = capsys.readouterr().err
        assert re.search(message, told)
        assert told.count("\n") == 1
    assert not (tmp_path / "out").exists()
