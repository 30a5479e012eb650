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


@pytest.fixture(scope="module")
def attempts(coarse_garments):
    """Attempts at Hang Trousers, in one environment."""
    from dgl_collect import RecordOptions
    from dgl_collect.attempt import make_attempt_runner

    made = make_attempt_runner("HangTrousers-v1", RecordOptions())
    yield made
    made.close()


@pytest.fixture(scope="module")
def recorded(attempts, tmp_path_factory):
    """The file of a short attempt of 6 frames."""
    from dgl_collect import write_episode

    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(Path(__file__).parent))
        episode = importlib.import_module("dgl_collect_fakes").perform(attempts, seed=3)
    return write_episode(tmp_path_factory.mktemp("replay") / "short.h5", episode)
