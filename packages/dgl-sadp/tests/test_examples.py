import importlib.util
import re
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parent.parent / "examples"


def load(name):
    spec = importlib.util.spec_from_file_location(name, EXAMPLES / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_read_windows(tmp_path, make_episode):
    module = load("read_windows")
    for number in range(4):
        make_episode(tmp_path / f"{number}.h5", frames=12, success=number != 3)
    result = module.main(tmp_path)
    assert result == {
        "episodes": 3,
        "failed": 1,
        "training_windows": 28,
        "validation_windows": 14,
        "action": (8, 60),
    }


@pytest.mark.slow
def test_train_and_run(tmp_path):
    result = load("train_and_run").main(tmp_path, episodes=3, epochs=1, runs=1)
    assert 0.3 < result["before"] < 1.5  # From home to a sheet in front [m].
    assert 0.0 < result["after"] < 1.5  # After one epoch nothing is learned yet.


@pytest.mark.slow
def test_the_examples_of_the_readme_run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    readme = (EXAMPLES.parent / "README.md").read_text(encoding="utf-8")
    examples = re.findall(r"```python\n(.*?)```", readme, re.DOTALL)
    assert len(examples) == 2
    for example in examples:
        names: dict = {}
        exec(example.replace("8, frames=16, points=512", "2, frames=6, points=64"), names)
        assert names["targets"].shape == (4, 60)
