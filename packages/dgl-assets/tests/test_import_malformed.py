"""Hundreds of files that cannot be imported: each is refused in one line and leaves nothing."""

import contextlib
import importlib.util
import random
import tempfile
from pathlib import Path

import pytest

from dgl_assets import AssetError
from dgl_assets.importing import AssetImportError, import_garment, importer

_PATH = Path(__file__).parent / "malformed.py"
_SPEC = importlib.util.spec_from_file_location("malformed", _PATH)
malformed = importlib.util.module_from_spec(_SPEC)
_SPEC.loader.exec_module(malformed)

CASES = dict(malformed.cases())
has_usd = importlib.util.find_spec("pxr") is not None


@pytest.fixture
def scratch(tmp_path, monkeypatch):
    """Folder for temporary files, which must be empty in the end."""
    folder = tmp_path / "scratch"
    folder.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    return folder


def find_fault(make, folder):
    """Import one case; tell how it went wrong, or nothing where it was refused as it should."""
    source = folder / "in" / "here"
    source.mkdir(parents=True)
    path = make(source)
    before = sorted(folder.rglob("*"))
    try:
        import_garment(path, out=folder / "out" / "assets")
    except AssetImportError as err:
        message = str(err)
        if "\n" in message or not 15 < len(message) < 400:
            return f"unclear: {message}"
    except AssetError as err:
        return f"{type(err).__name__}: {err}"
    else:
        return "was imported"
    left = set(folder.rglob("*")) - set(before)
    return f"left {sorted(left)}" if left else None


def collect_faults(names, tmp_path, scratch):
    faults = {}
    for number, name in enumerate(names):
        fault = find_fault(CASES[name], tmp_path / f"case{number}")
        left = list(scratch.iterdir())
        if fault or left:
            faults[name] = fault or f"left {left}"
    return faults


def test_malformed_files_are_refused_and_leave_nothing(tmp_path, scratch, reads_here):
    names = [name for name in CASES if "usd" not in name]
    assert len(names) >= 200
    assert collect_faults(names, tmp_path, scratch) == {}


def test_malformed_files_are_refused_as_well_in_a_child_process(tmp_path, scratch):
    names = [name for name in CASES if "usd" not in name][::20]
    assert collect_faults(names, tmp_path, scratch) == {}


@pytest.mark.skipif(not has_usd, reason="usd-core is not installed")
def test_malformed_usd_is_refused_and_leaves_nothing(tmp_path, scratch):
    names = [name for name in CASES if "usd" in name]
    assert collect_faults(names, tmp_path, scratch) == {}


@pytest.mark.parametrize("kind", [kind for kind in malformed.KINDS if not kind.startswith("usd")])
def test_random_damage_is_refused_or_read_and_never_a_defect(
    kind, tmp_path, monkeypatch, reads_here
):
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
