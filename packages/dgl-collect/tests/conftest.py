import importlib
from pathlib import Path

import pytest


@pytest.fixture
def fakes(monkeypatch):
    """The module of made-up episodes and attempts, importable by worker processes too."""
    monkeypatch.syspath_prepend(str(Path(__file__).parent))
    return importlib.import_module("dgl_collect_fakes")
