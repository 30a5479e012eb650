"""The code in the README that needs no simulation runs as it stands there."""

import ast
import importlib
import re
from pathlib import Path

import numpy as np
import pytest

from dgl_collect import AttemptRequest

README = Path(__file__).parents[1] / "README.md"


def find_block(title):
    section = re.split(rf"^## {title}$", README.read_text(encoding="utf-8"), flags=re.MULTILINE)[1]
    found = re.search(r"```python\n(.*?)```", section, re.DOTALL)
    assert found
    return found.group(1)


def test_a_demonstration_is_carried_over(capsys):
    names: dict = {}
    exec(compile(find_block("One demonstration, any garment"), "README.md", "exec"), names)
    goals = names["goals"]  # of the last move of the first stage: [m] for each hand
    assert set(goals) == {"left"}
    chest = names["target"].vertices[names["target"].landmarks["right_upper_chest"]]
    assert np.linalg.norm(goals["left"][:2] - chest[:2]) < 0.1  # as far as the sleeve reaches
    assert capsys.readouterr().out


def test_an_episode_is_read(fakes, tmp_path, monkeypatch, capsys):
    from dgl_collect import write_episode

    monkeypatch.chdir(tmp_path)
    path = Path("out/fold-tops/episodes/FoldTops-v1-s0-00000.h5")
    path.parent.mkdir(parents=True)
    write_episode(path, fakes.make_episode())
    exec(compile(find_block("Read an episode"), "README.md", "exec"), {})
    assert "left_sleeve (2, 60) (2, 480, 640, 3)" in capsys.readouterr().out


def test_a_runner_of_ones_own_makes_attempts(tmp_path):
    names: dict = {}
    exec(compile(find_block("Bring your own attempt"), "README.md", "exec"), names)
    runner = names["make_runner"]("FoldTops-v1", {})
    result = runner.run(AttemptRequest(index=3, seed=7, episode_id="a"), tmp_path)
    assert (result.index, result.seed, result.success, result.reason) == (3, 7, False, "not tried")
    runner.close()


@pytest.mark.slow
@pytest.mark.render
def test_an_actor_goes_through_all_stages(capsys):
    names: dict = {}
    exec(compile(find_block("One stage runner, any actor"), "README.md", "exec"), names)
    result, stages = names["result"], names["setup"].demonstration.learned_stages
    assert result.success, result.detail
    records = names["recorder"].records
    assert list(records) == [stage.name for stage in stages]
    assert all(10 < record.frame_count < len(result.commands) // 5 for record in records.values())
    assert result.beliefs["value"] > 0.85
    assert "bottom_up" in capsys.readouterr().out


def test_all_code_imports_what_exists():
    blocks = re.findall(r"```python\n(.*?)```", README.read_text(encoding="utf-8"), re.DOTALL)
    imports = [
        (node.module, name.name)
        for code in blocks
        for node in ast.walk(ast.parse(code))
        if isinstance(node, ast.ImportFrom)
        for name in node.names
    ]
    assert ("dgl_collect.attempt", "make_attempt_runner") in imports
    missing = [pair for pair in imports if not hasattr(importlib.import_module(pair[0]), pair[1])]
    assert not missing
