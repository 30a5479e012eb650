"""Built garments on disk: whole or not there, checked when read."""

import json
import zipfile

import numpy as np
import pytest

from dgl_assets import AssetNotFoundError, CacheError, build_garments, load_garment
from dgl_assets.garments import cache as cache_module
from dgl_assets.garments.cache import find_cached, store_garment

SCARF, OTHER = "Scarf/000003", "Scarf/008001"


@pytest.fixture
def built(tmp_path):
    load_garment(SCARF, cache=tmp_path)
    return tmp_path


def _assert_equal(first, second):
    for name in ("vertices", "faces", "rest_vertices", "canonical", "face_panels"):
        a, b = getattr(first, name), getattr(second, name)
        assert a.dtype == b.dtype
        assert np.array_equal(a, b)
    for name in ("name", "category", "panels", "landmarks", "parameters", "wall_thickness"):
        assert getattr(first, name) == getattr(second, name)


def test_a_cached_garment_is_the_garment(built):
    _assert_equal(load_garment(SCARF, cache=built), load_garment(SCARF))
    assert [p.name for p in built.rglob("*.*")] == ["000003.npz"]


def test_a_cached_shell_is_the_shell(tmp_path):
    shell = load_garment("Glove/008003", cache=tmp_path)
    assert shell.wall_thickness is not None
    _assert_equal(load_garment("Glove/008003", cache=tmp_path), shell)


def test_a_cached_garment_is_read_and_not_made_again(built, monkeypatch):
    monkeypatch.setattr("dgl_assets.garments.catalogue._make", lambda *_, **__: 1 / 0)
    assert load_garment(SCARF, cache=built).name == SCARF


def test_files_hold_no_pickles(built):
    path = next(built.rglob("*.npz"))
    with np.load(path, allow_pickle=False) as archive:
        assert {archive[name].dtype.kind for name in archive.files} <= set("fiu")


@pytest.mark.parametrize("damage", ["truncated", "empty", "text", "no_array", "flipped", "shape"])
def test_damaged_files_are_refused_by_name(built, damage):
    path = next(built.rglob("*.npz"))
    data = path.read_bytes()
    if damage == "truncated":
        path.write_bytes(data[: len(data) // 2])
    elif damage == "empty":
        path.write_bytes(b"")
    elif damage == "text":
        path.write_text("not an archive")
    elif damage == "flipped":
        middle = len(data) // 2
        path.write_bytes(data[:middle] + bytes([data[middle] ^ 255]) + data[middle + 1 :])
    else:
        with np.load(path) as archive:
            arrays = {name: archive[name] for name in archive.files}
        if damage == "no_array":
            del arrays["canonical"]
        else:
            arrays["faces"] = arrays["faces"] + 10**6
        np.savez(path, **arrays)
    with pytest.raises(CacheError, match=r"000003\.npz is damaged .* delete it"):
        load_garment(SCARF, cache=built)
    assert path.exists()


def test_files_of_another_version_or_garment_are_refused(built, monkeypatch):
    path = next(built.rglob("*.npz"))
    (built / "Scarf" / "000004.npz").write_bytes(path.read_bytes())
    with pytest.raises(CacheError, match=r"must hold Scarf/000004; got Scarf/000003"):
        load_garment("Scarf/000004", cache=built)
    monkeypatch.setattr(cache_module, "GENERATOR_VERSION", 99)
    with pytest.raises(CacheError, match="is of version 3 of the generator, expected 99"):
        load_garment(SCARF, cache=built)


def test_an_interrupted_write_leaves_nothing(tmp_path, monkeypatch):
    garment = load_garment(SCARF)

    def interrupt(file, **_):
        file.write(b"half of a garment")
        raise KeyboardInterrupt

    monkeypatch.setattr(np, "savez_compressed", interrupt)
    with pytest.raises(KeyboardInterrupt):
        store_garment(tmp_path, garment)
    assert list((tmp_path / "Scarf").iterdir()) == []
    assert find_cached(tmp_path, SCARF) is None


def test_a_build_is_continued_and_reports_what_is_broken(built):
    path = next(built.rglob("*.npz"))
    path.write_bytes(b"")
    done = {entry.id: entry for entry in build_garments([SCARF, OTHER], built)}
    assert "CacheError" in done[SCARF].error
    assert done[OTHER].error is None
    assert done[OTHER].vertex_count == len(load_garment(OTHER).vertices)
    path.unlink()
    assert all(entry.error is None for entry in build_garments([SCARF, OTHER], built))


@pytest.mark.slow
def test_a_parallel_build_gives_the_same_garments(tmp_path):
    done = list(build_garments([SCARF, OTHER], tmp_path, workers=2))
    assert {entry.id for entry in done} == {SCARF, OTHER}
    assert all(entry.error is None for entry in done)
    for garment_id in (SCARF, OTHER):
        found = find_cached(tmp_path, garment_id)
        assert found is not None
        _assert_equal(found, load_garment(garment_id))


def test_a_build_of_wrong_ids_begins_nothing(tmp_path):
    with pytest.raises(AssetNotFoundError):
        build_garments([SCARF, "Scarf/999999"], tmp_path)
    with pytest.raises(ValueError, match="workers must be at least 1; got 0"):
        build_garments([SCARF], tmp_path, workers=0)
    assert list(tmp_path.iterdir()) == []


def test_a_cache_and_a_spacing_do_not_go_together(tmp_path):
    with pytest.raises(ValueError, match=r"default spacing; got spacing 0\.02"):
        load_garment(SCARF, cache=tmp_path, spacing=0.02)


def test_the_text_of_a_file_is_readable_by_others(built):
    path = next(built.rglob("*.npz"))
    assert zipfile.is_zipfile(path)
    with np.load(path) as archive:
        entry = json.loads(bytes(archive["text"]))
    assert entry["garment"]["category"] == "Scarf"
    assert entry["garment"]["landmarks"]["left_tip"] >= 0
