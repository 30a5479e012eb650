import numpy as np
import pytest

from dgl_gam import compute_affordance


def test_columns_span_zero_to_one_and_keep_the_order():
    similarity = np.array([[-1.0, 0.0, 1.0], [0.4, 0.2, 0.3]], dtype=np.float32)
    affordance = compute_affordance(similarity)
    assert affordance.shape == (3, 2)
    assert affordance.dtype == np.float32
    np.testing.assert_allclose(affordance, [[0.0, 1.0], [0.5, 0.0], [1.0, 0.5]], atol=1e-6)


def test_columns_do_not_influence_each_other():
    rng = np.random.default_rng(0)
    similarity = rng.uniform(-1, 1, (2, 50))
    both = compute_affordance(similarity)
    np.testing.assert_array_equal(both[:, :1], compute_affordance(similarity[:1]))
    np.testing.assert_array_equal(both[:, 1:], compute_affordance(similarity[1:]))


def test_result_does_not_depend_on_offset_and_gain():
    similarity = np.random.default_rng(1).uniform(-1, 1, (2, 50))
    expected = compute_affordance(similarity)
    np.testing.assert_allclose(compute_affordance(3.0 * similarity - 5.0), expected, atol=1e-6)


@pytest.mark.parametrize("similarity", [np.full((2, 7), 0.3), np.ones((1, 1))])
def test_equal_similarities_prefer_no_point(similarity):
    affordance = compute_affordance(similarity)
    assert affordance.shape == similarity.T.shape
    np.testing.assert_array_equal(affordance, 0.0)


def test_no_grasp_point_gives_no_column():
    assert compute_affordance(np.zeros((0, 5))).shape == (5, 0)


@pytest.mark.parametrize(
    ("similarity", "message"),
    [
        (np.zeros(5), r"shape \(K, M\).*got \(5,\)"),
        (np.zeros((2, 0)), r"M >= 1; got \(2, 0\)"),
        (np.array([[0.0, np.nan]]), "finite"),
        (np.array([[0.0, np.inf]]), "finite"),
    ],
)
def test_wrong_similarities_are_refused(similarity, message):
    with pytest.raises(ValueError, match=message):
        compute_affordance(similarity)
