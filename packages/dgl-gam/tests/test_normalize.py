import numpy as np
import pytest

from dgl_gam import normalize_cloud


def cloud_of(seed: int = 0, count: int = 200) -> np.ndarray:
    return np.random.default_rng(seed).uniform((-0.3, 0.2, 0.0), (0.5, 1.4, 0.1), (count, 3))


def test_mean_is_zero_and_the_longer_side_is_two():
    points, _ = normalize_cloud(cloud_of())
    np.testing.assert_allclose(points.mean(axis=0), 0.0, atol=1e-12)
    extent = np.ptp(points[:, :2], axis=0)
    assert extent.max() == pytest.approx(2.0)
    assert extent.min() < 2.0


def test_shifted_and_scaled_clouds_become_equal():
    cloud = cloud_of()
    moved = 1.7 * cloud + np.array([3.0, -2.0, 0.5])
    np.testing.assert_allclose(normalize_cloud(moved)[0], normalize_cloud(cloud)[0], atol=1e-9)


def test_height_does_not_enter_into_the_scale():
    cloud = cloud_of()
    tall = cloud * (1.0, 1.0, 100.0)
    assert normalize_cloud(tall)[1].scale == normalize_cloud(cloud)[1].scale


def test_invert_undoes_apply_also_for_other_points():
    _, normalization = normalize_cloud(cloud_of())
    others = cloud_of(seed=1)
    np.testing.assert_allclose(
        normalization.invert(normalization.apply(others)), others, atol=1e-12
    )
    assert normalization.apply(np.zeros((0, 3))).shape == (0, 3)


def test_a_line_along_one_axis_has_a_scale():
    line = np.zeros((5, 3))
    line[:, 1] = np.linspace(0, 0.5, 5)
    assert normalize_cloud(line)[1].scale == pytest.approx(4.0)


def test_the_cloud_is_not_changed():
    cloud = cloud_of()
    before = cloud.copy()
    normalize_cloud(cloud)
    np.testing.assert_array_equal(cloud, before)


@pytest.mark.parametrize(
    ("cloud", "message"),
    [
        (np.zeros((4, 2)), r"shape \(N, 3\); got \(4, 2\)"),
        (np.zeros((0, 3)), "at least 1 point"),
        (np.zeros((4, 3)), "extent in x or y"),
        (np.ones((1, 3)), "extent in x or y"),
        (np.array([[0.0, 0, 0], [np.nan, 1, 0]]), "finite; got 1 point"),
    ],
)
def test_clouds_without_a_normal_form_are_refused(cloud, message):
    with pytest.raises(ValueError, match=message):
        normalize_cloud(cloud)
