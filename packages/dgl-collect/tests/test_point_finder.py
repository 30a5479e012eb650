"""Points of a demonstration in clouds of another garment, by a matcher that takes one side for the other."""

import numpy as np
import pytest

from dgl_collect.demonstration import load_demonstration
from dgl_collect.point_finder import HANDS_APART, PointFinder
from dgl_tasks import get_task

TASK = get_task("FlingTrousers-v1")
DEMONSTRATION = load_demonstration(TASK.id)
NAMES = list(DEMONSTRATION.points)
CLOUD = np.array([[-0.2, 0.6, 0.1], [-0.18, 0.6, 0.0], [0.0, 0.6, 0.0], [0.2, 0.6, 0.0]])
LEFT, BESIDE, MIDDLE, RIGHT = range(4)
SEES_ONE_SIDE = {"left": [0.9, 0.5, 0.3, 0.1], "right": [0.6, 0.8, 0.2, 0.7]}
SEES_BOTH = {"left": [0.9, 0.5, 0.3, 0.1], "right": [0.1, 0.2, 0.9, 0.7]}


class StubMatcher:
    """Knows how similar each place is to what belongs to a side, whichever point it is."""

    def __init__(self, similarity):
        self.similarity = similarity

    def match(self, source_cloud, source_points, target_cloud):
        sides = []
        for point in source_points:
            (name,) = (n for n in NAMES if np.array_equal(DEMONSTRATION.points[n], point))
            sides.append(self.similarity[name.split("_")[0]])
        similarity = np.array(sides)
        return similarity.argmax(axis=1), similarity


@pytest.mark.parametrize(("similarity", "right"), [(SEES_ONE_SIDE, RIGHT), (SEES_BOTH, MIDDLE)])
def test_points_of_two_hands_are_found_at_two_places(similarity, right):
    assert np.linalg.norm(CLOUD[LEFT] - CLOUD[BESIDE]) < HANDS_APART
    finder, matcher = PointFinder(TASK, DEMONSTRATION, np.zeros((1, 3))), StubMatcher(similarity)
    points = finder.find_points(CLOUD, matcher)
    for name in NAMES:
        place = LEFT if name.startswith("left") else right
        np.testing.assert_array_equal(points[name], CLOUD[place])
    for stage in TASK.stages:
        grasp, seen = finder.find_grasps(stage, CLOUD, matcher)
        np.testing.assert_array_equal(grasp["left"], CLOUD[LEFT])
        np.testing.assert_array_equal(grasp["right"], CLOUD[right])
        np.testing.assert_array_equal(seen, [similarity["left"], similarity["right"]])


def test_of_one_hand_the_most_similar_point_is_taken():
    task = get_task("FoldTops-v1")
    demonstration = load_demonstration(task.id)

    class Same:
        def match(self, source_cloud, source_points, target_cloud):
            similarity = np.tile(SEES_ONE_SIDE["right"], (len(source_points), 1))
            return similarity.argmax(axis=1), similarity

    finder = PointFinder(task, demonstration, np.zeros((1, 3)))
    grasp, _ = finder.find_grasps(task.stages[0], CLOUD, Same())
    assert list(grasp) == ["left"]
    np.testing.assert_array_equal(grasp["left"], CLOUD[BESIDE])
