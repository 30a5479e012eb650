"""Declarations of another form are refused by one check that reads their annotations."""

import dataclasses
from collections.abc import Mapping

import numpy as np
import pytest

import dgl_tasks
from dgl_tasks.cameras import CameraPlacement, Workspace
from dgl_tasks.declaration import HandFriction, SceneObject, Start
from dgl_tasks.fields import Range, check_fields, is_number
from dgl_tasks.success import CoversFlatArea, HangsOver, ShareInBox

TASK = dgl_tasks.get_task("FoldTops-v1")
OBJECT = SceneObject(name="bar", prop="hanger", position=(0, 0.85, 0))


def change_object(**changes):
    return lambda: dataclasses.replace(OBJECT, **changes)


def change_task(**changes):
    return lambda: dataclasses.replace(TASK, **changes)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (change_object(x_range=0.2), r"SceneObject: x_range must be \(low, high\), .*; got 0\.2"),
        (change_object(y_range=(0, 0, 0)), r"y_range must be \(low, high\).*; got \(0, 0, 0\)"),
        (change_object(position="abc"), r"position must be \(x, y, z\), three .*; got 'abc'"),
        (change_object(position=(0, 0, True)), r"position must be .*; got \(0, 0, True\)"),
        (change_object(friction="high"), "friction must be a finite number; got 'high'"),
        (change_object(name=3), "name must be a text; got 3"),
        (change_object(prop=3), "prop must be a text or a .*; got 3"),
        (change_object(solid_to=["arms"]), r"solid_to must be one of \('robot'.*; got \['arms'\]"),
        (
            change_task(left_base=(0, 0, 0)),
            r"Task: left_base must be a tuple of 4, each a finite number; got \(0, 0, 0\)",
        ),
        (
            change_task(objects=OBJECT),
            "Task: objects must be a tuple, each item a SceneObject; got SceneObject",
        ),
        (change_task(objects=("bar",)), r"each item a SceneObject; got \('bar',\)"),
        (change_task(start="floor"), "start must be a Start; got 'floor'"),
        (change_task(success=0.8), "success must be a SuccessRule; got 0.8"),
        (change_task(cameras=[]), r"cameras must be a mapping from a text to a Camera.*; got \[\]"),
        (change_task(stiffness={"brim": "stiff"}), "mapping from a text to a finite number; got"),
        (change_task(id=5), "Task: id must be a text; got 5"),
        (lambda: Start(settle_frames=1.5), "settle_frames must be an integer; got 1.5"),
        (lambda: Start(height="0.2"), "height must be a finite number; got '0.2'"),
        (lambda: HandFriction(fingers=True), "fingers must be a finite number; got True"),
        (lambda: Workspace(low=0), r"Workspace: low must be \(x, y, z\)"),
        (lambda: Workspace(high=(1, 1, np.nan)), r"high must be \(x, y, z\), three numbers"),
        (
            lambda: CameraPlacement(name="c", position=(0, 0, 1), euler_deg="down"),
            r"CameraPlacement: euler_deg must be \(x, y, z\).*; got 'down'",
        ),
        (lambda: HangsOver(place=3, sideways=0.1), "HangsOver: place must be a text; got 3"),
        (lambda: CoversFlatArea(tolerance=None), "tolerance must be a finite number; got None"),
        (
            lambda: dataclasses.replace(TASK.success, left="collar"),
            "ShareInBox: left must be a tuple, each item a text; got 'collar'",
        ),
    ],
)
def test_a_field_of_another_type_is_named_with_what_it_must_be(make, message):
    with pytest.raises(ValueError, match=message) as caught:
        make()
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 300


def test_lists_and_arrays_become_tuples_so_that_declarations_can_be_hashed():
    listed = dataclasses.replace(OBJECT, position=[0, 0.85, 0], x_range=np.array([-0.1, 0.1]))
    assert (listed.position, listed.x_range) == ((0, 0.85, 0), (-0.1, 0.1))
    assert hash(listed) == hash(dataclasses.replace(OBJECT, x_range=(-0.1, 0.1)))
    assert dataclasses.replace(TASK, objects=[OBJECT]).objects == (OBJECT,)


def test_a_workspace_may_be_open():
    assert Workspace(low=(-1, -1, -np.inf)).low[2] == -np.inf


def test_every_task_fits_its_own_annotations():
    for task_id in dgl_tasks.task_ids():
        task = dgl_tasks.get_task(task_id)
        assert dataclasses.replace(task) == task
    assert isinstance(TASK.success, ShareInBox)


@pytest.mark.parametrize("value", [1, 1.5, np.float32(2), np.int64(3)])
def test_numbers_of_any_kind_are_numbers(value):
    assert is_number(value)


@pytest.mark.parametrize("value", ["1", None, True, np.bool_(True), np.nan, -np.inf, 1j, [1]])
def test_what_is_not_a_finite_real_number_is_none(value):
    assert not is_number(value)


def test_only_fields_of_the_constructor_are_checked():
    @dataclasses.dataclass
    class Declared:
        span: Range
        parts: Mapping[str, float]
        sum: float = dataclasses.field(init=False)

        def __post_init__(self):
            check_fields(self)
            self.sum = sum(self.parts.values())

    assert Declared(span=[0, 1], parts={"a": 2}).sum == 2
