"""Where the hands take hold of a garment that may lie on its face."""

from types import SimpleNamespace

import numpy as np
import pytest
from dgl_collect.execution import Execution

from dgl_assets.robots import SIDES
from dgl_collect.demonstration import load_demonstration
from dgl_tasks import get_task

FACE_UP, FACE_DOWN = np.array([1.0, 1.0, 1.0]), np.array([-1.0, 1.0, 1.0])


class KnownPlaces:
    """A matcher for a garment that shows the demonstration's points alone, in their order."""

    def __init__(self, places):
        self.places = places

    def match(self, source_cloud, source_points, target_cloud):
        assert len(target_cloud) == len(self.places)
        distance = np.linalg.norm(self.places[None] - source_points[:, None], axis=2)
        return distance.argmin(axis=1), np.exp(-distance).astype(np.float32)


def make_execution(task_id, facing):
    task = get_task(task_id)
    demonstration = load_demonstration(task_id)
    places = np.array(list(demonstration.points.values()))
    cloud = (places * facing).astype(np.float32)
    setup = SimpleNamespace(
        env=SimpleNamespace(task=task),
        motion=None,
        demonstration=demonstration,
        demo_cloud=cloud,
        find_matcher=lambda env: KnownPlaces(places),
    )
    driver = SimpleNamespace(see_garment=lambda: cloud)
    return Execution(setup, 0, driver=driver), cloud


@pytest.mark.parametrize("facing", [FACE_UP, FACE_DOWN], ids=["face up", "face down"])
@pytest.mark.parametrize("task_id", ["FlingTops-v1", "FlingDress-v1", "FlingTrousers-v1"])
def test_the_hands_take_what_lies_on_their_side(task_id, facing):
    execution, cloud = make_execution(task_id, facing)

    execution.look()

    for stage in execution.env.task.stages:
        grasp, similarity = execution.find_grasps(stage, cloud)
        assert grasp["left"][0] < grasp["right"][0]
        for side, similar in zip(SIDES, similarity, strict=True):
            shown = cloud[similar.argmax()]
            np.testing.assert_allclose(grasp[side], stage.place_grasp(side, shown))


def test_a_turned_garment_keeps_its_own_sides_where_it_is_not_expected_to_turn_over():
    execution, _ = make_execution("FoldTops-v1", FACE_DOWN)

    execution.look()

    assert execution.finder.points["left_cuff"][0] > execution.finder.points["right_cuff"][0]


def test_a_garment_that_turns_back_gets_its_own_sides_again():
    execution, cloud = make_execution("FlingTops-v1", FACE_DOWN)
    execution.look()

    execution.driver.see_garment = lambda: cloud * FACE_DOWN
    execution.look()

    points = {name: place[0] for name, place in execution.finder.points.items()}
    assert points["left_cuff"] == pytest.approx(execution.demonstration.points["left_cuff"][0])
