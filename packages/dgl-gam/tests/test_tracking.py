import numpy as np
import pytest

from dgl_gam import GamError, restrict_to_places

CLOUD = np.array([[-0.3, 0.0, 0.0], [-0.2, 0.0, 0.4], [0.2, 0.0, 0.0], [0.3, 0.0, 0.0]])
# the left point looks most like one on the right, as on a garment that has been folded
SIMILARITY = np.array([[0.5, 0.7, 0.9, 0.2]])
LEFT = np.array([[-0.3, 0.0, 0.0]])


def test_the_best_near_its_place_is_taken_and_nothing_else_stands_out():
    found, similarity = restrict_to_places(SIMILARITY, CLOUD, LEFT, radius=0.15)
    np.testing.assert_array_equal(found, [1])  # height does not matter
    np.testing.assert_array_equal(similarity, [[0.5, 0.7, 0.2, 0.2]])


def test_the_radius_counts():
    narrow, _ = restrict_to_places(SIMILARITY, CLOUD, LEFT, radius=0.09)
    wide, _ = restrict_to_places(SIMILARITY, CLOUD, LEFT, radius=0.51)
    assert (narrow[0], wide[0]) == (0, 2)


def test_each_point_has_its_own_place():
    places = np.concatenate([LEFT, -LEFT])
    found, _ = restrict_to_places(np.repeat(SIMILARITY, 2, axis=0), CLOUD, places, radius=0.15)
    np.testing.assert_array_equal(found, [1, 2])


def test_a_garment_that_has_gone_is_named():
    with pytest.raises(GamError, match=r"within 0.15 m of \(0.00, 1.00\) m"):
        restrict_to_places(SIMILARITY, CLOUD, np.array([[0.0, 1.0, 0.0]]), radius=0.15)


@pytest.mark.parametrize(
    ("similarity", "cloud"),
    [(SIMILARITY[:, :3], CLOUD), (SIMILARITY[0], CLOUD), (SIMILARITY, CLOUD[:, :2])],
)
def test_shapes_must_fit(similarity, cloud):
    with pytest.raises(ValueError, match="similarity must have shape"):
        restrict_to_places(similarity, cloud, LEFT, radius=0.15)
