"""`dgl tune`: what it prints and writes, how it is continued, and what it refuses."""

import importlib
import json
import re
from pathlib import Path

import pytest

from dexgarmentlab.cli import console, main
from dgl_collect.tuning import search

TESTS = Path(__file__).parents[1] / "packages/dgl-collect/tests"
SMALL = ("--generations", "2", "--candidates", "4", "--starts", "2", "--judged", "4")


@pytest.fixture
def tune(tmp_path, monkeypatch, capsys):
    """Run the verb with trials of a stand-in, in this process."""
    monkeypatch.syspath_prepend(str(TESTS))
    importlib.import_module("dgl_collect_fakes").work_here(monkeypatch)
    monkeypatch.setattr(search, "FACTORY", "test_tuning:StandIn")

    def go(*arguments, task="FlingTops-v1"):
        code = main(["tune", task, "--out", str(tmp_path / "out"), *arguments])
        return code, capsys.readouterr()

    return go


def test_the_winner_its_judgement_and_the_report_are_told(tune, tmp_path):
    code, told = tune(*SMALL)
    assert code == 0
    assert "first try on 4 further starts:" in told.out
    assert "along" in told.out
    assert "not shown to be better: keep the demonstration" in told.out  # four starts show nothing
    page = (tmp_path / "out/index.html").read_text()
    assert "data:image/png" in page
    assert "swing" not in page  # meanings are in the demonstration
    for name in json.loads((tmp_path / "out/tuned.json").read_text())["parameters"]:
        assert f"<td>{name}</td>" in page


def test_the_result_is_json_where_that_is_asked_for(tune):
    code, told = tune(*SMALL, "--json")
    assert code == 0
    result = json.loads(told.out)
    assert (result["trials"], result["judged"]) == (20, 4)
    assert set(result["before"]) == set(result["after"]) == set(result["t"])
    assert 0 <= result["p"] <= 1
    assert [set(each) for each in result["generations"]] == [{"baseline", "mean", "best"}] * 2


def test_a_search_is_continued_with_the_same_options_alone(tune):
    assert tune(*SMALL)[0] == 0
    code, told = tune(*SMALL)
    assert code != 0
    assert "is not empty; add --resume" in told.err
    code, told = tune(*SMALL, "--resume", "--seed", "3")
    assert code != 0
    assert "seed" in told.err
    code, told = tune(*SMALL, "--resume", "--starts", "3", "--look", "random")
    assert code != 0
    assert (
        "options: its starts is 2, this run's is 3; its look is not given, this run's is 'random'"
        in told.err
    )
    assert tune(*SMALL, "--resume")[0] == 0


def test_the_least_numbers_and_the_time_left_are_told(tune, capsys, monkeypatch):
    assert main(["tune", "--help"]) == 0
    assert "Candidates in a generation, at least 4;" in " ".join(capsys.readouterr().out.split())
    monkeypatch.setattr(console, "LOG_SECONDS", 0.0)
    code, told = tune(*SMALL)
    assert code == 0
    first, *others, last = re.findall(r"^tuning .*", told.err, re.MULTILINE)
    assert first.endswith("generation 1 of 2")
    assert all(line.endswith(" s left") for line in others if "28/28" not in line)
    assert last.endswith("judgement")


def test_what_cannot_be_searched_is_told_in_one_line(tune, tmp_path):
    for arguments, task, message in (
        (("--generations", "0"), "FlingTops-v1", "generations must be at least 1; got 0"),
        (("--candidates", "4", "--generations", "1", "--starts", "1"), "FlingTops-v1", "20 trials"),
        ((), "FoldTops-v1", "this file names none"),
        (("--demonstration", "none.json"), "FlingTops-v1", "none.json"),
    ):
        code, told = tune(*arguments, task=task)
        assert code != 0
        assert message in told.err
        assert told.err.count("\n") == 1
        assert not (tmp_path / "out").exists()
