"""The demonstrations that come with the package, where their hands go, and faults in them."""

import copy
import dataclasses
import json
import re
from importlib import resources

import numpy as np
import pytest

from dgl_assets import correspond, load_garment
from dgl_collect.demonstration import check_demonstration, load_demonstration, parse_demonstration
from dgl_collect.errors import DemonstrationError
from dgl_collect.stage_work import StageWork
from dgl_collect.steps import (
    Approach,
    Demonstration,
    Grasp,
    HandPose,
    Move,
    Release,
    Retreat,
    Stretch,
    Wait,
)
from dgl_tasks import get_task, task_ids
from dgl_tasks.declaration import SceneObject
from dgl_tasks.errors import UnknownTaskError

FILE = resources.files("dgl_collect") / "demonstrations" / "FoldTops.json"
TASK = get_task("FoldTops-v1")

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


def get_stage(demonstration, name):
    (stage,) = (stage for stage in demonstration.stages if stage.name == name)
    return stage


def compute_targets(stage, points, *, seen=None):
    """Targets of the hands of a stage on a garment with these points, in order."""
    work = StageWork(
        stage=stage,
        hands=None,
        names=points,
        cloud=np.zeros((1, 3)),
        places={},
        begins=None,
        reaction="ignore",
        draw=(1, 1, 1),
        seen=dict(seen or {}),
    )
    return [
        {side: work._compute(formulas) for side, formulas in step.targets.items()}
        for step in stage.steps
        if isinstance(step, Move)
    ]


def horizontal(a, b):
    return float(np.hypot(*(a - b)[:2]))


@pytest.mark.parametrize("task_id", task_ids())
def test_every_task_has_a_demonstration_that_fits_it(task_id):
    task, demonstration = get_task(task_id), load_demonstration(task_id)
    assert demonstration.task == task.id
    assert load_garment(demonstration.garment).category == task.category
    assert set(task.success.landmarks) <= set(demonstration.points)
    for stage in demonstration.stages:
        for step in stage.steps:
            if isinstance(step, Move):
                assert set(step.targets) <= set(stage.grasp)
        if not task.objects and all(grasp.points for grasp in stage.grasp.values()):
            names = {**demonstration.values, **demonstration.points}
            assert compute_targets(stage, names)


@pytest.mark.parametrize("task_id", task_ids())
def test_the_pose_that_takes_hold_is_the_last_one_before_the_hands_move(task_id):
    for stage in load_demonstration(task_id).stages:
        first = next(k for k, step in enumerate(stage.steps) if isinstance(step, Move))
        poses = [step.pose for step in stage.steps[:first] if isinstance(step, HandPose)]
        assert stage.grasp_pose == poses[-1]


def test_a_file_says_all_that_is_done(demonstration):
    """One of each kind of fact, with what is taken where the file says nothing."""
    assert isinstance(demonstration, Demonstration)
    first, _, last = demonstration.stages
    assert (demonstration.rounds, demonstration.turns_over) == (1, False)
    assert (first.hands, last.hands) == (("left",), ("left", "right"))
    assert last.grasp["right"].points == ("right_hem",)
    assert (first.on_loss, first.again, first.when, first.moved_at_most) == (
        "again", True, None, 0.15,
    )  # fmt: skip
    assert isinstance(last.steps[0], Approach)
    assert last.approach == Approach(orientation="heap", height=0.0)
    assert last.grasp_pose == "close"
    assert [type(step) for step in last.steps[1:]] == [HandPose, Move, Move, Move, Release, Retreat]
    assert [step.recorded for step in last.steps] == [False, *[True] * 5, False]
    assert [step.checked for step in last.steps[2:5]] == [True, False, False]
    assert last.retreat == Retreat()
    assert demonstration.learned_stages == demonstration.stages


def test_hands_leave_trousers_in_the_way_that_is_said():
    first, second = load_demonstration("FoldTrousers-v1").stages
    out = first.retreat
    assert (out.rise, out.wait, out.back) == (0.04, 15, (0.04, 0.02, 0.0))
    assert out.roll == pytest.approx(np.radians(60))
    assert second.retreat == Retreat()
    assert (first.again, second.again) == (False, True)
    assert (first.moved_at_most, second.moved_at_most) == (0.15, None)
    assert second.grasp["right"].points == ("left_hem_middle", "right_hem_middle")


@pytest.mark.parametrize("task_id", ["FlingTops-v1", "FlingDress-v1", "FlingTrousers-v1"])
def test_a_fling_is_stretched_laid_down_when_lost_and_begun_again(task_id):
    demonstration = load_demonstration(task_id)
    fling = demonstration.stages[0]
    assert sum(isinstance(step, Stretch) for step in fling.steps) == 1
    assert fling.on_loss == "lay down"
    assert demonstration.turns_over
    assert demonstration.rounds > 1
    assert {"half_span", "hanging"} <= set(fling.definitions)
    assert all(stage.when is not None for stage in demonstration.stages[1:])


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
    targets = compute_targets(get_stage(demonstration, stage), P)
    assert all(set(target) == {side} for target in targets)
    _, over, _, end = path = [target[side] for target in targets]
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
    targets = compute_targets(get_stage(demonstration, "left_sleeve"), points)
    assert max(target["left"][2] for target in targets) == pytest.approx(height)


def test_the_bottom_follows_the_papers_heights(demonstration):
    """Hf = p3.y - p4.y with p3 the left chest and p4 the left hem, for both hands.

    The hem goes 3 cm beyond the chest; with the original's 10 cm, short tops leave the box.
    """
    length = P["left_chest"][1] - P["left_hem"][1]
    lift, carry, lower = compute_targets(get_stage(demonstration, "bottom_up"), P)
    for side in ("left", "right"):
        hem, chest = P[f"{side}_hem"], P[f"{side}_chest"]
        np.testing.assert_allclose(lift[side], (hem[0], hem[1] + length / 4, length / 2))
        over = (chest[0], P["left_chest"][1] + 0.03, min(length / 2, 0.2))
        np.testing.assert_allclose(carry[side], over)
        np.testing.assert_allclose(lower[side][:2], carry[side][:2])
        assert 0 < lower[side][2] < carry[side][2]


def test_targets_move_with_the_garment(demonstration):
    shift = np.array([0.07, -0.05, 0.0])
    moved = {name: xyz + shift for name, xyz in P.items()}
    for stage in demonstration.stages:
        for before, after in zip(
            compute_targets(stage, P), compute_targets(stage, moved), strict=True
        ):
            for side, goal in before.items():
                np.testing.assert_allclose(after[side], goal + shift, atol=1e-12)


def test_what_is_not_there_is_said(tmp_path):
    socks = dataclasses.replace(TASK, id="FoldSocks-v1")
    with pytest.raises(DemonstrationError, match=r"no demonstration of 'FoldSocks-v1'.*FoldSocks"):
        load_demonstration(socks)
    with pytest.raises(UnknownTaskError, match="unknown task 'FoldSocks-v1'"):
        load_demonstration("FoldSocks-v1")
    with pytest.raises(DemonstrationError, match=r"there is no demonstration .*none.json"):
        load_demonstration(TASK, tmp_path / "none.json")


# Faults ----------------------------------------------------------------------------------------


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


def _step(number, step):
    return _set((*STAGE, "steps", number), step)


STAGE, STEPS = ("stages", 0), ("stages", 0, "steps")
MOVE = (*STEPS, 2)
STRETCH = {"step": "stretch", "sag": 0.03, "by": 0.01, "at_most": 0.1, "spacing": 0.005}


def _point(xyz, name="collar"):
    return _set(["points", name], xyz)


def _left(*formulas):
    return _set([*MOVE, "left"], list(formulas))


def _grasp(content):
    return _set([*STAGE, "grasp", "left"], content)


FAULTS = (
    (_drop("format"), "format must be 2; got None"),
    (_set(["format"], 1), "format must be 2; got 1"),
    *((_drop(key), f"{key}: field required") for key in ("task", "garment", "points", "stages")),
    (_set(["garment"], 3), "garment should be a valid string; got 3"),
    (_set(["stages"], []), "at least one stage"),
    (_set(["stages", 1, "name"], "left_sleeve"), "stages must have different names"),
    *((_set(["rounds"], value), "rounds should be .*; got") for value in (0, 10**9, True, 1.5)),
    (_set(["speed"], 2), "speed: unexpected keyword argument; got 2"),
    # points: three finite numbers in metres, under names that formulas can use
    *(
        (_point(value), "points.collar: a point must be three numbers")
        for value in ([0.0, 0.1], [0, 0, float("nan")], "top", [120.0, 330.0, 2.0], [True, 0, 0],
                      {"x": 0}, None, [[0], [0], [0]], [0, 0, "1"])
    ),
    (_set(["points"], [[0, 0, 0]]), "points should be an object"),
    *(
        (_point([0, 0, 0], name), "a name must")
        for name in ("", "a b", "garment", "now", "min", "value", "\x1b[31m", "in", "1st",
            "x" * 10**7)
    ),
    # stages and their steps, each with its place in the file
    (_set([*STAGE, "repeats"], True), r"stages\[0\].repeats: unexpected keyword"),
    (_set([*STAGE, "name"], ""), r"stages\[0\].name: .* at least 1 character"),
    (_drop(*STAGE, "name"), r"stages\[0\].name: field required"),
    (_drop(*STAGE, "grasp"), r"stages\[0\].grasp: field required"),
    (_drop(*STEPS), r"stages\[0\].steps: field required"),
    (_drop(*STEPS, 0), r"stages\[0\]: steps must have one approach; got 0"),
    (_set([*STAGE, "grasp"], {}), r"stages\[0\]: grasp must be of some of"),
    (_set([*STAGE, "grasp"], {"middle": "left_cuff"}),
        "stages.*grasp.middle.* should be 'left' or 'right'"),
    (_set([*STEPS, 3, "recorded"], False), "recorded steps must follow each other; got rr-rrr"),
    (_set([*STAGE, "on_loss"], "giveup"), "on_loss should be 'again' or 'lay down'; got 'giveup'"),
    (_set([*STAGE, "moved_at_most"], -1.0), "moved_at_most should be greater"),
    (_set([*STAGE, "definitions"], {"a b": "1"}), "a name must be"),
    (_drop(*MOVE, "step"), r"stages\[0\].steps\[2\]: a step is one of .*; got None"),
    (_step(1, {"step": "jump"}), r"steps\[1\]: a step is one of \['approach', .*; got 'jump'"),
    (_step(1, {"step": ["move"]}), r"steps\[1\]: a step is one of"),
    (_step(1, "move"), r"steps\[1\]: a step is one of"),
    (_step(2, {"step": "via", "left": []}), r"steps\[2\].*at least 1 item"),
    (
        _step(2, {"step": "via", "left": [["0", "1", "0"]], "tension": {"left": 3.0}}),
        "a tension needs `towards` and via points of its hands",
    ),
    (
        _step(2, {"step": "via", "left": [["0", "1", "0"]], "right": [["0", "1", "0"]] * 2}),
        r"equally many via points; got \{'left': 1, 'right': 2\}",
    ),
    (_step(1, {"step": "hand_pose", "pose": "close", "speed": 2}), "speed: unexpected keyword"),
    (_step(1, {"step": "hand_pose", "pose": "close", "hands": []}), "hands.*at least 1 item"),
    (_step(1, {"step": "hand_pose", "pose": "fist"}),
        r"a hand pose is one of \[.*'close'.*; got 'fist'"),
    (_step(6, {"step": "release", "pose": "drop"}),
        r"a hand pose is one of \[.*'open'.*; got 'drop'"),
    (_step(0, {"step": "approach", "orientation": "hems"}), "'hems' is not for the left hand"),
    (_step(0, {"step": "approach", "orientation": "sideways"}),
        "orientation .*'heap'.*; got 'sideways'"),
    (_set([*MOVE, "orientation"], "sideways"), "orientation .*'heap'.*; got 'sideways'"),
    (_step(3, {"step": "stretch", "sag": 0.03}), "by: field required"),
    (_step(2, STRETCH), r"a stretch needs both hands; got \['left'\]"),
    (_step(3, STRETCH | {"sag": 0}), "sag should be greater"),
    (_step(3, STRETCH | {"by": 1e-300}), "by should be greater"),
    *((_step(3, {"step": "wait", "frames": n}), "frames should be") for n in (0, 10**12, 1.5,
        True)),
    *((_set([*MOVE, "spacing"], v), "spacing should be") for v in (0, -0.01, 1e-300, "fast",
        1e300)),
    (_step(7, {"step": "retreat", "wait": 10**12}), "wait should be less"),
    (_step(7, {"step": "retreat", "spacing": 1e-300}), "spacing should be greater"),
    (_step(7, {"step": "retreat", "back": []}), "back.* at least 1 item"),
    (_step(7, {"step": "retreat", "rise": 10}), "rise should be less"),
    (_set([*MOVE, "recorded"], "no"), "recorded should be a valid boolean; got 'no'"),
    (_set([*STEPS, 0, "height"], "low"), "height should be a valid number; got 'low'"),
    (_set([*STEPS, 0, "height"], 300), "height should be less"),
    (_set([*STEPS, 0, "come_from"], [0.0, 0.1]), r"come_from\[2\]: field required"),
    (_drop(*MOVE, "left"), "a move has targets for some of"),
    (_set([*MOVE, "right"], ["0", "0.8", "0.3"]), r"moves must be of \['left'\]"),
    (_set([*MOVE, "middle"], ["0"] * 3), "middle: unexpected keyword"),
    (_left("0", "0"), r"targets.left\[2\]: field required"),
    (_left("0", "0", True), r"targets.left\[2\] should be a valid string"),
    (_set([*MOVE, "left"], "abc"), "targets.left should be"),
    (_grasp([]), "a grasp must have either points or a position"),
    (_grasp({"at": ["0", "0.8"]}), r"at\[2\]: field required"),
    (_grasp({"at": ["0", "0.8", "0.1"], "near": 0.1}), "near: unexpected keyword"),
)  # fmt: skip
UNFIT = (
    (_set(["task"], "FoldDress-v1"), "task must be 'FoldTops-v1'; got 'FoldDress-v1'"),
    (_set(["garment"], "Dress_LongSleeve/000000"),
        "garment must be of Tops_LongSleeve; got 'Dress"),
    (_set(["garment"], "Tops_LongSleeve/999999"), "999999"),
    (_drop("points", "collar"), "the points must have 'collar', which the rule judges"),
    (_left("left_cuf.x", "0.8", "0.3"),
        "stage 'left_sleeve': .*unknown name 'left_cuf'; known: .*centre"),
    (_left("now.centre.x", "0.8", "0.3"), "unknown name 'now'"),
    (_left("left_cuff.w", "0.8", "0.3"), "'left_cuff.w' is neither"),
    (_left("left_cuff", "0.8", "0.3"), "'left_cuff' gives a point"),
    (_left("__import__('os')", "0.8", "0.3"), "unknown function '__import__'"),
    (_left("-" * 10**5 + "1", "0.8", "0.3"), "at most 1000 characters; got 100001"),
    (_left("hanger.target.x", "0.8", "0.3"), "unknown name 'hanger'"),
    (_left("half_span", "0.8", "0.3"), "unknown name 'half_span'"),
    (_grasp("left_cuf"), r"unknown points \['left_cuf'\]; known: \['centre'"),
    (_grasp(["left_cuff", "left_cuf"]), r"unknown points \['left_cuf'\]"),
    (_grasp({"at": ["garment.min.x", "garment.middle.y", "0"]}),
        "unknown name 'middle'; known: centre, max, min"),
    (_set([*STAGE, "definitions"], {"b": "a * 2", "a": "left_cuff.x"}), "unknown name 'a'"),
    (_set([*STAGE, "definitions"], {"left_cuff": "1"}),
        "definition 'left_cuff' must not have the name"),
    (_set([*STAGE, "when"], "left_knee.x > 0"), "unknown name 'left_knee'"),
    (_set([*STAGE, "when"], "now.max.z > 0"), "unknown name 'now'"),
    (_set([*STAGE, "when"], "held and"), "arithmetic expression"),
    (_point([0.0, 1.2, 0.0]), "point 'collar' must be on Tops_.*, in metres; got .* m from it"),
)  # fmt: skip


def _find_wrong(content, table, make):
    """Rows whose change is not refused with their message, or with one longer than two lines."""
    wrong = []
    for number, (change, message) in enumerate(table):
        faulty = copy.deepcopy(content)
        change(faulty)
        try:
            make(faulty)
            found = "taken"
        except DemonstrationError as err:
            found = str(err)
        if not re.match(rf"top\.json: .*{message}", found) or len(found) > 2000:
            wrong.append((number, message, found))
    return wrong


def _parse(content):
    return parse_demonstration(content, source="top.json")


def _check(content, task=TASK):
    check_demonstration(_parse(content), task, source="top.json")


def test_faults_are_told_when_a_demonstration_is_parsed(content):
    assert _find_wrong(content, FAULTS, _parse) == []
    _parse(content)


def test_faults_are_told_when_a_demonstration_is_compared_with_its_task(content):
    assert _find_wrong(content, UNFIT, _check) == []
    same = dict.fromkeys(content["points"], content["points"]["collar"])
    with pytest.raises(DemonstrationError, match=r"points .* must differ; got .* twice"):
        _check(content | {"points": same})
    _check(content)


def test_fields_are_checked_in_python_too():
    for make, message in (
        (lambda: Wait(frames=True), "frames should be"),
        (lambda: Move(targets={"left": ("0", "0", "0")}, spacing=1e-300), "spacing should be"),
        (lambda: Grasp(points=("a",), at=("0", "0", "0")), "either points or a position"),
    ):
        with pytest.raises(ValueError, match=message):
            make()


@pytest.mark.parametrize("task_id", task_ids())
def test_packaged_demonstrations_pass_all_checks(task_id):
    check_demonstration(load_demonstration(task_id), get_task(task_id), source=task_id)


def test_what_a_stretch_sees_is_known_after_it(content):
    content["stages"][0]["grasp"] = {"left": "left_cuff", "right": "right_cuff"}
    content["stages"][0]["steps"][2] = STRETCH
    content["stages"][0]["steps"][3]["left"][0] = "half_span + hanging"
    _check(content)


@pytest.fixture
def with_hanger():
    """The task with a hanger in its scene."""
    hanger = SceneObject(name="hanger", prop="hanger", position=(0.0, 0.8, 0.0))
    return dataclasses.replace(TASK, objects=(hanger,))


def test_formulas_may_use_frames_of_the_objects(content, with_hanger):
    content["stages"][0]["steps"][2]["left"][0] = "hanger.target.x"
    content["stages"][0]["definitions"]["above"] = "hanger.target.z + 0.1"
    _check(content, with_hanger)


def test_unknown_frames_of_an_object_are_refused(content, with_hanger):
    for formula, message in (
        ("hanger.nowhere.x", "unknown name 'nowhere'; known: .*target"),
        ("hanger.target", "'hanger.target' gives a point"),
        ("hanger.x", "unknown name 'x'"),
        ("stand.target.x", "unknown name 'stand'; known: .*hanger"),
    ):
        table = (
            (_left(formula, "0.8", "0.3"), message),
            (_set([*STAGE, "definitions"], {"above": formula}), message),
            (_grasp({"at": [formula, "0.8", "0.1"]}), message),
            (
                _step(2, {"step": "via", "left": [["0", "0.8", "0.3"], ["0", formula, "0"]]}),
                message,
            ),
            (
                _step(2, {"step": "via", "left": [["0"] * 3], "towards": [formula, "0", "0"]}),
                message,
            ),
            (_step(2, {"step": "move", "left": ["0", "0.8", "0.3"], "turn": formula}), message),
        )
        assert _find_wrong(content, table, lambda c: _check(c, with_hanger)) == []
    _point([0, 0.2, 0], "hanger")(content)
    with pytest.raises(DemonstrationError, match="must not have the names of objects"):
        _check(content, with_hanger)


def test_a_garment_that_may_turn_over_is_first_taken_by_both_hands(content):
    content["turns_over"] = True  # but its first stage is the left hand's
    with pytest.raises(DemonstrationError, match=r"^top\.json: .*turns_over"):
        _parse(content)


def test_an_unknown_point_on_the_garment_at_hand_names_its_stage(demonstration):
    points = {k: v for k, v in P.items() if k != "right_chest"}
    stage = get_stage(demonstration, "left_sleeve")
    with pytest.raises(DemonstrationError, match=r"'left_sleeve': .*unknown name 'right_chest'"):
        compute_targets(stage, points)


@pytest.mark.parametrize("where", ["target", "definition"])
def test_what_cannot_be_computed_on_the_garment_at_hand_names_its_stage(content, where):
    """Two points that are found at one place, and a formula that divides by their distance."""
    formula = "1 / distance_xy(left_cuff, left_chest)"
    stage = content["stages"][0]
    stage["definitions"] = {}
    stage["steps"] = [stage["steps"][0], {"step": "move", "left": ["0", "0.8", "0.1"]}]
    if where == "target":
        stage["steps"][1]["left"][0] = formula
    else:
        stage["definitions"] = {"share": formula}
        stage["steps"][1]["left"][0] = "share"
    first = parse_demonstration(content, source="top.json").stages[0]
    assert compute_targets(first, P)
    with pytest.raises(DemonstrationError, match=r"'left_sleeve': .*division by zero"):
        compute_targets(first, P | {"left_chest": P["left_cuff"]})


def test_definitions_are_worked_out_in_their_order(content):
    stage = content["stages"][0]
    stage["definitions"] = {"a": "left_cuff.x", "b": "a * 2"}
    stage["steps"] = [
        stage["steps"][0],
        {"step": "move", "left": ["a", "b", 0.1], "spacing": 0.005},
    ]
    demonstration = parse_demonstration(content, source="top.json")
    (targets,) = compute_targets(demonstration.stages[0], P)
    np.testing.assert_allclose(targets["left"], (-0.5, -1.0, 0.1))
    assert demonstration.stages[0].steps[1].spacing == 0.005


def test_what_is_seen_takes_the_place_of_what_was_expected():
    demonstration = load_demonstration("FlingTrousers-v1")
    stage = demonstration.stages[0]
    points = demonstration.values | {
        "left_waistband": np.array([-0.2, 0.8, 0]),
        "right_waistband": np.array([0.2, 0.8, 0]),
    }
    expected = compute_targets(stage, points)
    seen = compute_targets(stage, points, seen={"half_span": 0.25, "hanging": 0.6})
    np.testing.assert_array_equal(seen[0]["left"], expected[0]["left"])
    np.testing.assert_allclose(seen[1]["right"], (0.25, 1.1 - 1.2 * 0.6, 0.85 * 0.6))
    np.testing.assert_allclose(expected[1]["right"], (0.18, 0.3, 0.85 * 0.8))
    # what is long is laid farther away, as far as the arms reach: what is seen counts there too
    assert [way[2]["left"][1] for way in (seen, expected)] == pytest.approx([1.12, 1.18])


@pytest.mark.parametrize(("length", "pulled"), [(0.8, 0.09), (0.3, 0.036)])
def test_legs_are_pulled_away_from_the_waist_and_apart(length, pulled):
    demonstration = load_demonstration("FlingTrousers-v1")
    stage = get_stage(demonstration, "pull_legs")
    hems = {"left": np.array([-0.2, 0.35, 0]), "right": np.array([0.1, 0.4, 0])}
    points = {f"{side}_hem_middle": point for side, point in hems.items()}
    up = np.array([0, length, 0])
    points |= {f"{side}_waistband": point + up for side, point in hems.items()}
    before = hems
    for targets in compute_targets(stage, demonstration.values | points):
        for side, outwards in (("left", -1), ("right", 1)):
            way = targets[side] - before[side]
            assert way[1] < -pulled / 6
            assert outwards * way[0] > 0.005
        before = targets
    drawn = {side: before[side][1] - hems[side][1] for side in hems}
    assert drawn == pytest.approx({"left": -pulled, "right": -pulled})


@pytest.mark.parametrize("task", ["FlingTops-v1", "FlingDress-v1"])
def test_sleeves_turn_outwards_about_their_shoulders(task):
    """By the same angle, whichever way they lie, and as long as they are seen to be."""
    demonstration = load_demonstration(task)
    stage = get_stage(demonstration, "spread_sleeves")
    named = {name: parameter.value for name, parameter in demonstration.parameters.items()}
    angle, pull = named.get("angle", 25), named.get("pull", 0.021)
    points = {
        "left_shoulder": np.array([-0.15, 1.1, 0]),
        "right_shoulder": np.array([0.2, 1.15, 0]),
        "left_cuff": np.array([-0.2, 0.7, 0]),
        "right_cuff": np.array([0.2, 0.75, 0]),
    }
    last = compute_targets(stage, demonstration.values | points)[-1]
    for side, outwards in (("left", -1), ("right", 1)):
        before = (points[f"{side}_cuff"] - points[f"{side}_shoulder"])[:2]
        # the hand holds the sleeve 3 cm outside and towards the robots of what it was shown
        held = last[side][:2] - pull * np.array([outwards, -1])
        after = held - points[f"{side}_shoulder"][:2]
        turn = np.arctan2(after[1], outwards * after[0]) - np.arctan2(
            before[1], outwards * before[0]
        )
        assert np.degrees(turn) == pytest.approx(angle, abs=0.1)
        assert np.linalg.norm(after) == pytest.approx(1.02 * np.linalg.norm(before), rel=1e-3)
