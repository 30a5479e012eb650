"""`dgl assets import-robot` and `list-robots`: results, JSON, and one line when it fails."""

import importlib.util
import json
from pathlib import Path

import pytest

from dexgarmentlab.cli import main
from dexgarmentlab.cli.collect import CollectOptions
from dexgarmentlab.cli.flags import tell_command
from dgl_collect.options import RecordOptions
from dgl_collect.setup import prepare_options
from dgl_tasks import get_task

_PATH = Path(__file__).parents[1] / "packages" / "dgl-assets" / "tests" / "dgl_robot_samples.py"
_SPEC = importlib.util.spec_from_file_location("dgl_robot_samples", _PATH)
assert _SPEC is not None
assert _SPEC.loader is not None
samples = importlib.util.module_from_spec(_SPEC)
_SPEC.loader.exec_module(samples)


@pytest.fixture
def hand(tmp_path):
    path = tmp_path / "hand.urdf"
    path.write_text(samples.sixteen_joint_hand())
    return path


def test_a_hand_is_imported_listed_and_described(hand, tmp_path, capsys):
    robots = str(tmp_path / "robots")
    arguments = ["assets", "import-robot", str(hand), "--name", "sixteen", "--kind", "hand"]
    assert main([*arguments, "--robots", robots, "--licence", "MIT", "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert (result["name"], result["kind"], result["joints"]) == ("sixteen", "hand", 16)
    assert result["collision_shapes"] == {"box": 17}
    assert (Path(result["folder"]) / "robot.json").is_file()

    assert main(["assets", "list-robots", "--robots", robots, "--json"]) == 0
    rows = {row["name"]: row for row in json.loads(capsys.readouterr().out)["robots"]}
    assert list(rows) == ["ur10e", "shadow", "sixteen"]
    assert rows["sixteen"]["licence"] == "MIT"
    assert main(["assets", "list-robots"]) == 0
    assert "shadow" in capsys.readouterr().out

    assert main([*arguments, "--robots", robots]) == 1
    assert "exists" in capsys.readouterr().err


def test_what_cannot_be_imported_is_one_line(hand, tmp_path, capsys):
    hand.write_text(hand.read_text().replace('type="revolute"', 'type="floating"', 1))
    arguments = ["assets", "import-robot", str(hand), "--name", "h", "--kind", "hand"]
    assert main([*arguments, "--robots", str(tmp_path / "robots")]) == 1
    error = [line for line in capsys.readouterr().err.splitlines() if line.startswith("dgl:")]
    assert len(error) == 1
    assert "floating" in error[0]
    assert not (tmp_path / "robots").exists()


@pytest.mark.parametrize("verb", [["collect", "FoldTops-v1"], ["demo"]])
def test_an_unknown_robot_is_said_before_anything_starts(verb, tmp_path, capsys):
    out = tmp_path / "out"
    assert main([*verb, "--out", str(out), "--robot", "shadw"]) == 1
    assert "did you mean 'shadow'" in capsys.readouterr().err
    assert not out.exists()


@pytest.mark.slow
def test_a_run_remembers_its_robot(tmp_path, hand):
    robots = tmp_path / "robots"
    arguments = ["assets", "import-robot", str(hand), "--name", "sixteen", "--kind", "hand"]
    assert main([*arguments, "--robots", str(robots)]) == 0
    run = RecordOptions(robot="sixteen", robots=robots)
    prepared, _ = prepare_options(run, get_task("FoldTops-v1"))
    assert prepared.to_plain() == {"robot": "sixteen", "robots": str(robots)}
    options = CollectOptions(task="FoldTops-v1", out=tmp_path, run=run)
    assert tell_command("collect", options).endswith(f"--robot sixteen --robots {robots}")


@pytest.mark.parametrize("action", ["import-robot", "list-robots"])
def test_help_has_an_example(action, capsys):
    assert main(["assets", action, "--help"]) == 0
    assert f"dgl assets {action}" in capsys.readouterr().out
