"""The search for parameters: its score, its regression, and whole searches on a stand-in."""

import json
import sys

import numpy as np
import pytest

from dgl_collect import OutputFolderError
from dgl_collect.demonstration import FOLDER
from dgl_collect.errors import DemonstrationError
from dgl_collect.options import RunOptions
from dgl_collect.results import ATTEMPTS_FILE, AttemptResult, read_results
from dgl_collect.tuning import search
from dgl_collect.tuning.regression import fit_response
from dgl_collect.tuning.search import TUNED_FILE, TuneConfig, tune
from dgl_collect.tuning.trials import compute_score
from dgl_collect.video import save_png
from dgl_tasks.success import Criterion

PARAMETERS = json.loads((FOLDER / "FlingTops.json").read_text())["parameters"]
BEST = {"along": 1.2, "back": 1.3, "drag": 0.2}
"""Values at which the stand-in succeeds; the others do not matter."""


def make_criteria(*margins):
    return tuple(
        Criterion(name="x", value=2 * (1 + m), comparison=">=", threshold=2.0) for m in margins
    )


def make_result(*criteria):
    return AttemptResult(index=0, seed=0, success=False, reason="x", criteria=criteria)


def measure_squares(values):
    """Squared distance from the best values, in units of the ranges."""
    sizes = {name: np.ptp(PARAMETERS[name]["range"]) for name in BEST}
    return sum(((values[name] - best) / sizes[name]) ** 2 for name, best in BEST.items())


class StandIn:
    """Trials whose rule measures the distance of three parameters from their best values."""

    def __init__(self, task, options):
        """Take what trials are made with."""

    def run(self, request, out_dir):
        squares = measure_squares(request.values)
        hard = 0.1 * np.random.default_rng(request.seed).random()
        (criterion,) = make_criteria(0.08 - 0.6 * squares - hard)
        files = {}
        if request.has_picture:
            files = {"picture": f"{request.episode_id}.png"}
            save_png(out_dir / files["picture"], np.zeros((120, 160, 3), np.uint8))
        return AttemptResult(
            index=request.index, seed=request.seed, success=criterion.is_met, files=files,
            first_try=criterion.is_met, reason=None if criterion.is_met else "short",
            value=criterion.value, criteria=(criterion,),
            randomisation={"split": request.split, "start": request.start},
        )  # fmt: skip

    def close(self):
        pass


@pytest.fixture
def run(tmp_path, fakes, monkeypatch):
    fakes.work_here(monkeypatch)
    monkeypatch.setattr(search, "FACTORY", "test_tuning_standin:StandIn")
    monkeypatch.setitem(sys.modules, "test_tuning_standin", sys.modules[__name__])

    def go(*, on_progress=None, out=tmp_path / "out", **changes):
        settings = {"generations": 8, "candidates": 10, "starts": 3, "judged": 20}
        config = TuneConfig(task="FlingTops-v1", out=out, **(settings | changes))
        return tune(config, on_progress=on_progress)

    return go


def test_the_score_rises_from_far_below_the_threshold_to_just_above():
    for margin, score in ((-0.9, 0), (-0.4, 0), (-0.2, 0.4), (0, 0.8), (0.05, 0.9), (0.3, 1)):
        assert compute_score(make_result(*make_criteria(margin))) == pytest.approx(score)
    assert compute_score(make_result(*make_criteria(0.3, -0.2, 0.1))) == pytest.approx(0.4)
    below = Criterion(name="x", value=1.5, comparison="<", threshold=1.25)
    assert compute_score(make_result(below)) == pytest.approx(0.4)
    assert compute_score(make_result()) == 0
    for links, score in ((0, 0.9), (1, 0)):  # a threshold of 0 has no better side
        touching = Criterion(name="links", value=links, comparison="<=", threshold=0)
        assert compute_score(make_result(touching, *make_criteria(0.05))) == pytest.approx(score)


def test_the_regression_finds_what_matters_beside_hard_starts():
    rng = np.random.default_rng(0)
    values, starts = rng.uniform(0.2, 0.8, (400, 3)), np.repeat(np.arange(40), 10)
    hard = rng.normal(0, 0.3, 40)[starts]
    scores = 0.5 - 3 * (values[:, 0] - 0.65) ** 2 + 0.4 * values[:, 1] + hard
    scores += rng.normal(0, 0.02, 400)
    found = fit_response(values, starts, scores, reference=np.full(3, 0.5))
    assert found.best[0] == pytest.approx(0.65, abs=0.05)
    assert found.best[1] == pytest.approx(0.77, abs=0.05)  # the highest that was tried
    assert found.t_values[1] > 5 > 3 > abs(found.t_values[2])
    assert found.predict(np.array([0.65, 0.5, 0.5])) == pytest.approx(found.gains[0], abs=0.01)
    assert found.predict(np.full(3, 0.5)) == 0
    with pytest.raises(ValueError, match="needs 20 trials or more; got 19"):
        fit_response(values[:19], starts[:19], scores[:19], reference=np.full(3, 0.5))


def test_a_search_finds_better_values_and_judges_them_on_other_starts(run, tmp_path):
    told = []
    tuning = run(on_progress=told.append)
    assert measure_squares(tuning.after) < 0.5 * measure_squares(tuning.before)
    more = tuning.succeeded_after - tuning.succeeded_before
    assert tuning.only_after - tuning.only_before == more > 0
    assert tuning.p_value < 0.05
    assert tuning.is_better
    order = np.argsort(-np.abs(tuning.response.t_values))
    assert tuning.names[order[0]] in BEST
    tuned = json.loads((tmp_path / "out" / TUNED_FILE).read_text())
    assert {n: p["value"] for n, p in tuned["parameters"].items()} == dict(tuning.after)
    results = read_results(tmp_path / "out" / ATTEMPTS_FILE)
    searched = [r for r in results if r.randomisation["start"] < 1000]
    judged = [r for r in results if r.randomisation["start"] >= 1000]
    assert len(searched) == tuning.trials == 8 * (2 * 11 + 6)
    assert {r.randomisation["split"] for r in searched} == {"train"}
    assert [r.randomisation["split"] for r in judged[::2]] == ["train", "test"] * 10
    assert len({r.seed for r in judged}) == 20  # a pair has one start
    assert told[-1].made == told[-1].wanted == len(results)
    assert [told[0].resumed, told[-1].resumed] == [0, 0]
    assert 0 <= told[0].seconds < told[-1].seconds


def test_an_interrupted_search_goes_on_to_the_same_winner(run, tmp_path):
    whole = run(out=tmp_path / "whole", generations=3)

    def stop(progress):
        if progress.made == 50:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run(on_progress=stop, generations=3)
    assert len(read_results(tmp_path / "out" / ATTEMPTS_FILE)) == 50
    with pytest.raises(OutputFolderError, match="not empty"):
        run(generations=3)
    with pytest.raises(OutputFolderError, match="candidates"):
        run(generations=3, candidates=12, resume=True)
    again = run(generations=3, resume=True)
    assert again.after == whole.after
    assert again.succeeded_after == whole.succeeded_after
    assert sorted(r.index for r in read_results(tmp_path / "out" / ATTEMPTS_FILE)) == list(
        range(again.trials + 40)
    )


def test_what_cannot_be_searched_is_refused(run, tmp_path):
    for changes, message in (
        ({"generations": 0}, "generations must be at least 1; got 0"),
        ({"candidates": 3}, "candidates must be at least 4; got 3"),
        ({"generations": 1, "candidates": 5, "starts": 1}, "needs 20 trials or more; got 6"),
        ({"judged": -1}, "judged must be at least 0; got -1"),
    ):
        with pytest.raises(ValueError, match=message):
            run(**changes)
    content = json.loads((FOLDER / "FlingTops.json").read_text())
    file = tmp_path / "mine.json"
    file.write_text(json.dumps(content | {"parameters": {}}))
    with pytest.raises(DemonstrationError, match="a point must be three numbers"):
        run(options=RunOptions(demonstration=file))
    fold = FOLDER / "FoldTops.json"
    with pytest.raises(DemonstrationError, match="must be 'FlingTops-v1'"):
        run(options=RunOptions(demonstration=fold))
    with pytest.raises(DemonstrationError, match="names none, those of FlingDress-v1, Fl"):
        tune(TuneConfig(task="FoldTops-v1", out=tmp_path / "out"))
    assert not (tmp_path / "out").exists()
