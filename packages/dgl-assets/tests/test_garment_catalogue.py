"""The catalogue, the package's exports, and the example."""

import dataclasses
import importlib.util
from pathlib import Path

import numpy as np
import pytest

import dgl_assets
from dgl_assets import (
    AssetNotFoundError,
    choose_categories,
    garment_ids,
    list_categories,
    load_garment,
    sample_measures,
)
from dgl_assets.garments.registry import get_category

EXAMPLES = Path(__file__).parents[1] / "examples"


@pytest.fixture(scope="module", autouse=True)
def garments_made_once():
    """Make each garment anew: equal ids must give equal arrays."""


def test_the_same_id_gives_the_same_arrays():
    first, again = (load_garment("Tops_LongSleeve/000123", spacing=0.02) for _ in range(2))
    assert first.name == "Tops_LongSleeve/000123"
    assert first.parameters == again.parameters
    assert first.landmarks == again.landmarks
    for name in ("vertices", "faces", "rest_vertices", "canonical", "face_panels"):
        assert np.array_equal(getattr(first, name), getattr(again, name))


def test_ids_differ_in_their_garments():
    first, second = (load_garment(f"Scarf/{number}") for number in ("000000", "008000"))
    assert first.parameters != second.parameters


def test_splits_and_sizes_are_disjoint():
    for category in list_categories():
        groups = [
            set(garment_ids(category, split, sizes=sizes))
            for split in ("train", "test")
            for sizes in ("reach", "all")
        ]
        assert [len(group) for group in groups] == [8000, 8000, 2000, 2000]
        assert len(set().union(*groups)) == 20000
        train = garment_ids(category, "train")
        assert garment_ids(category, "train", count=100) == train[:100]


def test_the_papers_counts_are_a_named_subset():
    for category, train, everything in (
        ("Tops_LongSleeve", 100, 247),
        ("Tops_NoSleeve", 100, 217),
        ("Tops_FrontOpen", 40, 78),
        ("Dress_LongSleeve", 26, 38),
        ("Trousers", 100, 317),
        ("Scarf", 8, 8),
        ("Baseball_Cap", 12, 12),
        ("Bowl_Hat", 8, 8),
        ("Glove", 0, 17),
    ):
        seen = garment_ids(category, "train", subset="paper")
        unseen = garment_ids(category, "test", subset="paper")
        assert len(seen) == train
        assert len(seen) + len(unseen) == everything
        assert not set(seen) & set(unseen)


def test_there_are_at_least_2500_distinct_garments():
    ids = [i for c in list_categories() for s in ("train", "test") for i in garment_ids(c, s)]
    assert len(set(ids)) >= 2500
    for category in list_categories():  # measures differ: equal ones would make equal garments
        drawn = {sample_measures(category, number, sizes="all") for number in range(6)}
        assert len(drawn) == 6


def test_unknown_numbers_are_refused():
    for garment_id in (
        "Tops_LongSleeve",
        "Tops_LongSleeve/12",
        "Tops_LongSleeve/020000",
        "Trousers/00000a",
    ):
        with pytest.raises(AssetNotFoundError, match="six digits from 000000 to 019999"):
            load_garment(garment_id)


def test_a_category_whose_counts_contradict_each_other_is_refused():
    scarf = get_category("Scarf")
    with pytest.raises(ValueError, match="paper_train must be in"):
        dataclasses.replace(scarf, paper_train=9)
    with pytest.raises(ValueError, match="must fit into 4 for training"):
        dataclasses.replace(scarf, train_count=4)


def test_unknown_categories_and_splits_are_refused():
    with pytest.raises(AssetNotFoundError, match=r"unknown category 'Sock'.*Tops_LongSleeve"):
        load_garment("Sock/000000")
    with pytest.raises(AssetNotFoundError, match="unknown category 'Sock'"):
        garment_ids("Sock", "train")
    for measures, message in (
        ({"hand": "third"}, "no garment of Glove has the measures"),
        ({"leg": (0.0, 1.0)}, "measures of Glove are .*; got .'leg'"),
    ):
        with pytest.raises(ValueError, match=message):
            garment_ids("Glove", "test", count=20, measures=measures)
    with pytest.raises(ValueError, match=r"split must be one of \('test', 'train'\); got 'all'"):
        garment_ids("Tops_LongSleeve", "all")
    with pytest.raises(ValueError, match=r"count must be in \[0, 2000\].* got 2001"):
        garment_ids("Tops_LongSleeve", "test", count=2001)
    with pytest.raises(ValueError, match=r"sizes must be one of \('reach', 'all'\); got 'huge'"):
        garment_ids("Scarf", "train", sizes="huge")
    with pytest.raises(ValueError, match="subset must be None or 'paper'; got 'mine'"):
        garment_ids("Scarf", "train", subset="mine")


def test_categories_are_chosen_in_the_catalogues_order():
    assert choose_categories() == list_categories()
    assert choose_categories(["Scarf", "Trousers"]) == ("Trousers", "Scarf")
    with pytest.raises(ValueError, match=r"unknown category 'Scraf'; did you mean Scarf\?"):
        choose_categories(["Scraf"])
    with pytest.raises(ValueError, match="unknown category 'x'; they are: Tops_LongSleeve, "):
        choose_categories(["x"])


def test_exports_resolve():
    assert {"Garment", "TopParameters", "make_garment", "sample_measures", "correspond"} <= set(
        dgl_assets.__all__
    )
    assert all(getattr(dgl_assets, name).__name__ == name for name in dgl_assets.__all__)
    with pytest.raises(AttributeError, match="no attribute 'make_sock'"):
        dgl_assets.make_sock  # noqa: B018


def _load_example(name: str):
    spec = importlib.util.spec_from_file_location(f"{name}_example", EXAMPLES / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_example_of_a_top_runs(tmp_path, monkeypatch):
    example = _load_example("make_top")
    tops = {
        number: load_garment(f"Tops_LongSleeve/{number}", spacing=0.02)
        for number in ("000123", "000007")
    }
    monkeypatch.setattr(example, "load_garment", lambda name: tops[name.split("/")[1]])
    lines = example.main(tmp_path / "top.obj").read_text().splitlines()
    assert sum(line.startswith("v ") for line in lines) == len(tops["000123"].vertices)
    assert sum(line.startswith("f ") for line in lines) == len(tops["000123"].faces)


def test_the_example_of_the_catalogue_runs(tmp_path, monkeypatch):
    example = _load_example("draw_catalogue")
    glove = load_garment("Glove/000000")
    monkeypatch.setattr(example, "load_garment", lambda _: glove)
    paths = example.main(tmp_path, count=1, size=32)
    assert [path.stem for path in paths] == list(list_categories())
    assert all(path.exists() for path in paths)


def test_garments_of_some_measures_are_those_that_have_them():
    measures = {"hand": "right", "cuff_length": (0.05, 0.12)}
    chosen = garment_ids("Glove", "test", count=40, measures=measures)
    every = garment_ids("Glove", "test", count=40)
    assert 0 < len(chosen) < len(every)
    for garment_id in every:
        found = load_garment(garment_id).parameters
        fits = found["hand"] == "right" and 0.05 <= found["cuff_length"] <= 0.12
        assert (garment_id in chosen) == fits
