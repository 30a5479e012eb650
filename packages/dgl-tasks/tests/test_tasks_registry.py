"""Tasks by id, and that their declarations fit robots, garments and cameras."""

import dataclasses

import gymnasium
import numpy as np
import pytest

import dgl_tasks
from dgl_assets import garment_ids, list_categories, load_garment
from dgl_assets.robots import SIDES
from dgl_tasks.coverage import sample_visible_surface
from dgl_tasks.declaration import Stage
from dgl_tasks.errors import UnknownTaskError
from dgl_tasks.grasps import GRASP_ORIENTATIONS
from dgl_tasks.success import Before, Verdict, compute_covered_area

TASKS = [dgl_tasks.get_task(task_id) for task_id in dgl_tasks.task_ids()]
each_task = pytest.mark.parametrize("task", TASKS, ids=lambda task: task.id)


def test_the_ids_are_registered_with_gymnasium():
    assert "FoldTops-v1" in dgl_tasks.task_ids()
    for task_id in dgl_tasks.task_ids():
        assert gymnasium.spec(task_id).kwargs["task"] == task_id
        assert dgl_tasks.get_task(task_id).id == task_id


@pytest.mark.parametrize("wrong", ["FoldTop-v1", "foldtops", "Hang a coat"])
def test_an_unknown_id_names_the_closest_and_all(wrong):
    with pytest.raises(UnknownTaskError, match=f"unknown task {wrong!r}; did you mean") as caught:
        dgl_tasks.get_task(wrong)
    assert "Tasks: FoldTops-v1" in str(caught.value)
    assert isinstance(caught.value, dgl_tasks.TaskError)
    assert isinstance(caught.value, ValueError)


@each_task
def test_stages_name_hands_points_and_orientations_that_exist(task):
    landmarks = load_garment(garment_ids(task.category, "train", count=1)[0]).landmarks
    names = [stage.name for stage in task.stages]
    assert len(set(names)) == len(names)
    for stage in task.stages:
        assert stage.grasp
        assert set(stage.grasp) <= set(SIDES)
        assert set(stage.grasp) <= set(GRASP_ORIENTATIONS[stage.orientation])
        assert stage.grasp_height >= 0
        assert stage.moved_at_most is None or stage.moved_at_most > 0
        assert stage.policy_loops >= 1
    assert set(task.success.points) <= set(landmarks)


@each_task
def test_the_rule_judges_a_garment_of_the_category(task):
    garment = load_garment(garment_ids(task.category, "train", count=1)[0])
    marks = {name: garment.vertices[garment.landmarks[name]] for name in task.success.points}
    surface = sample_visible_surface(garment.vertices, garment.faces)
    before = Before(points=marks, flat_area=compute_covered_area(surface))
    verdict = task.success(surface, before)
    assert isinstance(verdict, Verdict)
    # lying flat is the goal of a fling, and not that of a fold
    assert verdict.success is (not task.success.points)


@each_task
def test_category_cameras_and_workspace_fit(task):
    assert task.category in list_categories()
    assert {"garment_camera", "environment_camera", "video_camera"} <= set(task.cameras)
    assert all(camera.name == name for name, camera in task.cameras.items())
    low, high = np.array(task.workspace.low), np.array(task.workspace.high)
    for x in task.x_range:
        for y in task.y_range:
            assert np.all((low[:2] < (x, y)) & ((x, y) < high[:2]))


def test_fold_tops_is_as_specified():
    task = dgl_tasks.get_task("FoldTops-v1")
    assert task.category == "Tops_LongSleeve"
    assert (task.x_range, task.y_range, task.yaw) == ((-0.1, 0.1), (0.7, 0.9), 0.0)
    assert task.left_base == (-0.8, 0.0, 0.5, 0.0)
    assert task.right_base == (0.8, 0.0, 0.5, 0.0)
    assert [dict(stage.grasp) for stage in task.stages] == [
        {"left": "left_cuff"},
        {"right": "right_cuff"},
        {"left": "left_hem", "right": "right_hem"},
    ]
    assert [stage.policy_loops for stage in task.stages] == [8, 8, 12]
    assert task.success_text.startswith("at least 85 %")


PLACES = {
    "FoldTops-v1": ("Tops_LongSleeve", (0.7, 0.9), [8, 8, 12]),
    "FoldDress-v1": ("Dress_LongSleeve", (0.65, 0.9), [8, 8, 12]),
    "FoldTrousers-v1": ("Trousers", (0.7, 0.9), [12, 8]),
    "FlingTops-v1": ("Tops_LongSleeve", (0.5, 0.7), [12, 4]),
    "FlingDress-v1": ("Dress_LongSleeve", (0.5, 0.7), [12, 4]),
    "FlingTrousers-v1": ("Trousers", (0.5, 0.7), [12, 4, 4]),  # the stages after the fling are ours
}


@pytest.mark.parametrize("task_id", PLACES)
def test_category_place_and_policy_loops_are_as_specified(task_id):
    task = dgl_tasks.get_task(task_id)
    category, y_range, loops = PLACES[task_id]
    assert (task.category, task.x_range, task.y_range) == (category, (-0.1, 0.1), y_range)
    assert [stage.policy_loops for stage in task.stages] == loops
    tilt = (65, 80) if "Fling" in task_id else (0, 0)
    np.testing.assert_allclose(np.degrees(task.roll_range), tilt)
    assert task.yaw == pytest.approx(np.pi / 2 if task_id == "FoldTrousers-v1" else 0.0)


def test_a_hand_stops_short_of_its_point_along_its_fingers():
    stage = Stage(
        name="pull",
        grasp={"left": "left_cuff", "right": "right_cuff"},
        orientation="sides",
        grasp_height=0.02,
        short_by=0.1,
    )
    point = np.array([0.3, 0.7, 0.05])

    left, right = (stage.place_grasp(side, point) - [0.3, 0.7, 0.02] for side in SIDES)

    # hands that are turned inwards come from their own side and from the robots
    assert np.linalg.norm(left) == pytest.approx(0.1)
    assert left[0] < -0.05
    assert left[1] < -0.02
    np.testing.assert_allclose(right, left * [-1.0, 1.0, 1.0], atol=1e-3)
    exact = dataclasses.replace(stage, short_by=0.0)
    assert exact.place_grasp("left", point).tolist() == [0.3, 0.7, 0.02]


def test_contradictory_declarations_are_refused():
    task = dgl_tasks.get_task("FoldTops-v1")
    with pytest.raises(ValueError, match=r"x_range must be .*got \(0.1, -0.1\)"):
        dataclasses.replace(task, x_range=(0.1, -0.1))
    with pytest.raises(ValueError, match="y_range"):
        dataclasses.replace(task, y_range=(0.9, 0.7))
    with pytest.raises(ValueError, match="at least one stage"):
        dataclasses.replace(task, stages=())
    with pytest.raises(ValueError, match="rounds must be at least 1; got 0"):
        dataclasses.replace(task, rounds=0)
    for number in (-1, 3):
        with pytest.raises(ValueError, match=rf"again_from must be in 0..2; got {number}"):
            dataclasses.replace(task, again_from=number)
    assert dataclasses.replace(task, again_from=1, nearly_done=0.7).nearly_done == 0.7
    with pytest.raises(ValueError, match="nearly_done needs a stage after again_from"):
        dataclasses.replace(task, again_from=2, nearly_done=0.7)
