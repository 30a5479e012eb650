import numpy as np
import pytest

from dgl_gam import choose_pair

CLOUD = np.array([[-0.3, 0.0, 0.0], [-0.25, 0.0, 0.4], [0.1, 0.0, 0.0], [0.3, 0.0, 0.0]])
# both points look most like places on the left, as in a heap whose right side is hardly seen
SIMILARITY = np.array([[0.9, 0.7, 0.1, 0.2], [0.6, 0.8, 0.3, 0.5]])
FOUND = SIMILARITY.argmax(axis=1)


@pytest.mark.parametrize(
    ("apart", "pair"),
    [
        (0.049, [0, 1]),  # they are as far, and height does not count
        (0.051, [0, 3]),  # 0.9 + 0.5, not 0.2 + 0.8
        (0.55, [0, 3]),
        (0.61, [0, 1]),  # nothing is as far
    ],
)
def test_two_points_are_found_at_two_places(apart, pair):
    np.testing.assert_array_equal(choose_pair(FOUND, SIMILARITY, CLOUD, apart=apart), pair)


def test_what_is_far_enough_apart_stays_as_it_was_found():
    np.testing.assert_array_equal(choose_pair([2, 0], SIMILARITY, CLOUD, apart=0.4), [2, 0])


@pytest.mark.parametrize(
    ("found", "similarity", "cloud"),
    [
        (FOUND, SIMILARITY[:, :3], CLOUD),
        (FOUND, SIMILARITY[:1], CLOUD),
        (FOUND[:1], SIMILARITY, CLOUD),
        (FOUND, SIMILARITY, CLOUD[:, :2]),
    ],
)
def test_shapes_must_fit(found, similarity, cloud):
    with pytest.raises(ValueError, match="found must have shape"):
        choose_pair(found, similarity, cloud, apart=0.15)
