"""The catalogue, the package's exports, and the example."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest

import dgl_assets
from dgl_assets import AssetNotFoundError, garment_ids, list_categories, load_garment

EXAMPLE = Path(__file__).parents[1] / "examples" / "make_top.py"


def test_the_same_id_gives_the_same_arrays():
    first, again = (load_garment("Tops_LongSleeve/000123") for _ in range(2))
    assert first.name == "Tops_LongSleeve/000123"
    assert first.parameters == again.parameters
    assert first.landmarks == again.landmarks
    for name in ("vertices", "faces", "rest_vertices", "canonical", "face_panels"):
        assert np.array_equal(getattr(first, name), getattr(again, name))


def test_ids_differ_in_their_garments():
    first, second = load_garment("Tops_LongSleeve/000000"), load_garment("Tops_LongSleeve/008000")
    assert first.parameters != second.parameters


def test_splits_are_disjoint():
    for category in list_categories():
        train, test = garment_ids(category, "train"), garment_ids(category, "test")
        assert len(set(train)) == 8000
        assert len(set(test)) == 2000
        assert not set(train) & set(test)
        assert garment_ids(category, "train", count=100) == train[:100]


@pytest.mark.parametrize(
    "garment_id",
    ["Tops_LongSleeve", "Tops_LongSleeve/12", "Tops_LongSleeve/010000", "Tops_LongSleeve/00000a"],
)
def test_unknown_numbers_are_refused(garment_id):
    with pytest.raises(AssetNotFoundError, match="six digits from 000000 to 009999"):
        load_garment(garment_id)


def test_unknown_categories_and_splits_are_refused():
    with pytest.raises(AssetNotFoundError, match=r"unknown category 'Sock'.*Tops_LongSleeve"):
        load_garment("Sock/000000")
    with pytest.raises(AssetNotFoundError, match="unknown category 'Sock'"):
        garment_ids("Sock", "train")
    with pytest.raises(ValueError, match=r"split must be one of \['test', 'train'\]; got 'all'"):
        garment_ids("Tops_LongSleeve", "all")
    with pytest.raises(ValueError, match=r"count must be in \[0, 2000\].* got 2001"):
        garment_ids("Tops_LongSleeve", "test", count=2001)


def test_exports_resolve():
    names = [name for name in vars(dgl_assets) if not name.startswith("_")]
    assert {"Garment", "TopParameters", "make_top", "sample_top", "correspond"} <= set(names)


def test_the_example_runs(tmp_path):
    spec = importlib.util.spec_from_file_location("make_top_example", EXAMPLE)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    path = module.main(tmp_path / "top.obj")
    lines = path.read_text().splitlines()
    top = load_garment("Tops_LongSleeve/000123")
    assert sum(line.startswith("v ") for line in lines) == len(top.vertices)
    assert sum(line.startswith("f ") for line in lines) == len(top.faces)
