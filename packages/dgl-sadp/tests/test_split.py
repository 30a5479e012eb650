import numpy as np
import pytest

import dgl_sadp
from dgl_sadp import split_episodes


@pytest.mark.parametrize(("n", "count"), [(2, 1), (50, 1), (100, 2), (1000, 20)])
def test_two_percent_and_at_least_one_are_for_validation(n, count):
    train, validation = split_episodes(n)
    assert len(validation) == count
    np.testing.assert_array_equal(np.sort(np.concatenate([train, validation])), np.arange(n))


def test_some_episode_is_left_to_train_on():
    train, validation = split_episodes(3, fraction=0.99)
    assert (len(train), len(validation)) == (1, 2)


def test_the_seed_decides():
    first, again, other = (split_episodes(1000, seed=seed)[1] for seed in (0, 0, 1))
    np.testing.assert_array_equal(first, again)
    assert set(first) != set(other)


@pytest.mark.parametrize("n", [-1, 0, 1])
def test_too_few_episodes_are_refused(n):
    with pytest.raises(ValueError, match=f"got {n}"):
        split_episodes(n)


@pytest.mark.parametrize("fraction", [0.0, 1.0, -0.1, float("nan")])
def test_fractions_out_of_range_are_refused(fraction):
    with pytest.raises(ValueError, match=r"fraction must lie in \(0, 1\)"):
        split_episodes(10, fraction)


def test_exports_resolve():
    assert all(hasattr(dgl_sadp, name) for name in dgl_sadp.__all__)
