"""What cannot be imported is refused with one clear line, and leaves nothing behind."""

import contextlib
import importlib.util
import random
import tempfile
from pathlib import Path

import pytest

from dgl_assets import AssetError
from dgl_assets.importing import AssetImportError, import_garment, importer

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


@pytest.mark.parametrize("kind", [kind for kind in malformed.KINDS if not kind.startswith("usd")])
def test_random_damage_is_refused_or_read_and_never_a_defect(kind, tmp_path, monkeypatch):
    monkeypatch.setattr(importer, "_finish", lambda *args, **options: None)  # remeshing takes long
    generator, data = random.Random(7), malformed.whole(tmp_path, kind)
    for number in range(25):
        damaged, start = bytearray(data), generator.randrange(len(data))
        if number % 3 == 0:
            del damaged[start : start + generator.randrange(1, 200)]
        else:
            for _ in range(generator.choice([1, 3, 20])):
                place = generator.randrange(len(data) if number % 3 == 1 else min(len(data), 600))
                damaged[place] = generator.randrange(256)
        path = tmp_path / f"damaged{number}.{kind.rpartition('.')[2]}"
        path.write_bytes(damaged)
        with contextlib.suppress(AssetImportError):  # anything else is a defect and fails the test
            import_garment(path, out=tmp_path / "out")
        assert not (tmp_path / "out").exists()
