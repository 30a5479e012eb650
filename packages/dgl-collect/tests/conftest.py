import importlib
import importlib.util
from pathlib import Path

import pytest

_SPEC = importlib.util.spec_from_file_location(
    "dgl_collect_world", Path(__file__).parent / "dgl_collect_world.py"
)
_WORLD = importlib.util.module_from_spec(_SPEC)
_SPEC.loader.exec_module(_WORLD)


@pytest.fixture
def fakes(monkeypatch):
    """The module of made-up episodes and attempts, importable by worker processes too."""
    monkeypatch.syspath_prepend(str(Path(__file__).parent))
    return importlib.import_module("dgl_collect_fakes")


@pytest.fixture
def make_world():
    """Makes a world without a simulator."""
    return _WORLD.make_world
