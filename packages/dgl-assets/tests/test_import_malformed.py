"""What cannot be imported is refused with one clear line, and leaves nothing behind."""

import importlib.util
import tempfile
from pathlib import Path

import pytest

from dgl_assets import AssetError
from dgl_assets.importing import AssetImportError, import_garment

_SPEC = importlib.util.spec_from_file_location("malformed", Path(__file__).parent / "malformed.py")
malformed = importlib.util.module_from_spec(_SPEC)
_SPEC.loader.exec_module(malformed)

CASES = malformed.cases()
has_usd = importlib.util.find_spec("pxr") is not None


@pytest.fixture
def scratch(tmp_path, monkeypatch):
    """Folder for temporary files, which must be empty in the end."""
    folder = tmp_path / "scratch"
    folder.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    return folder


def test_there_are_at_least_200_cases():
    assert len(CASES) >= 200


@pytest.mark.parametrize("name", CASES)
def test_a_malformed_input_is_refused_and_leaves_nothing(name, tmp_path, scratch):
    if not has_usd and "usd" in name:
        pytest.skip("usd-core is not installed")
    source = tmp_path / "in" / "here"
    source.mkdir(parents=True)
    path = CASES[name](source)
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(AssetError) as caught:
        import_garment(path, out=tmp_path / "out" / "assets")
    message = str(caught.value)
    assert isinstance(caught.value, AssetImportError)
    assert "\n" not in message
    assert 15 < len(message) < 400
    assert sorted(tmp_path.rglob("*")) == before  # no output, no folder for it, no temporary file
