"""The verb `check`, with a format that was made up."""

import json
import re
from types import SimpleNamespace

import pytest

from dexgarmentlab.cli import main
from dgl_collect.exporting.origins import Origin, Origins, write_origins


@pytest.fixture
def found(monkeypatch, tmp_path):
    """A data set of ten successes, and the verdicts that its check gives."""
    episodes = tuple(Origin(seed=k, garment="tops/1", success=True) for k in range(10))
    shared = {"task": "FoldTops-v1", "robot": "ur10e+shadow", "cloud": "segmented"}
    write_origins(tmp_path, Origins(**shared, look="studio", episodes=episodes))
    verdicts = [True] * 10

    def check(folder, *, episodes, on_episode):
        assert folder == tmp_path
        for _ in verdicts[:episodes]:
            on_episode()
        return [
            SimpleNamespace(index=k, recorded=True, reached=reached, actions=40 + k)
            for k, reached in enumerate(verdicts[:episodes])
        ]

    entry = SimpleNamespace(name="lerobot", load=lambda: SimpleNamespace(check=check))
    monkeypatch.setattr("dgl_collect.exporting.writers.entry_points", lambda **_: [entry])
    return verdicts


def test_nine_of_ten_verdicts_suffice_and_eight_do_not(found, tmp_path, capsys):
    found[3] = False
    assert main(["check", "lerobot", str(tmp_path)]) == 0
    out = capsys.readouterr().out
    assert "episode 3: recorded success, failure after 43 actions\n9 of 10 verdicts agree" in out
    found[4] = False
    assert main(["check", "lerobot", str(tmp_path), "--json"]) == 1
    told = json.loads(capsys.readouterr().out)
    assert told["agreed"] == 8
    assert told["episodes"][3] == {"index": 3, "recorded": True, "reached": False, "actions": 43}
    assert main(["check", "lerobot", str(tmp_path), "--episodes", "3"]) == 0


def test_what_cannot_be_checked_is_told_in_a_line(found, tmp_path, capsys, monkeypatch):
    table = [
        ([str(tmp_path / "nowhere")], r"holds no data set of dgl export: .* is missing"),
        ([str(tmp_path), "--episodes", "0"], "--episodes must be at least 1; got 0"),
    ]
    for words, message in table:
        assert main(["check", "lerobot", *words]) == 1
        assert re.search(message, capsys.readouterr().err)
    monkeypatch.setattr("dgl_collect.exporting.writers.entry_points", lambda **_: [])
    assert main(["check", "lerobot", str(tmp_path)]) == 1
    assert "pip install 'lerobot_env_dexgarmentlab'" in capsys.readouterr().err
