"""The dense reward as a function of numbers."""

import dataclasses

import numpy as np
import pytest

from dgl_tasks.reward import CALM_SPEED, REACH_SCALE, compute_reward_terms
from dgl_tasks.success import Criterion, Verdict

START, THRESHOLD = 0.4, 0.8


def compute(
    value=START,
    *,
    distances=(0.3, 0.5),
    is_released=True,
    speed=0.0,
    start=START,
    comparison=">=",
    others=(),
    others_start=None,
):
    share = Criterion(name="share", value=value, comparison=comparison, threshold=THRESHOLD)
    share_then = dataclasses.replace(share, value=start)
    return compute_reward_terms(
        Verdict(criteria=(share, *others)),
        start=Verdict(criteria=(share_then, *(others if others_start is None else others_start))),
        distances=np.array(distances),
        is_released=is_released,
        speed=speed,
    )


@pytest.mark.parametrize(
    ("value", "progress"), [(0.2, 0.0), (START, 0.0), (0.6, 0.5), (0.79, 0.975), (0.8, 1.0), (1, 1)]
)
def test_progress_goes_from_the_start_to_the_threshold(value, progress):
    assert compute(value).progress == pytest.approx(progress)


@pytest.mark.parametrize(
    ("value", "progress"),
    [(1.4, 0.0), (1.2, 0.0), (1.0, 0.5), (0.81, 0.975), (0.8, 1.0), (0.3, 1.0)],
)
def test_progress_goes_down_where_less_is_wanted(value, progress):
    assert compute(value, start=1.2, comparison="<=").progress == pytest.approx(progress)


def test_a_start_beyond_the_threshold_leaves_no_way():
    assert compute(0.7, start=0.9).progress == 0.0
    assert compute(0.85, start=0.9).progress == 1.0
    assert compute(0.9, start=0.7, comparison="<=").progress == 0.0
    assert compute(0.75, start=0.7, comparison="<=").progress == 1.0


@pytest.mark.parametrize(("comparison", "worse"), [(">", 0.7), ("<", 0.9)])
def test_a_start_at_the_threshold_leaves_no_way(comparison, worse):
    assert compute(worse, start=THRESHOLD, comparison=comparison).progress == 0.0


def test_hands_are_drawn_to_the_garment_until_the_rule_is_met():
    reaches = [compute(distances=(d, d)).reach for d in (1.0, 0.5, 0.1, 0.0)]
    assert reaches == sorted(reaches)
    assert reaches[-1] == 1.0
    assert compute(distances=(REACH_SCALE, 0.0)).reach == pytest.approx(1 - np.tanh(1) / 2)
    assert compute(THRESHOLD, distances=(1.0, 1.0)).reach == 1.0


def test_rest_counts_once_the_rule_is_met_and_the_hands_have_let_go():
    assert compute(0.79).rest == 0.0
    assert compute(THRESHOLD, is_released=False).rest == 0.0
    assert compute(THRESHOLD).rest == 1.0
    assert compute(THRESHOLD, speed=CALM_SPEED).rest == pytest.approx(np.exp(-1))


def test_a_rule_is_met_once_all_its_criteria_are():
    high, low = (
        Criterion(name="height", value=value, comparison="<", threshold=0.3) for value in (0.4, 0.2)
    )
    partly, wholly = (compute(THRESHOLD, others=(other,)) for other in (high, low))
    assert wholly.progress == wholly.rest == wholly.reach == 1.0
    assert partly.rest == 0.0
    assert partly.reach < 0.5
    assert partly.normalized < 0.75 < wholly.normalized


@pytest.mark.parametrize(("height", "share"), [(0.7, 0.0), (0.5, 0.5), (0.4, 0.75), (0.2, 1.0)])
def test_progress_is_the_mean_of_all_criteria(height, share):
    """A raised garment has not reached its place yet."""
    now, then = (
        Criterion(name="height", value=value, comparison="<", threshold=0.3)
        for value in (height, 0.7)
    )
    terms = compute(THRESHOLD, others=(now,), others_start=(then,))
    assert terms.progress == pytest.approx((1.0 + share) / 2)


def test_the_sum_is_bounded_and_highest_for_what_is_done():
    assert compute(1.0).normalized == 1.0
    assert compute(1.0).dense == 4.0
    assert compute(distances=(50.0, 50.0)).normalized < 1e-6
    not_yet = [compute(v, distances=(0, 0)).normalized for v in (0.4, 0.6, 0.799)]
    assert not_yet == sorted(not_yet)
    assert not_yet[-1] < 0.75 <= compute(THRESHOLD, is_released=False).normalized


@pytest.mark.parametrize(
    "change", [{"distances": (np.nan, 0)}, {"distances": (-1, 0)}, {"speed": -1}, {"value": np.inf}]
)
def test_numbers_that_cannot_be_are_refused(change):
    with pytest.raises(ValueError, match="must be finite"):
        compute(**change)
