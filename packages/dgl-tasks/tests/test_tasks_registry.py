"""Tasks by id, and that their declarations fit robots, garments and cameras."""

import dataclasses

import gymnasium
import numpy as np
import pytest

import dgl_tasks
from dgl_assets import garment_ids, list_categories, load_garment
from dgl_assets.robots import SIDES
from dgl_tasks.errors import UnknownTaskError
from dgl_tasks.grasps import GRASP_ORIENTATIONS
from dgl_tasks.success import Verdict

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
        assert set(stage.grasp.values()) <= set(landmarks)
        assert set(stage.grasp) <= set(GRASP_ORIENTATIONS[stage.orientation])
        assert stage.grasp_height > 0
        assert stage.policy_loops >= 1
    assert set(task.judging_points) <= set(landmarks)


@each_task
def test_the_rule_needs_the_judging_points_and_nothing_more(task):
    garment = load_garment(garment_ids(task.category, "train", count=1)[0])
    marks = {name: garment.vertices[garment.landmarks[name]] for name in task.judging_points}
    assert isinstance(task.success(garment.vertices, marks), Verdict)
    for name in task.judging_points:
        with pytest.raises(KeyError, match=name):
            task.success(garment.vertices, {k: v for k, v in marks.items() if k != name})


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


def test_contradictory_declarations_are_refused():
    task = dgl_tasks.get_task("FoldTops-v1")
    with pytest.raises(ValueError, match=r"x_range must be .*got \(0.1, -0.1\)"):
        dataclasses.replace(task, x_range=(0.1, -0.1))
    with pytest.raises(ValueError, match="y_range"):
        dataclasses.replace(task, y_range=(0.9, 0.7))
    with pytest.raises(ValueError, match="at least one stage"):
        dataclasses.replace(task, stages=())
