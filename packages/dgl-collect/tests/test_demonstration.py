"""The demonstrations that come with the package, faults in them, and retargeting."""

import copy
import json
from importlib import resources

import numpy as np
import pytest

from dgl_assets import correspond, load_garment
from dgl_collect.demonstration import (
    load_demonstration,
    parse_demonstration,
    retarget_waypoints,
)
from dgl_collect.errors import DemonstrationError
from dgl_tasks import get_task, task_ids

FILE = resources.files("dgl_collect") / "demonstrations" / "FoldTops.json"

# Where a garment might lie: the points of the paper's formulas, with heights that must not matter.
P = {
    "left_cuff": np.array([-0.50, 0.70, 0.010]),
    "right_chest": np.array([0.16, 0.95, 0.012]),
    "right_cuff": np.array([0.48, 0.68, 0.008]),
    "left_chest": np.array([-0.15, 0.96, 0.011]),
    "left_hem": np.array([-0.20, 0.56, 0.009]),
    "left_sleeve_joint": np.array([-0.23, 0.93, 0.011]),
    "right_sleeve_joint": np.array([0.24, 0.94, 0.011]),
    "right_hem": np.array([0.21, 0.57, 0.010]),
}


@pytest.fixture
def content():
    return json.loads(FILE.read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def demonstration():
    return load_demonstration("FoldTops-v1")


def horizontal(a, b):
    return float(np.hypot(*(a - b)[:2]))


@pytest.mark.parametrize("task_id", task_ids())
def test_every_task_has_a_demonstration_that_fits_it(task_id):
    task, demonstration = get_task(task_id), load_demonstration(task_id)
    assert demonstration.task == task.id
    assert [stage.name for stage in demonstration.stages] == [s.name for s in task.stages]
    named = {
        n for stage in task.stages for side in stage.grasp for n in stage.get_grasp_names(side)
    }
    assert named | set(task.success.points) <= set(demonstration.points)
    for stage in task.stages:
        demonstrated = demonstration.get_stage(stage.name)
        for waypoint in demonstrated.waypoints:
            assert set(waypoint.targets) == set(stage.grasp)
        assert retarget_waypoints(demonstrated, demonstration.points)


def test_the_marked_points_lie_on_the_garment(demonstration):
    garment = load_garment(demonstration.garment)
    assert garment.category == get_task(demonstration.task).category
    marked = np.array(list(demonstration.points.values()))
    distance = np.linalg.norm(garment.vertices[None] - marked[:, None], axis=2).min(axis=1)
    assert distance.max() < 0.015
    np.testing.assert_allclose(correspond(garment, marked, garment), marked, atol=0.01)


SLEEVES = (
    ("left_sleeve", "left", "left_cuff", "left_sleeve_joint", "left_chest", "right_chest"),
    ("right_sleeve", "right", "right_cuff", "right_sleeve_joint", "right_chest", "left_chest"),
)


@pytest.mark.parametrize(("stage", "side", "cuff", "joint", "own", "other"), SLEEVES)
def test_sleeves_are_carried_over_their_joint_without_pulling(
    demonstration, stage, side, cuff, joint, own, other
):
    """The paper's height over the joint, its goal at the far chest, and never a taut sleeve."""
    waypoints = retarget_waypoints(demonstration.get_stage(stage), P)
    assert all(set(waypoint.targets) == {side} for waypoint in waypoints)
    _, over, _, end = path = [waypoint.targets[side] for waypoint in waypoints]
    h = min(horizontal(P[cuff], P[own]), 0.3)
    np.testing.assert_allclose(over, (*P[joint][:2], h))
    sleeve = horizontal(P[cuff], P[joint])
    for point in path:
        flat = horizontal(point, P[joint])
        assert np.hypot(flat, point[2]) <= sleeve + 1e-9
    # straight towards the far chest, as far as the sleeve allows
    goal = P[other][:2] - P[joint][:2]
    share = min(1.0, 0.94 * sleeve / np.linalg.norm(goal))
    np.testing.assert_allclose(end[:2], P[joint][:2] + share * goal)
    assert 0.05 < end[2] < 0.15  # over what lies there, so that it falls off the thumb


@pytest.mark.parametrize(("length", "height"), [(0.2, 0.2), (0.29, 0.29), (0.31, 0.3), (0.6, 0.3)])
def test_a_short_sleeve_is_lifted_by_its_length_and_a_long_one_by_30_cm(
    demonstration, length, height
):
    points = P | {"left_cuff": P["left_chest"] - (length, 0, 0)}
    waypoints = retarget_waypoints(demonstration.get_stage("left_sleeve"), points)
    assert max(w.targets["left"][2] for w in waypoints) == pytest.approx(height)


def test_the_bottom_follows_the_papers_heights(demonstration):
    """Hf = p3.y - p4.y with p3 the left chest and p4 the left hem, for both hands.

    The hem goes 3 cm beyond the chest; with the 10 cm of the original, hems of short tops lie beyond the box.
    """
    length = P["left_chest"][1] - P["left_hem"][1]
    waypoints = retarget_waypoints(demonstration.get_stage("bottom_up"), P)
    lift, carry, lower = (waypoint.targets for waypoint in waypoints)
    for side in ("left", "right"):
        hem, chest = P[f"{side}_hem"], P[f"{side}_chest"]
        np.testing.assert_allclose(lift[side], (hem[0], hem[1] + length / 4, length / 2))
        over = (chest[0], P["left_chest"][1] + 0.03, min(length / 2, 0.2))
        np.testing.assert_allclose(carry[side], over)
        np.testing.assert_allclose(lower[side][:2], carry[side][:2])
        assert 0 < lower[side][2] < carry[side][2]


def test_waypoints_move_with_the_garment(demonstration):
    shift = np.array([0.07, -0.05, 0.0])
    moved = {name: xyz + shift for name, xyz in P.items()}
    for stage in demonstration.stages:
        for before, after in zip(
            retarget_waypoints(stage, P), retarget_waypoints(stage, moved), strict=True
        ):
            for side, goal in before.targets.items():
                np.testing.assert_allclose(after.targets[side], goal + shift, atol=1e-12)


def test_a_point_that_was_not_found_is_named(demonstration):
    points = {k: v for k, v in P.items() if k != "right_chest"}
    with pytest.raises(DemonstrationError, match=r"'left_sleeve': .*unknown name 'right_chest'"):
        retarget_waypoints(demonstration.get_stage("left_sleeve"), points)


def test_what_is_not_there_is_said(demonstration):
    with pytest.raises(DemonstrationError, match=r"no demonstration of 'HangCoat-v1'.*HangCoat"):
        load_demonstration("HangCoat-v1")
    with pytest.raises(DemonstrationError, match="no stage 'collar'; it has left_sleeve, right_"):
        demonstration.get_stage("collar")


def _set(path, value):
    def change(content):
        *parents, last = path
        for key in parents:
            content = content[key]
        content[last] = value

    return change


def _drop(*path):
    def change(content):
        *parents, last = path
        for key in parents:
            content = content[key]
        del content[last]

    return change


STAGE, WAYPOINT = ("stages", 0), ("stages", 0, "waypoints", 0)
STRETCH = {"sag": 0.03, "step": 0.01, "at_most": 0.1, "spacing": 0.005}
FAULTS = [
    (_drop("format"), "missing 'format'"),
    (_set(["format"], 2), "format must be 1; got 2"),
    (_drop("task"), "missing 'task'"),
    (_drop("garment"), "missing 'garment'"),
    (_drop("points"), "missing 'points'"),
    (_drop("stages"), "missing 'stages'"),
    (_set(["points", "collar"], [0.0, 0.1]), "point 'collar' must be three numbers"),
    (_set(["points", "collar"], [0.0, 0.1, float("nan")]), "point 'collar' must be three numbers"),
    (_set(["points", "collar"], "top"), "could not convert string"),
    (_set(["points"], [[0, 0, 0]]), "items"),
    (_drop(*STAGE, "name"), "missing 'name'"),
    (_drop(*STAGE, "waypoints"), "missing 'waypoints'"),
    (_drop(*STAGE, "grasp_pose"), "missing 'grasp_pose'"),
    (_set([*STAGE, "grasp_pose"], "fist"), "grasp_pose must be one of .*; got 'fist'"),
    (_set([*STAGE, "release_pose"], "drop"), "release_pose must be one of .*; got 'drop'"),
    (_set(WAYPOINT, {"spacing": 0.01}), "a waypoint has hands"),
    (_set(WAYPOINT, {"left": ["0"] * 3, "middle": ["0"] * 3}), "got .*'middle'"),
    (_set([*WAYPOINT, "left"], ["0", "0"]), "left must have formulas for x, y, z"),
    (_set([*WAYPOINT, "spacing"], 0), "spacing must be positive; got 0"),
    (_set([*WAYPOINT, "spacing"], -0.01), "spacing must be positive"),
    (_set([*WAYPOINT, "spacing"], "fast"), "could not convert string"),
    (
        _set([*WAYPOINT, "stretch"], STRETCH),
        "a stretch needs both hands and definitions of half_span",
    ),
    (
        _set([*WAYPOINT, "stretch"], STRETCH | {"sag": 0}),
        "sag of a stretch must be positive; got 0",
    ),
    (_set([*WAYPOINT, "stretch"], {"sag": 0.03}), "missing .* 'step'"),
]


@pytest.mark.parametrize(("change", "message"), FAULTS, ids=[message for _, message in FAULTS])
def test_every_fault_names_the_file_and_the_place(content, change, message):
    faulty = copy.deepcopy(content)
    change(faulty)
    with pytest.raises(DemonstrationError, match=rf"^top\.json: .*{message}"):
        parse_demonstration(faulty, source="top.json")
    parse_demonstration(content, source="top.json")


@pytest.mark.parametrize(
    ("formula", "message"),
    [("left_cuf.x", "unknown name 'left_cuf'"), ("__import__('os')", "unknown function")],
)
def test_a_faulty_formula_names_its_stage(content, formula, message):
    content["stages"][0]["waypoints"][0]["left"][0] = formula
    demonstration = parse_demonstration(content, source="top.json")
    with pytest.raises(DemonstrationError, match=f"stage 'left_sleeve': .*{message}"):
        retarget_waypoints(demonstration.stages[0], demonstration.points)


def test_definitions_see_those_before_them(content):
    stage = content["stages"][0]
    stage["definitions"] = {"a": "left_cuff.x", "b": "a * 2"}
    stage["waypoints"] = [{"left": ["a", "b", 0.1], "spacing": 0.005}]
    demonstration = parse_demonstration(content, source="top.json")
    (waypoint,) = retarget_waypoints(demonstration.stages[0], P)
    np.testing.assert_allclose(waypoint.targets["left"], (-0.5, -1.0, 0.1))
    assert waypoint.spacing == 0.005
    stage["definitions"] = {"b": "a * 2", "a": "left_cuff.x"}
    with pytest.raises(DemonstrationError, match="unknown name 'a'"):
        retarget_waypoints(parse_demonstration(content, source="t").stages[0], P)


def test_what_is_seen_takes_the_place_of_what_was_expected():
    stage = load_demonstration("FlingTrousers-v1").stages[0]
    points = {
        "left_waistband": np.array([-0.2, 0.8, 0]),
        "right_waistband": np.array([0.2, 0.8, 0]),
    }
    expected = retarget_waypoints(stage, points)
    seen = retarget_waypoints(stage, points, seen={"half_span": 0.25, "hanging": 0.6})
    assert expected[0].stretch is not None
    np.testing.assert_array_equal(seen[0].targets["left"], expected[0].targets["left"])
    np.testing.assert_allclose(seen[1].targets["right"], (0.25, 1.1 - 1.2 * 0.6, 0.85 * 0.6))
    np.testing.assert_allclose(expected[1].targets["right"], (0.18, 0.3, 0.85 * 0.8))
    # what is long is laid farther away, as far as the arms reach: what is seen counts there too
    assert [way[2].targets["left"][1] for way in (seen, expected)] == pytest.approx([1.12, 1.18])


@pytest.mark.parametrize(("length", "pulled"), [(0.8, 0.09), (0.3, 0.036)])
def test_legs_are_pulled_away_from_the_waist_and_apart(length, pulled):
    stage = load_demonstration("FlingTrousers-v1").get_stage("pull_legs")
    hems = {"left": np.array([-0.2, 0.35, 0]), "right": np.array([0.1, 0.4, 0])}
    points = {f"{side}_hem_middle": point for side, point in hems.items()}
    up = np.array([0, length, 0])
    points |= {f"{side}_waistband": point + up for side, point in hems.items()}
    before = hems
    for waypoint in retarget_waypoints(stage, points):
        for side, outwards in (("left", -1), ("right", 1)):
            way = waypoint.targets[side] - before[side]
            assert way[1] < -pulled / 6
            assert outwards * way[0] > 0.005
        before = waypoint.targets
    drawn = {side: before[side][1] - hems[side][1] for side in hems}
    assert drawn == pytest.approx({"left": -pulled, "right": -pulled})


@pytest.mark.parametrize("task", ["FlingTops-v1", "FlingDress-v1"])
def test_sleeves_turn_outwards_about_their_shoulders(task):
    """By 25 degrees, whichever way they lie, and as long as they are seen to be."""
    stage = load_demonstration(task).get_stage("spread_sleeves")
    points = {
        "left_shoulder": np.array([-0.15, 1.1, 0]),
        "right_shoulder": np.array([0.2, 1.15, 0]),
        "left_cuff": np.array([-0.2, 0.7, 0]),
        "right_cuff": np.array([0.2, 0.75, 0]),
    }
    last = retarget_waypoints(stage, points)[-1].targets
    for side, outwards in (("left", -1), ("right", 1)):
        before = (points[f"{side}_cuff"] - points[f"{side}_shoulder"])[:2]
        # the hand holds the sleeve 3 cm outside and towards the robots of what it was shown
        held = last[side][:2] - 0.021 * np.array([outwards, -1])
        after = held - points[f"{side}_shoulder"][:2]
        turn = np.arctan2(after[1], outwards * after[0]) - np.arctan2(
            before[1], outwards * before[0]
        )
        assert np.degrees(turn) == pytest.approx(25, abs=0.1)
        assert np.linalg.norm(after) == pytest.approx(1.02 * np.linalg.norm(before), rel=1e-3)
