import dataclasses
import json
import math

import numpy as np
import pytest
import torch

from dgl_gam import DataError, GarmentAffordanceModel, Matches
from dgl_gam.card import format_card
from dgl_gam.checkpoint import Checkpoint
from dgl_gam.config import GamLevelConfig, NetworkConfig, YawConfig
from dgl_gam.data import GarmentFolder, write_garment
from dgl_gam.evaluate import EvalConfig, _summarize, calibrate, evaluate, format_markdown
from dgl_gam.network import GarmentNetwork
from dgl_gam.trials import Trial, list_conditions, run_trial

CONFIG = EvalConfig(pairs=2, points=10)
TINY = NetworkConfig(
    levels=(GamLevelConfig(centres=32, radius=0.4, neighbours=8, widths=(16,)),),
    up=((16,),),
    attention_blocks=0,
    attention_heads=1,
    head_width=16,
    features=16,
    yaw=YawConfig(bins=16, rings=4, width=8),
)


@pytest.fixture(scope="module")
def model():
    torch.manual_seed(0)
    config = dataclasses.replace(TINY, categories=("Shirt",))
    return GarmentAffordanceModel(Checkpoint(network=GarmentNetwork(config)))


@pytest.fixture(scope="module")
def folder(shirts):
    return GarmentFolder(shirts)


def answer_with(monkeypatch, choose):
    """Replace the model's matching by a rule: choose(source_points, target_cloud) -> indices."""

    def locate(self, source_cloud, source_points, target_cloud, *, yaw=None):
        indices = choose(source_points, target_cloud)
        count = len(indices)
        return Matches(
            indices=indices,
            similarity=np.zeros((count, len(target_cloud)), np.float32),
            confidence=np.linspace(0, 1, count, dtype=np.float32),
            evidence=np.zeros((count, 4)),
            points=target_cloud[indices],
        )

    monkeypatch.setattr(GarmentAffordanceModel, "locate", locate)


def test_conditions_are_the_flat_ones_and_the_kinds_of_the_files(folder):
    assert list_conditions(folder, "Shirt") == (
        "flat_30",
        "flat_any",
        "noise_half",
        "noise_cut",
        "noise_any",
        "dropped",
    )


def test_what_hangs_is_measured_from_the_front_and_from_anywhere(tmp_path, shirt_fields):
    for seed in (0, 1):
        fields = shirt_fields(seed)
        fields["state_names"] = ["flat", "hung_two_0", "dropped_0"]
        write_garment(tmp_path / f"{seed}.safetensors", **fields)
    found = list_conditions(GarmentFolder(tmp_path), "Shirt")
    assert found[-3:] == ("dropped", "hung_two", "hung_two_any")


def make_disk(rng):
    """A round hat: canonical coordinates are polar, and the state is an oval lying askew."""
    radius = np.sqrt(np.linspace(0.0, 4.0, 900))
    angle = np.arange(900) * 2.399963
    plane = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)
    canonical = np.column_stack([plane, np.ones(900)]).astype(np.float32)
    flat = np.column_stack([0.05 * plane * [1.0, 1.1], 0.05 - 0.02 * radius])
    tilted = flat @ np.array([[1, 0, 0], [0, 0.8, 0.6], [0, -0.6, 0.8]]).T
    seen = rng.integers(900, size=(2, 2048))
    return {
        "category": "Bowl_Hat",
        "split": "test",
        "seed": 0,
        "state_names": ["flat", "tilted_0"],
        "landmark_names": ["brim"],
        "view_directions": np.tile([0.0, 0.0, 1.0], (2, 1)),
        "generator_versions": {"tests": "1"},
        "canonical": canonical,
        "states": np.stack([flat, tilted]).astype(np.float32),
        "faces": np.array([[0, 1, 2]], np.int32),
        "landmarks": np.array([899], np.int32),
        "view_points": np.stack([flat[seen[0]], tilted[seen[1]]]).astype(np.float32),
        "view_vertices": seen.astype(np.int32),
        "view_state": np.array([0, 1]),
    }


@pytest.mark.parametrize("condition", ["flat_any", "tilted"])
def test_a_round_hat_is_judged_by_one_turn_for_all_points(tmp_path, rng, monkeypatch, condition):
    for name in ("Bowl_Hat/0", "Bowl_Hat/1"):
        path = tmp_path / f"{name}.safetensors"
        write_garment(path, garment_id=name, **make_disk(rng))
    hats = GarmentFolder(tmp_path)
    torch.manual_seed(0)
    config = dataclasses.replace(TINY, categories=("Bowl_Hat",))
    model = GarmentAffordanceModel(Checkpoint(network=GarmentNetwork(config)))
    first = hats.load(0)

    def measure(turn, mirror=1.0):
        """Errors of answers turned about the axis, or also mirrored."""
        vertices, current = [], hats.load(1)
        plane = first.canonical[:, :2]
        cos, sin = np.cos(turn), np.sin(turn)
        moved = plane @ np.array([[cos, sin], [-sin, cos]]) * [mirror, 1.0]

        def choose(points, cloud):
            flat = first.states[0]
            source = np.linalg.norm(flat[None] - points[:, None], axis=2).argmin(axis=1)
            goal = np.linalg.norm(moved[source][:, None] - plane[None], axis=2).argmin(axis=1)
            vertices.append(goal)
            view = current.view_vertices[int(condition == "tilted")]
            away = np.linalg.norm(plane[view][None] - plane[goal][:, None], axis=2)
            return away.argmin(axis=1)

        answer_with(monkeypatch, choose)
        errors = {}
        for symmetry in ("", "revolution"):
            trial = run_trial(
                model,
                first,
                current,
                condition,
                CONFIG,
                np.random.default_rng(0),
                symmetry=symmetry,
            )
            assert symmetry == "" or not trial.is_lateral.any()
            errors[symmetry] = trial.error.mean()
        return errors

    true, turned, mirrored = measure(0.0), measure(2.0), measure(2.0, mirror=-1.0)
    assert true[""] < 0.03
    assert turned[""] > 0.3
    assert max(true["revolution"], turned["revolution"]) < 0.04
    assert mirrored["revolution"] > 0.2


def test_a_category_with_a_symmetry_has_both_rows(tmp_path, rng, monkeypatch):
    for name in ("Bowl_Hat/0", "Bowl_Hat/1"):
        path = tmp_path / f"{name}.safetensors"
        write_garment(path, garment_id=name, **make_disk(rng))
    torch.manual_seed(0)
    config = dataclasses.replace(TINY, categories=("Bowl_Hat",))
    model = GarmentAffordanceModel(Checkpoint(network=GarmentNetwork(config)))
    answer_with(monkeypatch, lambda points, cloud: np.zeros(len(points), np.int64))
    rows = evaluate({"Bowl_Hat": model}, GarmentFolder(tmp_path), EvalConfig(pairs=1, points=4))
    kinds = {(row.condition, row.symmetry) for row in rows}
    assert {("flat_30", ""), ("flat_30", "revolution"), ("all", "revolution")} <= kinds
    assert "| Bowl_Hat, by its revolution | flat_30 |" in format_markdown(rows)


def test_a_condition_has_all_its_pairs_where_few_garments_have_the_state(
    model, tmp_path, shirt_fields, monkeypatch
):
    for seed in range(4):
        fields = shirt_fields(seed)
        if seed:
            flat = fields["view_state"] == 0
            fields["states"], fields["state_names"] = fields["states"][:1], ["flat"]
            for name in ("view_points", "view_vertices", "view_state", "view_directions"):
                fields[name] = fields[name][flat]
        write_garment(tmp_path / f"{seed}.safetensors", **fields)
    answer_with(monkeypatch, lambda points, cloud: np.zeros(len(points), np.int64))
    rows = evaluate({"Shirt": model}, GarmentFolder(tmp_path), CONFIG)
    assert {row.condition: row.pairs for row in rows}["dropped"] == CONFIG.pairs


def test_errors_of_a_matcher_that_knows_and_of_one_that_mirrors(model, folder, monkeypatch):
    """Match flat views of one garment: the true point is nearest; mirrored is -x."""
    garment = folder.load(0)
    monkeypatch.setattr("dgl_gam.trials._make_turn", lambda angle: np.eye(3))

    def nearest(points, cloud, sign=1):
        wanted = points[:, None] * [sign, 1, 1]
        return np.linalg.norm(cloud[None] - wanted, axis=2).argmin(axis=1)

    centre = garment.view_points[0].mean(axis=0)
    for sign, share in ((1, 0.0), (-1, 1.0)):
        answer_with(monkeypatch, lambda points, cloud, s=sign: nearest(points, cloud + centre, s))
        trial = run_trial(
            model, garment, garment, "flat_30", EvalConfig(points=60), np.random.default_rng(0)
        )
        assert trial is not None
        lateral = trial.is_lateral & trial.is_visible
        assert lateral.sum() > 30
        assert trial.is_swapped[lateral].mean() == pytest.approx(share, abs=0.05)
        if sign == 1:
            assert np.quantile(trial.error[trial.is_visible], 0.95) < 0.03
            assert not trial.is_hidden.any()
        else:
            assert np.median(trial.error[lateral]) > 0.15
        assert trial.is_landmark.sum() == 5


@pytest.mark.parametrize(
    ("condition", "low", "high"), [("noise_cut", 0.2, 0.6), ("noise_half", 0, 0)]
)
def test_what_is_cut_away_is_hidden_and_what_is_thinned_out_is_not(
    model, folder, condition, low, high
):
    trial = run_trial(
        model, folder.load(0), folder.load(1), condition,
        EvalConfig(points=200), np.random.default_rng(0),
    )  # fmt: skip
    assert trial is not None
    assert low <= trial.is_hidden.mean() <= high
    assert not (trial.is_hidden & trial.is_visible).any()


def test_measures_of_a_row_are_those_of_its_points():
    def make(**changes):
        values = {
            "error": np.array([0.01, 0.07, 0.2, 0.9]),
            "confidence": np.array([0.9, 0.8, 0.3, 0.4]),
            "evidence": np.zeros((4, 4)),
            "is_visible": np.array([True, True, True, False]),
            "is_hidden": np.array([False, False, False, True]),
            "is_landmark": np.array([True, False, False, True]),
            "is_lateral": np.array([False, True, True, True]),
            "is_swapped": np.array([False, False, True, True]),
            "seconds": 0.02,
        }
        return Trial(**{**values, **changes})

    row = _summarize("Shirt", "flat_30", [make(), make(seconds=0.04)])
    assert (row.pairs, row.points, row.hidden) == (2, 6, 2)
    assert row.mean_error == pytest.approx(0.28 / 3)
    assert row.pck05 == pytest.approx(1 / 3)
    assert row.pck10 == pytest.approx(2 / 3)
    assert row.landmark_pck05 == 1
    assert row.swap_rate == 0.5
    assert row.hidden_auroc == pytest.approx(2 / 3)
    assert row.milliseconds == pytest.approx(30)
    none = _summarize("Shirt", "flat_30", [make(is_hidden=np.zeros(4, bool))])
    assert math.isnan(none.hidden_auroc)
    assert none.to_dict()["hidden_auroc"] is None
    table = format_markdown([row, none]).splitlines()
    assert len(table) == 4
    assert table[2].startswith("| Shirt | flat_30 | 2 | 9.3 % | 33.3 % | 66.7 % | 100.0 % |")
    assert table[3].split("|")[-3].strip() == ""


def test_evaluation_covers_every_condition_and_repeats_itself(model, folder):
    rows = evaluate({"Shirt": model}, folder, CONFIG)
    assert [row.condition for row in rows] == [
        *("flat_30", "flat_any", "noise_half", "noise_cut", "noise_any", "dropped"),
        "all",
    ]
    assert rows[-1].points == sum(row.points for row in rows[:-1])
    again = evaluate({"Shirt": model}, folder, CONFIG)
    for first, second in zip(rows, again, strict=True):
        assert dataclasses.replace(first, milliseconds=0) == dataclasses.replace(
            second, milliseconds=0
        ) or math.isnan(first.hidden_auroc)
    json.dumps([row.to_dict() for row in rows], allow_nan=False)
    with pytest.raises(DataError, match="none for Shirt"):
        evaluate({}, folder, CONFIG)


def test_several_categories_have_a_mean(tmp_path, shirt_fields):
    for category in ("Gown", "Shirt"):
        for seed in (0, 1):
            fields = shirt_fields(seed, category=category)
            write_garment(tmp_path / f"{category}{seed}.safetensors", **fields)
    torch.manual_seed(0)
    config = dataclasses.replace(TINY, categories=("Gown", "Shirt"))
    shared = Checkpoint(network=GarmentNetwork(config))
    models = {name: GarmentAffordanceModel(shared, category=name) for name in config.categories}
    rows = evaluate(models, GarmentFolder(tmp_path), EvalConfig(pairs=1, points=5))
    assert [row.category for row in rows] == ["Gown"] * 7 + ["Shirt"] * 7 + ["all"] * 7
    for gown, shirt, mean in zip(rows[:7], rows[7:14], rows[14:], strict=True):
        assert gown.condition == shirt.condition == mean.condition
        assert mean.mean_error == pytest.approx((gown.mean_error + shirt.mean_error) / 2)
        assert mean.points == gown.points + shirt.points


def test_calibration_is_fitted_to_the_folder(model, folder):
    found = calibrate({"Shirt": model}, folder, EvalConfig(pairs=2, points=60))
    assert found.samples > 200
    assert model.with_calibration(found).checkpoint.calibration == found


def test_the_yaw_that_the_model_is_told_is_the_true_one(model, folder, monkeypatch):
    told = []
    kept = GarmentAffordanceModel.locate

    def locate(self, source_cloud, source_points, target_cloud, *, yaw=None):
        told.append((yaw, target_cloud))
        return kept(self, source_cloud, source_points, target_cloud, yaw=yaw)

    monkeypatch.setattr(GarmentAffordanceModel, "locate", locate)
    config = EvalConfig(points=4, is_yaw_known=True)
    for seed in range(3):
        rng = np.random.default_rng(seed)
        for told_or_not in (config, EvalConfig(points=4)):
            run_trial(model, folder.load(0), folder.load(1), "flat_any", told_or_not, rng)
    for yaw, cloud in told[::2]:
        # Turned back, sleeves reach out along x: the cloud is wider than anywhere else.
        widths = []
        for angle in np.radians([0, 45, 90, 135]) - yaw:
            widths.append(np.ptp(cloud[:, 0] * np.cos(angle) - cloud[:, 1] * np.sin(angle)))
        assert np.argmax(widths) == 0
    assert all(yaw is None for yaw, _ in told[1::2])


def test_a_card_names_the_stages_and_has_no_times(model, folder):
    stage = {"garments": 9, "deformed": 9, "steps_done": 6}
    card = {**stage, "train": {"parts": "yaw"}, "earlier": [{**stage, "parts": "all"}]}
    rows = evaluate({"Shirt": model}, folder, EvalConfig(pairs=1, points=2))
    text = format_card("shirts", dataclasses.replace(model.checkpoint, card=card), rows)
    assert (
        "| trained on | 9 garments, 9 of them with deformed states: 6 steps; "
        "then 9 garments, 9 of them with deformed states: 6 steps of the yaw alone |"
    ) in text
    assert "AUROC |\n" in text
    assert " ms |" not in text
