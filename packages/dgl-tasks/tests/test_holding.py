"""Tests of holding, on both sides of each limit."""

from types import SimpleNamespace

import numpy as np
import pytest

from dgl_tasks.holding import HELD_DISTANCE, HELD_HEIGHT, find_empty, is_low

LOW = HELD_HEIGHT + HELD_DISTANCE / 2
HANDS = {"left": np.array([-0.4, 0.7, 0.4]), "right": np.array([0.4, 0.7, 0.4])}
LYING = np.array([[-0.4, 0.7, 0.0], [0.4, 0.7, 0.01]])


def sense(**hands):
    return SimpleNamespace(get_grasp_point=(HANDS | hands).__getitem__)


@pytest.mark.parametrize(("height", "expected"), [(LOW - 1e-3, True), (LOW + 1e-3, False)])
def test_what_a_low_hand_holds_need_not_be_raised(height, expected):
    sensed = sense(left=np.array([0.0, 0.7, height]))
    assert is_low(sensed, "left") is expected
    assert not is_low(sensed, "right")
    assert find_empty(sensed, ("left",), LYING) == ({} if expected else {"left": np.inf})


def test_a_hand_is_empty_where_no_raised_cloth_is_near():
    near, far = (HANDS["left"] - [0, 0, d] for d in (HELD_DISTANCE - 0.01, HELD_DISTANCE + 0.01))
    assert find_empty(sense(), ("left",), np.vstack([LYING, near])) == {}
    empty = find_empty(sense(), ("left", "right"), np.vstack([LYING, near]))
    assert list(empty) == ["right"]
    assert empty["right"] > 0.7
    empty = find_empty(sense(), ("left",), np.vstack([LYING, far]))
    assert empty == pytest.approx({"left": HELD_DISTANCE + 0.01})


def test_cloth_that_lies_is_held_by_nobody():
    hand = np.array([-0.4, 0.7, LOW + 0.005])
    for height, expected in ((HELD_HEIGHT - 0.001, {"left": np.inf}), (HELD_HEIGHT + 0.001, {})):
        assert find_empty(sense(left=hand), ("left",), np.array([[-0.4, 0.7, height]])) == expected


def test_only_the_hands_that_are_asked_about_are_told():
    assert find_empty(sense(), (), LYING) == {}
    assert set(find_empty(sense(), ("right",), LYING)) == {"right"}
    assert find_empty(sense(), ("right",), np.zeros((0, 3))) == {"right": np.inf}
