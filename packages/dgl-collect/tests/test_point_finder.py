"""Search for points on other garments: mirrored matches, garments face down, moved garments."""

import dataclasses

import numpy as np
import pytest

from dgl_assets.robots import SIDES
from dgl_collect.demonstration import load_demonstration
from dgl_collect.point_finder import APART, HANDS_APART, PLACE_SCALE, PointFinder
from dgl_collect.steps import Approach, Grasp, Stage
from dgl_tasks.errors import PerceptionError

DEMONSTRATION = load_demonstration("FlingTrousers-v1")
NAMES = list(DEMONSTRATION.points)
CLOUD = np.array([[-0.2, 0.6, 0.1], [-0.18, 0.6, 0.0], [0.0, 0.6, 0.0], [0.2, 0.6, 0.0]])
LEFT, BESIDE, MIDDLE, RIGHT = range(4)
SEES_ONE_SIDE = {"left": [0.9, 0.5, 0.3, 0.1], "right": [0.6, 0.8, 0.2, 0.7]}
SEES_BOTH = {"left": [0.9, 0.5, 0.3, 0.1], "right": [0.1, 0.2, 0.9, 0.7]}
FACE_UP, FACE_DOWN = np.array([1.0, 1.0, 1.0]), np.array([-1.0, 1.0, 1.0])
CUFF = np.array([-0.4, 0.7, 0.01])
TOP = np.array([[0.0, 0.8, 0.0], CUFF, [0.4, 0.7, 0.0]])


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


class KnownPlaces:
    """A matcher for a garment that shows the demonstration's points alone, in their order."""

    def __init__(self, places):
        self.places = places

    def match(self, source_cloud, source_points, target_cloud):
        assert len(target_cloud) == len(self.places)
        distance = np.linalg.norm(self.places[None] - source_points[:, None], axis=2)
        return distance.argmin(axis=1), np.exp(-distance).astype(np.float32)


class SeesTheCuff:
    """Finds the second point of a cloud wherever it is asked for one."""

    def match(self, source_cloud, source_points, target_cloud):
        count = len(source_points)
        return np.ones(count, np.int64), np.ones((count, len(target_cloud)), np.float32)


def make_finder(demonstration=DEMONSTRATION):
    return PointFinder(demonstration, np.zeros((1, 3)))


# Two hands --------------------------------------------------------------------------------------


@pytest.mark.parametrize(("similarity", "right"), [(SEES_ONE_SIDE, RIGHT), (SEES_BOTH, MIDDLE)])
def test_points_of_two_hands_are_found_at_two_places(similarity, right):
    assert np.linalg.norm(CLOUD[LEFT] - CLOUD[BESIDE]) < HANDS_APART
    finder, matcher = make_finder(), StubMatcher(similarity)
    points = finder.find_points(CLOUD, matcher)
    for name in NAMES:
        place = LEFT if name.startswith("left") else right
        np.testing.assert_array_equal(points[name], CLOUD[place])
    for stage in DEMONSTRATION.stages:
        grasp, seen = finder.find_grasps(stage, CLOUD, matcher, {})
        np.testing.assert_array_equal(grasp["left"], CLOUD[LEFT])
        np.testing.assert_array_equal(grasp["right"], CLOUD[right])
        np.testing.assert_array_equal(seen, [similarity["left"], similarity["right"]])


def test_of_one_hand_the_most_similar_point_is_taken():
    class Same:
        def match(self, source_cloud, source_points, target_cloud):
            similarity = np.tile(SEES_ONE_SIDE["right"], (len(source_points), 1))
            return similarity.argmax(axis=1), similarity

    demonstration = load_demonstration("FoldTops-v1")
    grasp, similarity = make_finder(demonstration).find_grasps(
        demonstration.stages[0], CLOUD, Same(), {}
    )
    assert list(grasp) == ["left"]
    np.testing.assert_array_equal(grasp["left"], CLOUD[BESIDE])
    # of the hand that rests, what the other one goes for
    np.testing.assert_array_equal(similarity, [SEES_ONE_SIDE["right"]] * 2)


def test_where_no_place_near_enough_is_apart_what_is_apart_elsewhere_is_taken():
    """Both points lay at one place, within whose reach the garment is narrower than two hands."""
    narrow = np.array([[0.0, 0.6, 0.0], [0.1, 0.6, 0.0], [0.05, 0.9, 0.0], [0.35, 0.6, 0.0]])
    stage = dataclasses.replace(DEMONSTRATION.stages[0], moved_at_most=0.15)
    finder = make_finder()
    finder.points = dict.fromkeys(NAMES, np.array([0.05, 0.6, 0.0]))
    similarity = {"left": [0.9, 0.5, 0.3, 0.2], "right": [0.8, 0.7, 0.6, 0.1]}
    grasp, seen = finder.find_grasps(stage, narrow, StubMatcher(similarity), {})
    assert np.linalg.norm((grasp["left"] - grasp["right"])[:2]) >= HANDS_APART
    np.testing.assert_array_equal(grasp["left"], narrow[0])
    np.testing.assert_array_equal(grasp["right"], narrow[2])
    # out of reach of where it lay nothing is preferred
    np.testing.assert_array_equal(seen[:, 2:], [[0.2] * 2, [0.1] * 2])


def test_a_garment_that_is_nowhere_wide_enough_is_taken_where_it_was_found():
    narrow = CLOUD * [0.1, 1, 1]
    grasp, _ = make_finder().find_grasps(
        DEMONSTRATION.stages[0], narrow, StubMatcher(SEES_ONE_SIDE), {}
    )
    np.testing.assert_array_equal(grasp["left"], narrow[LEFT])
    np.testing.assert_array_equal(grasp["right"], narrow[BESIDE])


# Which side is up -------------------------------------------------------------------------------


def make_garment(task_id, facing):
    """A finder, the cloud of a garment that lies this way, and its matcher."""
    demonstration = load_demonstration(task_id)
    places = np.array(list(demonstration.points.values()))
    return make_finder(demonstration), (places * facing).astype(np.float32), KnownPlaces(places)


@pytest.mark.parametrize("facing", [FACE_UP, FACE_DOWN], ids=["face up", "face down"])
@pytest.mark.parametrize("task_id", ["FlingTops-v1", "FlingDress-v1", "FlingTrousers-v1"])
def test_the_hands_take_what_lies_on_their_side(task_id, facing):
    finder, cloud, matcher = make_garment(task_id, facing)
    finder.look(cloud, matcher)
    for stage in load_demonstration(task_id).stages:
        grasp, similarity = finder.find_grasps(stage, cloud, matcher, {})
        assert grasp["left"][0] < grasp["right"][0]
        for side, similar in zip(SIDES, similarity, strict=True):
            np.testing.assert_allclose(grasp[side], cloud[similar.argmax()])


def test_a_turned_garment_keeps_its_own_sides_where_it_is_not_expected_to_turn_over():
    finder, cloud, matcher = make_garment("FoldTops-v1", FACE_DOWN)
    finder.look(cloud, matcher)
    assert finder.points["left_cuff"][0] > finder.points["right_cuff"][0]


def test_a_garment_that_turns_back_gets_its_own_sides_again():
    finder, cloud, matcher = make_garment("FlingTops-v1", FACE_DOWN)
    finder.look(cloud, matcher)
    assert finder.points["left_cuff"][0] < 0
    finder.look(cloud * FACE_DOWN, matcher)
    own = load_demonstration("FlingTops-v1").points["left_cuff"]
    np.testing.assert_allclose(finder.points["left_cuff"], own, atol=1e-6)


# Where it was -----------------------------------------------------------------------------------


def test_points_are_looked_for_near_where_they_first_lay():
    demonstration = load_demonstration("FoldTops-v1")
    stage, finder = demonstration.stages[0], make_finder(demonstration)
    grasp, _ = finder.find_grasps(stage, TOP, SeesTheCuff(), {})
    np.testing.assert_allclose(grasp["left"], CUFF)  # nobody has looked before
    # the matcher likes the left cuff, but the point lay at the right one
    finder.points = {"left_cuff": np.array([0.4, 0.6, 0.0])}
    grasp, similarity = finder.find_grasps(stage, TOP, SeesTheCuff(), {})
    np.testing.assert_allclose(grasp["left"], TOP[2])
    assert similarity.shape == (2, 3)
    moved = dataclasses.replace(stage, moved_at_most=None)
    grasp, _ = finder.find_grasps(moved, TOP, SeesTheCuff(), {})
    np.testing.assert_allclose(grasp["left"], CUFF)


def test_points_that_are_gone_are_said_to_be():
    demonstration = load_demonstration("FoldTops-v1")
    finder = make_finder(demonstration)
    finder.points = {"left_cuff": np.array([0.4, 0.5, 0.0])}
    with pytest.raises(PerceptionError, match=r"left_sleeve: nothing of the garment lies within"):
        finder.find_grasps(demonstration.stages[0], TOP, SeesTheCuff(), {})


# Several points, and places ---------------------------------------------------------------------

HEMS = load_demonstration("FoldTrousers-v1")


def find_hems(apart, known):
    """Find the grasp point of hems_to_waist when both hems are found so far apart [m]."""
    finder, stage = make_finder(HEMS), HEMS.stages[1]
    if known:
        finder.points = {
            "left_hem_middle": np.array([0.9, 0.8, 0.0]),
            "right_hem_middle": np.array([0.5, 0.8, 0.0]),
        }
    cloud = np.array([[0.0, 0.8, 0.01], [apart, 0.8, 0.01], [9.0, 9.0, 0.0]])

    class Hems:
        def match(self, source_cloud, source_points, target_cloud):
            np.testing.assert_array_equal(
                source_points, [HEMS.points["left_hem_middle"], HEMS.points["right_hem_middle"]]
            )
            return np.array([0, 1]), np.array([[0.9, 0.1, 0.0], [0.2, 0.8, 0.0]])

    return finder.find_grasps(stage, cloud, Hems(), {})


@pytest.mark.parametrize(
    ("apart", "known", "expected"),
    [
        (APART - 0.01, True, 0.12),
        (
            APART + 0.01,
            True,
            0.26,
        ),  # one hand cannot take both: the one that lies where it first lay
        (APART + 0.01, False, 0.13),  # nobody has looked before
    ],
)
def test_of_points_too_far_apart_the_one_left_behind_is_grasped(apart, known, expected):
    grasp, _ = find_hems(apart, known)
    assert list(grasp) == ["right"]
    np.testing.assert_allclose(grasp["right"], (expected, 0.8, 0.01), atol=1e-6)


def test_what_is_similar_to_one_of_several_points_is_shown():
    _, similarity = find_hems(0.1, known=True)
    np.testing.assert_array_equal(similarity, [[0.9, 0.8, 0.0]] * 2)


def make_stage(**grasp):
    return Stage(name="hang", grasp=grasp, steps=(Approach(),))


def test_a_place_is_worked_out_from_what_is_known_and_needs_no_matcher():
    class Refuses:
        def match(self, *_):
            pytest.fail("nothing of this stage is a point of the demonstration")

    names = {
        "garment": {"min": np.array([-0.2, 0.5, 0.0]), "max": np.array([0.3, 0.7, 0.1])},
        "hanger": {"target": np.array([0.0, 0.9, 1.5])},
    }
    stage = make_stage(
        left=Grasp(at=("garment.min.x", "garment.max.y", "0.02")),
        right=Grasp(at=("garment.max.x", "hanger.target.y - 0.2", "0.02")),
    )
    grasp, similarity = make_finder().find_grasps(stage, CLOUD, Refuses(), names)
    np.testing.assert_allclose(grasp["left"], (-0.2, 0.7, 0.02))
    np.testing.assert_allclose(grasp["right"], (0.3, 0.7, 0.02))
    # what lies near the place is shown to a policy
    for row, side in zip(similarity, SIDES, strict=True):
        distance = np.linalg.norm(CLOUD - grasp[side], axis=1)
        np.testing.assert_allclose(row, np.exp(-0.5 * (distance / PLACE_SCALE) ** 2))


def test_one_hand_may_take_a_point_and_the_other_a_place():
    stage = make_stage(left=Grasp(points=("left_waistband",)), right=Grasp(at=("0.3", "0.7", "0")))
    grasp, _ = make_finder().find_grasps(stage, CLOUD, StubMatcher(SEES_ONE_SIDE), {})
    np.testing.assert_array_equal(grasp["left"], CLOUD[LEFT])
    np.testing.assert_allclose(grasp["right"], (0.3, 0.7, 0.0))


def test_a_demonstration_without_points_asks_no_matcher():
    class Refuses:
        def match(self, *_):
            pytest.fail("there is nothing to be found")

    stage = make_stage(left=Grasp(at=("0", "0.7", "0")))
    finder = make_finder(
        dataclasses.replace(DEMONSTRATION, points={}, stages=(stage,), turns_over=False)
    )
    finder.look(CLOUD, Refuses())
    assert finder.points == {}
