"""Weights and clouds in the wheel; these tests need nothing else."""

import importlib.util
import re
from pathlib import Path

import numpy as np
import pytest

from dgl_gam import GarmentAffordanceModel
from dgl_gam.data.correspondence import compute_places
from dgl_gam.evaluate import EvalConfig, evaluate
from dgl_gam.model import WEIGHTS
from dgl_gam.samples import SAMPLES, list_samples, load_samples

CATEGORIES = (
    "Baseball_Cap", "Bowl_Hat", "Dress_LongSleeve", "Glove", "Scarf",
    "Tops_FrontOpen", "Tops_LongSleeve", "Tops_NoSleeve", "Trousers",
)  # fmt: skip
HAT = "Bowl_Hat"
"""Looks alike from all sides, but for its brim."""


def find_landmarks(category):
    """Errors of landmarks visible on both flat samples, as shares of the diagonal."""
    shown, seen = load_samples(category)
    model = GarmentAffordanceModel.load(category)
    source, target = shown.view_points[0], seen.view_points[0]
    places = [compute_places(g)[g.landmarks] for g in (shown, seen)]
    visible = [compute_places(g)[g.view_vertices[0]] for g in (shown, seen)]
    is_seen = np.ones(len(places[0]), bool)
    for own, points in zip(places, visible, strict=True):
        is_seen &= np.linalg.norm(own[:, None] - points[None], axis=2).min(axis=1) < 0.03
    wanted = shown.states[0][shown.landmarks[is_seen]]
    indices, similarity = model.match(source, wanted, target)
    assert similarity.shape == (is_seen.sum(), len(target))
    truth = seen.states[0][seen.landmarks[is_seen]]
    return np.linalg.norm(target[indices] - truth, axis=1) / seen.diagonal


def test_there_are_samples_of_every_category():
    assert list_samples() == CATEGORIES
    for category in CATEGORIES:
        first, second = load_samples(category)
        assert first.header.garment_id != second.header.garment_id
        assert {g.header.split for g in (first, second)} == {"test"}  # none was trained on
        assert first.header.state_kinds[first.view_state[0]] == "flat"
        assert first.header.view_directions[0] == (0.0, 0.0, 1.0)
    with pytest.raises(ValueError, match=r"category must be one of Baseball_Cap, .*; got 'Tents'"):
        load_samples("Tents")


@pytest.mark.parametrize("category", CATEGORIES)
def test_landmarks_of_one_garment_are_found_on_another(category):
    error = find_landmarks(category)
    assert len(error) >= 4
    assert np.median(error) < (0.15 if category == HAT else 0.05)


def test_the_evaluation_runs_on_the_samples():
    from dgl_gam.data import GarmentFolder

    folder = GarmentFolder(SAMPLES, categories=["Trousers"])
    models = {name: GarmentAffordanceModel.load(name) for name in folder.categories}
    rows = {
        (row.category, row.condition): row
        for row in evaluate(models, folder, EvalConfig(pairs=2, points=20))
    }
    for category in folder.categories:
        assert rows[category, "flat_30"].pck10 > 0.9
        assert rows[category, "flat_30"].swap_rate < 0.05


def test_the_confidence_was_calibrated():
    for category in CATEGORIES:
        assert GarmentAffordanceModel.load(category).checkpoint.calibration.samples > 1000


def test_weights_are_small_and_each_has_its_card():
    files = sorted(WEIGHTS.glob("*.safetensors"))
    assert files
    assert sum(path.stat().st_size for path in files) < 30e6
    for path in files:
        card = path.with_suffix(".md").read_text(encoding="utf-8")
        assert "## How well it works" in card
        assert "| trained on |" in card


def test_the_examples_of_the_readme_run(capsys):
    readme = Path(__file__).parents[1] / "README.md"
    examples = re.findall(r"```python\n(.*?)```", readme.read_text(encoding="utf-8"), re.S)
    names: dict = {}
    for example in examples:
        exec(example, names)
    assert names["indices"].shape == (len(names["points"]),)
    assert names["left_and_right"].shape == (2048, 2)
    assert 0 <= names["left_and_right"].min() <= names["left_and_right"].max() <= 1
    assert "| Tops_LongSleeve | flat_30 | 4 |" in capsys.readouterr().out


@pytest.mark.slow
def test_corners_of_garments_that_the_generator_never_drew_are_found():
    path = Path(__file__).parents[1] / "examples" / "drawn_garments.py"
    spec = importlib.util.spec_from_file_location("drawn_garments", path)
    assert spec is not None
    assert spec.loader is not None
    example = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(example)
    for category, errors in example.main().items():
        assert errors["all"] < 0.045, category
        assert errors["PCK@.10"] > 0.9, category
