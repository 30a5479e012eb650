"""`scripts/pin.py` rewrites only its list, whose pins are exact; shell scripts are valid."""

import importlib.util
import re
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent


@pytest.fixture
def pin():
    spec = importlib.util.spec_from_file_location("pin", ROOT / "scripts" / "pin.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_only_the_list_changes(pin):
    before = '[tool.uv]\nconstraint-dependencies = [\n  "a==1",\n]\n\n[other]\nx = [\n]\n'
    after = pin.replace_pins(before, ["b==2 ; python_full_version < '3.11'"])
    assert after == before.replace('"a==1"', "\"b==2 ; python_full_version < '3.11'\"")
    assert pin.replace_pins(pin.replace_pins(after, []), ["a==1"]) == before


def test_a_file_without_the_list_is_refused(pin):
    with pytest.raises(SystemExit, match="constraint-dependencies"):
        pin.replace_pins("[tool.uv]\n", ["a==1"])


def test_every_pin_is_exact():
    text = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    block = text.partition("constraint-dependencies = [\n")[2].partition("\n]")[0]
    pins = re.findall(r'^  "(.+)",$', block, re.MULTILINE)
    assert len(pins) > 50
    assert all(re.match(r"^[a-z0-9-]+==[^*\s]+( ; .+)?$", pin) for pin in pins)


def test_bootstrap_is_valid_shell():
    for script in ("bootstrap.sh", "test_package.sh"):
        command = ["bash", "-n", str(ROOT / "scripts" / script)]
        done = subprocess.run(command, capture_output=True, check=False)
        assert done.returncode == 0, done.stderr
