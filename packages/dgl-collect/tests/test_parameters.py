"""Parameters of a demonstration: where their values go, and what is refused."""

import copy
import dataclasses
import json

import numpy as np
import pytest

from dgl_collect.demonstration import FOLDER, check_demonstration, parse_demonstration
from dgl_collect.errors import DemonstrationError
from dgl_collect.formula import evaluate_formula
from dgl_collect.parameters import fill_in
from dgl_collect.steps import Approach, Move, Retreat, Wait
from dgl_tasks import get_task
from dgl_tasks.success import CoversFlatArea

LIFT = {"value": 0.2, "range": [0.1, 0.4], "meaning": "height of the hand [m]"}
SHARE = {"value": 0.25, "range": [0, 1], "meaning": "grasp: 0 at the cuff, 1 at the chest"}
WHOLE = {
    "format": 2,
    "task": "FoldTops-v1",
    "garment": "Tops_LongSleeve/001294",
    "parameters": {"lift": LIFT, "share": SHARE},
    "points": {
        "left_cuff": [-0.4, 0.0, 0.0],
        "left_chest": [-0.2, 0.1, 0.01],
        "lift_place": ["left_cuff.x + share * (left_chest.x - left_cuff.x)", "share", 0],
    },
    "stages": [
        {
            "name": "lift",
            "grasp": {"left": {"at": ["lift_place.x", "lift_place.y + lift", "lift"]}},
            "when": "round < 10 * lift",
            "definitions": {"by": "lift / 2", "lifted": "by + lift_place.x"},
            "steps": [
                {"step": "approach", "short_by": "lift / 10", "come_from": [0, "-lift", 0.1],
                 "orientation": {"yaw": "100 * lift", "pitch": 3}},
                {"step": "hand_pose", "pose": "close"},
                {"step": "move", "left": ["lifted", "lift_place.y", "lift"],
                 "spacing": "0.1 * lift"},
                {"step": "wait", "frames": "100 * lift"},
                {"step": "release"},
                {"step": "retreat", "back": ["lift", 0.0], "up": "lift"},
            ],
        }
    ],
}  # fmt: skip


TASK = dataclasses.replace(get_task("FoldTops-v1"), success=CoversFlatArea())  # needs no points


def parse(**changes):
    return parse_demonstration(copy.deepcopy(WHOLE) | changes, source="mine.json")


def test_values_go_wherever_a_formula_or_a_number_may_be():
    demonstration = parse()
    assert demonstration.parameters["lift"].range == (0.1, 0.4)
    assert demonstration.points["lift_place"] == pytest.approx([-0.35, 0.25, 0])
    (stage,) = demonstration.stages
    steps = {type(step): step for step in stage.steps}
    # formulas of places take the parameters by name, as an error shows them
    assert demonstration.values == {"lift": 0.2, "share": 0.25}
    assert stage.when == "round < 10 * lift"
    assert stage.definitions == {"by": "lift / 2", "lifted": "by + lift_place.x"}
    assert stage.grasp["left"].at == ("lift_place.x", "lift_place.y + lift", "lift")
    assert steps[Move].spacing == pytest.approx(0.02)
    assert steps[Approach].short_by == pytest.approx(0.02)
    assert steps[Approach].come_from == (0, -0.2, 0.1)
    assert steps[Approach].orientation.yaw == pytest.approx(20)
    assert steps[Wait].frames == 20
    assert (steps[Retreat].back, steps[Retreat].up) == ((0.2, 0.0), 0.2)


def test_another_value_gives_another_demonstration():
    other = parse(parameters={"lift": LIFT | {"value": 0.3}, "share": SHARE})
    assert other.values["lift"] == 0.3
    assert other.stages[0].steps[0].short_by == pytest.approx(0.03)
    assert other.points["lift_place"][0] == pytest.approx(-0.35)


def test_a_demonstration_without_parameters_stays_as_it_is():
    for file in FOLDER.iterdir():
        content = json.loads(file.read_text())
        if "parameters" not in content:
            assert fill_in(content) == content


def test_angles_of_formulas_are_degrees():
    assert evaluate_formula("sin(30) + cos(angle)", {"angle": 60.0}) == pytest.approx(1.0)
    assert evaluate_formula("sqrt(9) + sqrt(-1)", {}) == 3.0
    with pytest.raises(ValueError, match="arithmetic is for numbers"):
        evaluate_formula("sin(point)", {"point": np.zeros(3)})


def test_an_unknown_name_is_told_with_the_formula_as_it_was_written():
    for place, formula in (
        (("definitions", "by"), "lift / 2 + lifft"),
        (("grasp", "left", "at", 2), "lift + lifft"),
        (("steps", 2, "left", 0), "lifft * lift"),
        (("when",), "round < 10 * lift + lifft"),
    ):
        content = copy.deepcopy(WHOLE) | {"task": TASK.id}
        part = content["stages"][0]
        for key in place[:-1]:
            part = part[key]
        part[place[-1]] = formula
        demonstration = parse_demonstration(content, source="mine.json")
        with pytest.raises(DemonstrationError) as refused:
            check_demonstration(demonstration, TASK, source="mine.json")
        assert f"formula {formula!r} cannot be evaluated: unknown name 'lifft'" in str(
            refused.value
        )
        assert "lift, " in str(refused.value)  # among the known ones


def test_unfit_parameters_are_refused():
    named = "not have the names of others; got .'{}'"
    for parameters, message in (
        ([], r"parameters should be a valid dictionary; got \[\]"),
        ({"lift": 0.2}, "parameters.*dictionary; got 0.2"),
        ({"lift": LIFT | {"value": 0.5}}, r"'lift': value must be in the range \[0.1, 0.4\]"),
        ({"lift": LIFT | {"range": [0.4, 0.1]}}, r"with low < high; got \[0.4, 0.1\]"),
        ({"lift": {"value": 0.2, "range": [0, 1]}}, "parameters.'lift': meaning"),
        ({"lift": LIFT | {"step": 1}}, "parameters.'lift': step"),
        ({"lift": LIFT, "share": SHARE, "left_cuff": LIFT}, named.format("left_cuff")),
        ({"lift": LIFT, "share": SHARE, "by": LIFT}, named.format("by")),
        ({"lift": LIFT, "share": SHARE, "max": LIFT}, "formulas have already; got 'max'"),
        ({"lift": LIFT}, "formula.*unknown name 'share'"),
        ({"lift": LIFT, "share": SHARE, "sag": LIFT}, r"be in formulas; \['sag'\] are in none"),
        ({"share": SHARE}, "formula 'lift / 10' .*unknown name 'lift'"),
    ):  # fmt: skip
        with pytest.raises(DemonstrationError, match=message) as refused:
            parse(parameters=parameters)
        assert "\n" not in str(refused.value)
