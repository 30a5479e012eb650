"""One stage at work: grasp points, stretches and looks."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

from dgl_assets.robots import DEFAULT_ROBOT, HAND_POSES, SIDES
from dgl_collect.demonstration import load_demonstration
from dgl_collect.errors import DemonstrationError
from dgl_collect.skill import follow_recordings
from dgl_collect.stage_work import (
    REACHABLE_SPACING,
    REACHABLE_WITHIN,
    SWING_FRAMES,
    HoldLost,
    StageWork,
)
from dgl_collect.steps import (
    Approach,
    Follow,
    Grasp,
    HandPose,
    Look,
    Move,
    Release,
    Retreat,
    Stage,
    Stretch,
    Via,
    Wait,
)
from dgl_tasks.errors import UnreachableError
from dgl_tasks.grasps import GRASP_ORIENTATIONS, orient, point_along_fingers
from dgl_tasks.hanging import Hanging
from dgl_tasks.messages import Believes, Carrying, StageBegins
from dgl_tasks.rotations import to_rotation

joint_slice = DEFAULT_ROBOT.joint_slice

POINT = np.array([-0.4, 0.7, 0.015])
TOPS = load_demonstration("FoldTops-v1")
LEFT = {"left": Grasp(points=("left_cuff",))}
BOTH = LEFT | {"right": Grasp(points=("right_cuff",))}
PLACES = {"left": POINT, "right": POINT * [-1, 1, 1]}


def make_stage(*steps, grasp=LEFT, **changes):
    return Stage(name="stage", grasp=grasp, steps=(Approach(), *steps), **changes)


def make_work(world, stage, *, places=None, names=None, reaction="give up", **changes):
    return StageWork(
        stage=stage,
        hands=world.hands,
        names={} if names is None else names,
        cloud=world.cloud,
        places={side: PLACES[side] for side in stage.hands} if places is None else places,
        begins=StageBegins(
            name=stage.name,
            garment_point_cloud=world.cloud,
            points_affordance_feature=np.zeros((len(world.cloud), 2), np.float32),
            seen_at=world.step,
        ),
        reaction=reaction,
        draw=(1, 1, 1),
        **changes,
    )


def carry_out(world, work):
    """Carry out all steps of a stage."""
    world.play(world.hands.park())
    work.choose_turns(must_do_all=True)
    world.play(world.hands.mark(work.begins))
    for step in work.stage.steps:
        world.play(work.perform(step))


# Where it takes hold ----------------------------------------------------------------------------


def test_hands_take_hold_at_the_height_of_the_stage(make_world):
    work = make_work(make_world(), make_stage())
    np.testing.assert_allclose(work.grasp["left"], (*POINT[:2], 0.03))
    low = dataclasses.replace(work.stage, steps=(Approach(height=0.0),))
    np.testing.assert_allclose(make_work(make_world(), low).grasp["left"], (*POINT[:2], 0.0))
    # of what does not lie on the ground, the place says how high it is
    own = dataclasses.replace(work.stage, steps=(Approach(height=None),))
    np.testing.assert_allclose(make_work(make_world(), own).grasp["left"], POINT)


def test_a_hand_stops_short_of_its_point_along_its_fingers(make_world):
    stage = Stage(
        name="spread",
        grasp=BOTH,
        steps=(Approach(orientation="sides", short_by=0.03, height=0.02),),
    )
    work = make_work(make_world(), stage)
    for side, grasp in work.grasp.items():
        along = point_along_fingers(orient("sides", side))
        np.testing.assert_allclose(grasp, [*PLACES[side][:2], 0.02] - 0.03 * along)
        assert np.sign(along[0]) == (1 if side == "left" else -1)  # it comes from outside


def test_what_is_out_of_reach_is_taken_as_near_to_it_as_can_be(make_world):
    world, stage = make_world(), make_stage()
    y = np.arange(0.7, 1.7, 0.005)
    strip = np.column_stack([np.full(len(y), -0.4), y, np.full(len(y), 0.01)])

    def find_reachable(point, cloud):
        world.cloud = cloud
        work = make_work(world, stage, places={"left": point})
        world.motion.reset(world.motion.robot.compute_start("open"))
        work.find_reachable()
        assert work.grasp["left"][2] == 0.03
        return work.grasp["left"][:2]

    nothing = np.zeros((0, 3))

    def can_reach(point):
        try:
            np.testing.assert_array_equal(find_reachable(point, nothing), point[:2])
        except UnreachableError:
            return False
        return True

    ahead = [place for place in strip[:: len(strip) // 40] if can_reach(place)]
    farthest = max(ahead, key=lambda place: place[1])
    farthest = max(
        (place for place in strip if 0 <= place[1] - farthest[1] < 0.05 and can_reach(place)),
        key=lambda place: place[1],
    )
    inside, outside = (farthest + np.array([0, y, 0]) for y in (-0.3, 0.05))
    np.testing.assert_array_equal(find_reachable(inside, strip), inside[:2])
    place = find_reachable(outside, strip)
    assert place.tolist() in strip[:, :2].tolist()
    assert farthest[1] - 2 * REACHABLE_SPACING < place[1] <= farthest[1]
    # what lies too far from the point is another place of the garment
    with pytest.raises(UnreachableError) as of_the_point:
        find_reachable(outside, nothing)
    far = strip[strip[:, 1] < outside[1] - REACHABLE_WITHIN]
    with pytest.raises(UnreachableError) as error:
        find_reachable(outside, far)
    assert str(error.value) == str(of_the_point.value)


def test_both_hands_turn_with_an_object(make_world):
    """Counter-clockwise by the formula, and until another move turns them."""
    up = {side: (f"{side}_point.x", f"{side}_point.y", "0.3") for side in SIDES}
    higher = {side: (x, y, "0.35") for side, (x, y, _) in up.items()}
    stage = make_stage(Move(targets=up, turn="angle"), Move(targets=higher), grasp=BOTH)
    names = {f"{side}_point": place for side, place in PLACES.items()} | {"angle": 20.0}
    world = make_world()
    work = make_work(world, stage, names=names)
    world.play(world.hands.park())
    work.choose_turns(must_do_all=True)
    assert set(work._turns.values()) == {0.0}
    for step in stage.steps:
        world.play(work.perform(step))
        turned = 20.0 if isinstance(step, Move) else 0.0
        for side, pose in zip(SIDES, world.ee_pose, strict=True):
            turn = to_rotation(pose[3:]) * to_rotation(orient("standard", side)).inv()
            np.testing.assert_allclose(turn.as_rotvec(degrees=True), [0, 0, turned], atol=0.2)


def test_hands_keep_the_orientation_in_which_a_way_has_left_them(make_world):
    """Until a move gives them another; rehearsals plan from there, too."""
    over = {"left": (("-0.4", "0.7", "0.3"), ("-0.1", "0.75", "0.35"))}
    aside, back = (Move(targets={"left": (x, "0.75", "0.35")}) for x in ("-0.15", "-0.2"))
    named = dataclasses.replace(back, orientation="heap")
    world = make_world()
    work = make_work(world, make_stage(Via(targets=over), aside, named))
    carry_out(world, work)
    assert work._targets["left"] == pytest.approx([-0.2, 0.75, 0.35])
    world = make_world()
    work = make_work(world, make_stage(Via(targets=over), aside))
    carry_out(world, work)
    free = work.orientations["left"]
    np.testing.assert_allclose(abs(free @ world.ee_pose[0, 3:]), 1.0, atol=1e-4)
    assert world.get_grasp_point("left") == pytest.approx([-0.15, 0.75, 0.35], abs=2e-3)
    far = Via(targets={"left": (("-0.4", "0.7", "0.3"), ("-0.4", "3", "0.3"))})
    work = make_work(make_world(), make_stage(far))
    with pytest.raises(UnreachableError, match="with any orientation of the hand"):
        work.choose_turns(must_do_all=True)


def test_hands_may_open_one_after_the_other(make_world):
    close, release = HandPose(pose="close"), Release(hands=("left",))
    stage = make_stage(close, release, grasp=BOTH)
    world = make_world()
    carry_out(world, make_work(world, stage))
    for side, pose in (("left", "open"), ("right", "close")):
        hand = world.hands.motion.target[joint_slice(side, "hand")]
        np.testing.assert_allclose(hand, DEFAULT_ROBOT.get_hand_pose(pose), atol=1e-6)
    with pytest.raises(ValueError, match=r"hands must be of \['left'\]; got \('right',\)"):
        make_stage(close, Release(hands=("right",)))


def test_a_way_points_the_fingers_at_a_place(make_world):
    over = {"left": (("-0.4", "0.7", "0.3"), ("-0.1", "0.75", "0.35"))}
    along = {}
    for towards in (None, ("0.6", "0.7", "0.35")):
        world = make_world()
        work = make_work(world, make_stage(Via(targets=over, towards=towards)))
        carry_out(world, work)
        along[towards] = to_rotation(work.orientations["left"]).apply([1.0, 0.0, 0.0])
    plain, aimed = along.values()
    assert plain[0] < 0.6
    assert aimed[0] > 0.85


def test_a_way_of_a_slack_garment_ends_farther_from_where_it_comes_from(make_world):
    """And later steps begin there."""
    over = {"left": (("-0.4", "0.7", "0.3"), ("-0.2", "0.75", "0.35"))}
    world = make_world()
    world.pulls = {"left": np.zeros(3)}
    way = Via(targets=over, towards=("-0.6", "0.75", "0.35"), tension={"left": 3.0})
    work = make_work(world, make_stage(way))
    carry_out(world, work)
    assert work._targets["left"] == pytest.approx(world.get_grasp_point("left"), abs=1e-3)
    shift = work._targets["left"] - [-0.2, 0.75, 0.35]
    assert 0.05 < shift[0] <= 0.201
    assert np.abs(shift[1:]).max() < 0.02


FAR = Move(targets={"left": ("-0.4", "3", "0.3")})
NEAR = Move(targets={"left": ("-0.3", "0.8", "0.3")})


def test_all_steps_have_to_be_within_reach_where_they_are_followed(make_world):
    work = make_work(make_world(), make_stage(NEAR, FAR))
    with pytest.raises(UnreachableError, match="left arm"):
        work.choose_turns(must_do_all=True)
    work.choose_turns(must_do_all=False)  # else as much of it as can be
    assert list(work.orientations) == ["left"]
    near = make_work(make_world(), make_stage(NEAR))
    near.choose_turns(must_do_all=True)
    np.testing.assert_array_equal(
        work.orientations["left"], near.orientations["left"]
    )  # turned for what it can do


def test_not_even_an_approach_that_is_out_of_reach_will_do(make_world):
    work = make_work(make_world(), make_stage(NEAR), places={"left": np.array([-0.4, 3.0, 0.0])})
    with pytest.raises(UnreachableError, match="left arm"):
        work.choose_turns(must_do_all=False)


def test_nothing_is_sent_while_it_is_chosen(make_world):
    world = make_world()
    before = world.motion.target.copy()
    work = make_work(world, make_stage(NEAR, Release(), Retreat()))
    work.find_reachable()
    work.choose_turns(must_do_all=True)
    np.testing.assert_array_equal(world.motion.target, before)
    assert world.commands == []


# Its steps --------------------------------------------------------------------------------------


def test_a_stage_is_carried_out_step_by_step(make_world):
    world = make_world()
    move = Move(targets={"left": ("x", "y", "0.3")})
    stage = make_stage(
        HandPose(pose="close"), move, Wait(frames=7), Release(), Retreat(),
        definitions={"x": "-0.3", "y": "point.y + 0.1"},
    )  # fmt: skip
    work = make_work(world, stage, names={"point": POINT})
    world.play(world.hands.park())
    work.choose_turns(must_do_all=True)
    hand, path = joint_slice("left", "hand"), {}
    for step in stage.steps:
        first = world.step
        world.play(work.perform(step))
        rows = world.commands[first:]
        path[type(step)] = rows
        assert {row.recorded for row in rows} <= (
            {"stage"} if step.recorded else {"approach", None}
        )
        if isinstance(step, Approach):
            np.testing.assert_allclose(world.get_grasp_point("left"), (*POINT[:2], 0.03), atol=2e-3)
        elif isinstance(step, Move):
            np.testing.assert_allclose(world.get_grasp_point("left"), (-0.3, 0.8, 0.3), atol=2e-3)
        elif isinstance(step, Release):
            np.testing.assert_allclose(rows[-1].target[hand], HAND_POSES["open"], atol=1e-6)
        elif isinstance(step, HandPose):
            np.testing.assert_allclose(rows[-1].target[hand], HAND_POSES["close"], atol=1e-6)
    assert len(path[Wait]) == 7
    # whole frames of the way there may be recorded
    assert sum(row.recorded == "approach" for row in path[Approach]) % 5 == 0
    assert [row.is_passage for row in path[Move]] == [False] * len(path[Move])
    assert world.is_parked
    right = joint_slice("right", "arm")
    assert np.ptp([row.target[right] for row in path[Move]], axis=0).max() == 0  # it rests


def test_what_is_not_recorded_comes_before_and_after_what_is(make_world):
    world = make_world()
    wait = Wait(frames=1, recorded=False)
    stage = make_stage(wait, HandPose(pose="close"), NEAR, Release(), wait, Retreat())
    work = make_work(world, stage)
    before, after = (list(work.iterate_scripted(is_after=when)) for when in (False, True))
    assert [type(step) for step in before] == [Approach, Wait]
    assert [type(step) for step in after] == [Wait, Retreat]
    # what no policy learns comes before, all of it
    plain = make_stage(HandPose(pose="close", recorded=False), Retreat())
    work = make_work(world, plain)
    assert not plain.is_learned
    assert list(work.iterate_scripted(is_after=False)) == list(plain.steps)
    assert list(work.iterate_scripted(is_after=True)) == []


# Stretching -------------------------------------------------------------------------------------

HELD = {"left": np.array([-0.2, 0.7, 0.5]), "right": np.array([0.2, 0.7, 0.5])}


def stretch(world, **changes):
    """Stretch what hangs between hands that are 0.4 m apart."""
    step = Stretch(**{"sag": 0.03, "by": 0.01, "at_most": 0.15, "spacing": 0.005} | changes)
    targets = {side: tuple(map(str, place)) for side, place in HELD.items()}
    lift = Move(targets=targets, orientation="heap")
    stage = make_stage(HandPose(pose="close"), lift, step, grasp=BOTH)
    work = make_work(world, stage)
    world.play(world.hands.park())
    work._turns = dict.fromkeys(SIDES, 0.0)
    world.play(world.hands.send(world.motion.set_hands(dict.fromkeys(SIDES, "close"))))
    world.play(world.hands.send(world.motion.reach(HELD, GRASP_ORIENTATIONS["heap"])))
    world.play(work.perform(lift))
    before = world.step
    world.play(work.perform(step))
    return work, before


def hang_until(taut):
    """A garment that is taut when the hands are this far apart [m]."""
    return lambda span: Hanging(sag=max(taut - span, 0.0), length=0.7)


@pytest.mark.parametrize(("taut", "each"), [(0.5, 0.04), (0.43, 0.0), (0.9, 0.15), (9.0, 0.0)])
def test_hands_move_apart_until_the_garment_is_taut(make_world, taut, each):
    world = make_world()
    world.hanging = hang_until(taut)
    work, before = stretch(world)
    # by whole steps; no farther than allowed; not at all where nothing hangs between them
    assert work.seen == {
        "half_span": pytest.approx(0.2 + each, abs=1e-6),
        "hanging": 0.7,
    }
    for side, outwards in (("left", -1), ("right", 1)):
        expected = HELD[side] + [outwards * each, 0, 0]
        np.testing.assert_allclose(world.get_grasp_point(side), expected, atol=2e-3)
    assert world.step - before >= SWING_FRAMES
    assert {command.recorded for command in world.commands[before:]} == {"stage"}


def test_hands_stop_moving_apart_when_the_garment_slides(make_world):
    world, still = make_world(), hang_until(0.5)

    def slide(span):
        seen = still(span)
        return dataclasses.replace(seen, sag=seen.sag + 2 * max(span - 0.43, 0.0))

    world.hanging = slide
    work, _ = stretch(world, sag=0.01)
    assert work.seen["half_span"] == pytest.approx(0.22, abs=1e-6)  # the second step gains nothing


def test_what_has_been_lost_is_not_stretched(make_world):
    world = make_world()
    targets = {side: tuple(map(str, place)) for side, place in HELD.items()}
    step = Stretch(sag=0.03, by=0.01, at_most=0.15, spacing=0.005)
    stage = make_stage(Move(targets=targets), step, grasp=BOTH)
    work = make_work(world, stage, reaction="lay down", hold="some")
    world.play(work.perform(step))
    assert world.commands == []
    assert work.seen == {}


def test_what_is_seen_takes_the_place_of_what_was_expected(make_world):
    world = make_world()
    definitions = {"half_span": "0.1", "hanging": "0.5", "twice": "2 * half_span"}
    stage = make_stage(grasp=BOTH, definitions=definitions)
    work = make_work(world, stage, names={"half_span": 9.0})
    np.testing.assert_allclose(work._compute(("half_span", "twice", "hanging")), (0.1, 0.2, 0.5))
    work.seen |= {"half_span": 0.3}
    np.testing.assert_allclose(work._compute(("half_span", "twice", "hanging")), (0.3, 0.6, 0.5))


# What is seen on the way --------------------------------------------------------------------------


def lift_two_hands(world, far, **changes):
    """Hands that are up with the garment this far below each of them [m]."""
    work = make_work(world, make_stage(grasp=BOTH), **changes)
    work._turns = dict.fromkeys(SIDES, 0.0)
    world.play(world.hands.send(world.motion.reach(HELD, GRASP_ORIENTATIONS["heap_sides"])))
    world.see_points = lambda camera="environment_camera": np.stack(
        [world.get_grasp_point(s) - [0, 0, d] for s, d in zip(SIDES, far, strict=True)]
    )
    return work


@pytest.mark.parametrize(
    ("far", "empty"),
    [
        ((0.05, 0.05), set()),
        ((0.2, 0.05), {"left"}),
        ((0.05, 0.2), {"right"}),
        ((0.2, 0.2), {"left", "right"}),
    ],
)
def test_what_each_reaction_makes_of_hands_that_are_seen_to_be_empty(make_world, far, empty):
    world = make_world()
    work = lift_two_hands(world, far, reaction="ignore")
    assert work.find_empty() == empty
    work.react(work.find_empty())
    assert work.hold == "all"  # nobody looks
    for reaction in ("lay down", "give up"):
        work = dataclasses.replace(work, reaction=reaction, hold="all")
        ends = bool(empty) and (reaction == "give up" or len(empty) == 2)
        if ends:  # also where nothing is left to lay down
            with pytest.raises(HoldLost):
                work.react(work.find_empty())
        else:
            work.react(work.find_empty())
        assert work.hold == ("some" if empty else "all")


def test_what_is_out_of_sight_is_not_taken_to_be_lost(make_world):
    world = make_world()
    work = lift_two_hands(world, (0.2, 0.2))
    assert work.find_empty() == {"left", "right"}
    del world.see_points
    world.cloud = np.zeros((0, 3), np.float32)
    assert work.find_empty() == set()


def test_a_hand_that_is_low_may_hold_what_lies(make_world):
    world = make_world()
    work = make_work(world, make_stage())
    world.loses = lambda *_: True
    low = {"left": np.array([*POINT[:2], 0.05])}
    world.play(world.hands.send(world.motion.reach(low, GRASP_ORIENTATIONS["standard"])))
    assert work.find_empty() == set()


@pytest.mark.parametrize("checked", [(True, False), (False, True), (False, False)])
def test_it_is_looked_where_the_demonstration_says_so(make_world, checked):
    """Hands that hold nothing: the stage ends at the first step that is looked at."""
    world = make_world()
    world.loses = lambda *_: True
    up = [dataclasses.replace(NEAR, checked=one) for one in checked]
    stage = make_stage(HandPose(pose="close"), *up, Release(), Retreat())
    work = make_work(world, stage)
    if any(checked):
        with pytest.raises(HoldLost):
            carry_out(world, work)
        assert work.hold == "some"
        assert len(world.get_marks(Carrying)) == checked.index(True)
    else:
        carry_out(world, work)
        assert work.hold == "all"


def test_whoever_knows_the_truth_may_look_wherever_something_is_carried(make_world):
    world = make_world()
    last = Move(targets={"left": ("-0.3", "0.9", "0.3")})
    stage = make_stage(HandPose(pose="close"), NEAR, NEAR, Release(), last, Retreat())
    carry_out(world, make_work(world, stage))
    marks = world.get_marks(Carrying)  # not once it has been let go
    assert [(mark.is_first, mark.where) for mark in marks] == [(True, "move 1"), (False, "move 2")]
    assert {(mark.stage, mark.hands) for mark in marks} == {("stage", ("left",))}


def test_a_stretch_is_looked_at_as_a_move_is(make_world):
    world = make_world()
    world.loses = lambda stage, number, side: side == "left"
    step = Stretch(sag=0.03, by=0.01, at_most=0.15, spacing=0.005, checked=True)
    targets = {side: tuple(map(str, place)) for side, place in HELD.items()}
    lift = Move(targets=targets, orientation="heap")
    stage = make_stage(HandPose(pose="close"), lift, step, lift, grasp=BOTH)
    work = make_work(world, stage, reaction="lay down")
    carry_out(world, work)
    assert work.hold == "some"
    assert [mark.is_first for mark in world.get_marks(Carrying)] == [True, False, False]


def test_the_whole_of_a_real_stage_can_be_carried_out(make_world):
    """Fold Tops' left sleeve, where the demonstration's own garment lies."""
    ahead = np.array([0, 0.8, 0])
    points = {name: place + ahead for name, place in TOPS.points.items()}
    world = make_world(cloud=list(points.values()))
    stage = TOPS.stages[0]
    work = make_work(world, stage, names=points, places={"left": points["left_cuff"]})
    carry_out(world, work)
    assert work.hold == "all"
    assert world.is_parked
    assert [mark.where for mark in world.get_marks(Carrying)] == [f"move {k}" for k in (1, 2, 3, 4)]


# What is seen on the way ------------------------------------------------------------------------


AFTER_A_LOOK = Move(
    targets={"left": ("now.left_hand.x + 0.1", "now.left_hand.y + 0.8 - now.centre.y", "0.3")}
)


AFTER_A_LOOK_DEFINED = Move(
    targets={"left": ("now.left_hand.x + 0.1", "now.left_hand.y + dy", "0.3")}
)
"""The same, with a definition that names what is seen."""


@pytest.mark.parametrize("after", [AFTER_A_LOOK, AFTER_A_LOOK_DEFINED])
@pytest.mark.parametrize("shift", [0.0, 0.05])
def test_hands_that_look_put_right_how_the_garment_lies_in_them(make_world, shift, after):
    world = make_world()
    lift = Move(targets={"left": (str(POINT[0]), str(POINT[1]), "0.3")})
    definitions = {"dy": "0.8 - now.centre.y"}
    stage = make_stage(HandPose(pose="close"), lift, Look(), after, definitions=definitions)
    work = make_work(world, stage)
    middle = (world.cloud.min(axis=0) + world.cloud.max(axis=0)) / 2
    world.cloud = world.cloud + np.float32([0.0, shift, 0.0])  # it has slipped since
    carry_out(world, work)
    expected = [POINT[0] + 0.1, POINT[1] + 0.8 - (middle[1] + shift), 0.3]
    np.testing.assert_allclose(world.get_grasp_point("left"), expected, atol=2e-3)


def test_before_it_is_looked_at_the_garment_is_expected_as_it_was_grasped(make_world):
    """Steps after a look are planned first: a target out of reach is refused then."""
    far = Move(targets={"left": ("now.centre.x - 4", "now.left_hand.y", "0.3")})
    work = make_work(make_world(), make_stage(HandPose(pose="close"), Look(), far))
    with pytest.raises(UnreachableError):
        work.choose_turns(must_do_all=True)
    work.choose_turns(must_do_all=False)


@pytest.mark.parametrize(("slips", "turn"), [(0.0, 0), (0.06, 15)])
def test_hands_are_turned_where_what_is_seen_leads_out_of_reach(make_world, slips, turn):
    """At z = 0.3 m and y = 0.7 m the left hand reaches x = 0.53 m, turned by 15 degrees 0.62 m."""
    world = make_world()
    lift = Move(targets={"left": (str(POINT[0]), "0.7", "0.3")})
    across = Move(targets={"left": ("0.5 + now.centre.x", "0.7", "0.3")})
    work = make_work(world, make_stage(HandPose(pose="close"), lift, Look(), across))
    world.see_garment = lambda: world.cloud + np.float32([slips, 0, 0])
    carry_out(world, work)
    assert np.degrees(work._turns["left"]) == pytest.approx(turn)
    expected = (0.5 + slips, 0.7, 0.3)
    np.testing.assert_allclose(world.get_grasp_point("left"), expected, atol=2e-3)


# Following recordings ---------------------------------------------------------------------------


class Arc:
    """A skill that lifts both hands, opens them with a turn, and notes what it was asked."""

    def __init__(self, *, height=0.15, count=50):
        self.height, self.count, self.asked = height, count, []

    def plan(self, stage, starts, anchors):
        self.asked.append((stage, dict(starts), dict(anchors)))
        share = np.linspace(0, 1, self.count + 1)[1:, None]
        closed = np.array([1.0, 0, 0, 0, 0]) * (share < 0.8)
        hands = {
            side: SimpleNamespace(
                points=start + share * [0, 0.05, self.height],
                turns=share * [0.2, 0, 0],
                poses=closed,
            )
            for side, start in starts.items()
        }
        return SimpleNamespace(hands=hands, spread=0.03)


def test_recordings_are_followed_from_the_grasp_points(make_world):
    world, skill = make_world(), Arc()
    names = {"garment": {"min": np.zeros(3)}, "left_cuff": POINT, "round": 1}
    work = make_work(world, make_stage(Follow(), grasp=BOTH), names=names, skill=skill)
    carry_out(world, work)
    stage, starts, anchors = skill.asked[-1]
    assert (stage, set(anchors)) == ("stage", {"garment.min", "left_cuff"})
    poses = world.motion.compute_poses()
    for side in SIDES:
        np.testing.assert_allclose(starts[side], work.grasp[side])
        np.testing.assert_allclose(
            world.get_grasp_point(side), work.grasp[side] + [0, 0.05, 0.15], atol=2e-3
        )
        before = to_rotation(work.orientations[side])
        turn = (before.inv() * to_rotation(poses[side][3:])).as_rotvec()
        np.testing.assert_allclose(turn, [0.2, 0, 0], atol=2e-3)
        np.testing.assert_allclose(
            world.motion.target[joint_slice(side, "hand")], HAND_POSES["open"], atol=1e-6
        )


def test_numbers_of_a_step_change_the_way(make_world):
    def follow(**numbers):
        world = make_world()
        work = make_work(world, make_stage(Follow(**numbers), grasp=BOTH), skill=Arc())
        carry_out(world, work)
        (told,) = world.get_marks(Believes)
        assert told.values == {"spread_stage_m": 0.03}
        ends = {side: world.get_grasp_point(side) - work.grasp[side] for side in SIDES}
        return ends, world.step

    _, usual = follow()
    ends, _ = follow(lift=2.0, shift=(0.02, -0.05, 0.01))
    np.testing.assert_allclose(ends["left"], [-0.02, 0.0, 0.31], atol=2e-3)
    np.testing.assert_allclose(ends["right"], [0.02, 0.0, 0.31], atol=2e-3)
    _, slow = follow(speed=0.5)
    assert slow == pytest.approx(usual + 50, abs=2)  # of 50 control steps, twice as many


def test_a_way_that_leads_out_of_reach_needs_a_method_that_may_stop_short(make_world):
    world, stage = make_world(), make_stage(Follow(), grasp=BOTH)
    work = make_work(world, stage, skill=Arc(height=2.0))
    world.play(world.hands.park())
    with pytest.raises(UnreachableError):
        work.choose_turns(must_do_all=True)
    work.choose_turns(must_do_all=False)
    for step in stage.steps:
        world.play(work.perform(step))
    assert 0.3 < world.get_grasp_point("left")[2] < 2.0


def test_without_recordings_nothing_is_followed(make_world):
    with pytest.raises(DemonstrationError, match="stage 'stage': no recordings to follow"):
        carry_out(make_world(), make_work(make_world(), make_stage(Follow())))


def test_one_step_takes_the_place_of_all_recorded_ones():
    for task in ("FoldTops-v1", "StoreTops-v1", "HangCoat-v1"):
        before = load_demonstration(task)
        after = follow_recordings(before)
        for old, new in zip(before.stages, after.stages, strict=True):
            assert new.is_learned is old.is_learned
            assert [s for s in new.steps if not s.recorded] == [
                s for s in old.steps if not s.recorded
            ]
            follows = [k for k, step in enumerate(new.steps) if isinstance(step, Follow)]
            if old.is_learned:
                first = next(k for k, step in enumerate(old.steps) if step.recorded)
                assert follows == [first]
            else:
                assert new is old
