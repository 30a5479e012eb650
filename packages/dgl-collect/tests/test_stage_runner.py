"""The course of a task: looks, tries, rounds and conditions, which rest on what is seen alone."""

import dataclasses
from collections import Counter
from types import SimpleNamespace

import numpy as np
import pytest

from dgl_assets import load_garment
from dgl_assets.props import make_prop
from dgl_assets.robots import DEFAULT_ROBOT, HAND_POSES, SIDES
from dgl_collect.actors import LIFT_HEIGHT, Expert, LiftAndDrop
from dgl_collect.belief import BelievedView
from dgl_collect.demonstration import load_demonstration
from dgl_collect.options import RunOptions
from dgl_collect.recording import EpisodeRecorder
from dgl_collect.setup import Setup, make_setup
from dgl_collect.stage_runner import TRIES, StageRunner
from dgl_collect.steps import (
    Approach,
    Demonstration,
    Grasp,
    HandPose,
    Look,
    Move,
    Retreat,
    Stage,
    Wait,
)
from dgl_tasks import get_task, task_ids
from dgl_tasks.errors import PerceptionError, UnreachableError
from dgl_tasks.evaluation import run_episode
from dgl_tasks.grasps import GRASP_ORIENTATIONS, wrist_to_grasp
from dgl_tasks.messages import BeginsAgain, Believes, StageBegins, StageEnds
from dgl_tasks.policy import Method
from dgl_tasks.success import CoversFlatArea, Criterion, Verdict

joint_slice = DEFAULT_ROBOT.joint_slice

TOPS = load_demonstration("FoldTops-v1")
CUFF = np.array([-0.4, 0.7, 0.01])
NAMES = ("one", "two", "three")
WORKS = (HandPose(pose="close"),)


def make_stage(name, *steps, grasp=("left",), **changes):
    points = {side: Grasp(points=(f"{side}_cuff",)) for side in grasp}
    return Stage(name=name, grasp=points, steps=(Approach(), *(steps or WORKS)), **changes)


def make_demonstration(*stages, **changes):
    stages = stages or tuple(make_stage(name) for name in NAMES)
    points = {"left_cuff": CUFF, "right_cuff": CUFF * [-1, 1, 1]}
    return Demonstration(task="FoldTops-v1", garment="any", points=points, stages=stages, **changes)


class Matcher:
    """Finds the first cloud point for the left cuff, the last for the right, and counts calls."""

    def __init__(self):
        self.asked = []

    def match(self, source_cloud, source_points, target_cloud):
        self.asked.append(len(source_points))
        far = [0 if point[0] < 0 else len(target_cloud) - 1 for point in source_points]
        similarity = np.zeros((len(far), len(target_cloud)))
        similarity[np.arange(len(far)), far] = 1.0
        return np.array(far), similarity

    @property
    def looks(self):
        """Number of looks at the whole garment, for both points at once."""
        return self.asked.count(2)


class Rule:
    """Measures what it is told to, look after look, and notes what it was shown."""

    landmarks, frames = (), ()

    def __init__(self, *values):
        self.values, self.views = list(values), []

    def __call__(self, view):
        self.views.append(view)
        value = self.values.pop(0)
        return Verdict(
            criteria=(Criterion(name="done", value=value, comparison=">=", threshold=0.8),)
        )


class Scripted:
    """Moves nothing; holds the garment, except as `turns` say by stage and try."""

    is_sent, follows_steps = False, False

    def __init__(self, turns=None):
        self.turns = turns or {}
        self.course, self.works = [], []
        self._times = Counter()

    def act(self, work):
        name = work.stage.name
        self.course.append(name)
        self.works.append(work)
        self._times[name] += 1
        yield from work.hands.send(work.hands.motion.hold(1), recorded="stage")
        turn = self.turns.get((name, self._times[name]))
        if turn == "out of reach":
            raise UnreachableError(f"{name} is out of reach")
        if turn == "some":
            work.react({work.stage.hands[0]})
        elif turn == "none":
            work.react(set(work.stage.hands))
        elif turn is not None:
            yield from turn(work) or ()


def make_runner(demonstration, *, rule=None, actor=None, matcher=None, **changes):
    matcher = matcher or Matcher()
    return StageRunner(
        demonstration=demonstration,
        demo_cloud=np.zeros((3, 3), np.float32),
        rule=rule or Rule(*[0.0] * 99),
        get_matcher=lambda: matcher,
        actor=actor or Scripted(),
        **changes,
    )


def get_ends(world):
    return [(mark.name, mark.counts) for mark in world.get_marks(StageEnds)]


def get_repeats(world):
    return [(mark.what, mark.stages) for mark in world.get_marks(BeginsAgain)]


# Rounds -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("rounds", "values", "gone_through"),
    [
        (1, [0.5], 1),
        (1, [0.9], 1),
        (3, [0.9], 1),
        (3, [0.5, 0.9], 2),
        (3, [0.5, 0.5, 0.5], 3),
        (2, [0.5, 0.9], 2),
    ],
)
def test_what_is_believed_not_to_be_done_begins_again(make_world, rounds, values, gone_through):
    world, rule, actor, matcher = make_world(), Rule(*values), Scripted(), Matcher()
    world.run(
        make_runner(make_demonstration(rounds=rounds), rule=rule, actor=actor, matcher=matcher)
    )
    assert actor.course == [*NAMES] * gone_through
    assert get_repeats(world) == [("round", NAMES)] * (gone_through - 1)
    # it is believed once a round, and kept
    assert [mark.values["value"] for mark in world.get_marks(Believes)] == values
    assert matcher.looks == gone_through  # on which side it lies now
    assert all(world.looks)  # past arms that are out of the way
    assert get_ends(world) == [(name, True) for name in NAMES] * gone_through


def test_rounds_are_those_of_the_demonstration_unless_another_number_is_asked_for(make_world):
    for rounds, expected in ((None, 3), (1, 1), (2, 2)):
        actor = Scripted()
        make_world().run(make_runner(make_demonstration(rounds=3), actor=actor, rounds=rounds))
        assert actor.course == [*NAMES] * expected


@pytest.mark.parametrize("count", [0, -1])
@pytest.mark.parametrize("field", ["rounds", "tries"])
def test_there_is_at_least_one_try_and_one_round(field, count):
    with pytest.raises(ValueError, match=f"{field} must be at least 1; got {count}"):
        make_runner(make_demonstration(), **{field: count})


def test_stages_that_stay_done_are_not_begun_again(make_world):
    first = make_stage("one", again=False)
    demonstration = make_demonstration(first, make_stage("two"), make_stage("three"), rounds=3)
    world, actor, matcher = make_world(), Scripted(), Matcher()
    world.run(make_runner(demonstration, rule=Rule(0.5, 0.9), actor=actor, matcher=matcher))
    assert actor.course == ["one", "two", "three", "two", "three"]
    # what went wrong in the stage that was kept still counts
    assert get_repeats(world) == [("round", ("two", "three"))]
    # how the garment lay at first says where it has to go
    assert matcher.looks == 1


def test_each_round_finds_the_points_anew(make_world):
    world, rule = make_world(), Rule(0.5, 0.9)

    def turn_over(work):
        world.cloud = world.cloud[::-1]

    actor = Scripted({("three", 1): turn_over})
    world.run(make_runner(make_demonstration(rounds=2), rule=rule, actor=actor))
    lefts = [view.landmarks["left_cuff"][0] for view in rule.views]
    assert lefts == pytest.approx([-0.4, 0.4])


# What is believed -------------------------------------------------------------------------------


def test_what_decides_is_what_is_seen_and_found(make_world):
    """The rule sees only the cameras and the matched points, never the truth."""
    world, rule = make_world(), Rule(0.5, 0.9)
    assert not hasattr(world, "env")
    world.frames = {"hanger": {"target": np.array([0.0, 0.8, 1.5])}}
    demonstration = make_demonstration(rounds=3)
    world.run(make_runner(demonstration, rule=rule, actor=Scripted()))
    after = rule.views[-1]
    assert all(isinstance(view, BelievedView) for view in rule.views)
    np.testing.assert_array_equal(after.top, world.cloud)
    np.testing.assert_allclose(after.landmarks["left_cuff"], CUFF, atol=1e-6)
    assert after.frames is world.frames
    assert [mark.values for mark in world.get_marks(Believes)] == [{"value": 0.5}, {"value": 0.9}]


@pytest.mark.parametrize(("height", "rounds"), [(0.0148, 1), (0.04, 3)])
def test_rounds_end_when_the_garment_is_seen_to_lie_as_low_as_what_lies_flat(
    make_world, height, rounds
):
    x, y = np.meshgrid(np.arange(-0.25, 0.25, 0.005), np.arange(0.5, 1.1, 0.005))
    cloud = np.column_stack([x.ravel() + 0.0025, y.ravel() + 0.0025, np.full(x.size, height)])
    actor = Scripted()
    world = make_world(cloud=cloud)
    world.run(make_runner(make_demonstration(rounds=3), rule=CoversFlatArea(), actor=actor))
    assert actor.course == [*NAMES] * rounds
    assert len(world.get_marks(Believes)) == rounds


def test_wrong_points_lead_to_another_decision(make_world):
    """A matcher that takes one side for the other believes that nothing lies where it should."""

    class Mirrored(Matcher):
        def match(self, source_cloud, source_points, target_cloud):
            return super().match(source_cloud, source_points * [-1, 1, 1], target_cloud)

    class LiesLeft(Rule):
        """Judges if the left cuff lies to the left."""

        def __call__(self, view):
            self.values = [float(view.landmarks["left_cuff"][0] < 0)]
            return super().__call__(view)

    for matcher, rounds in ((Matcher(), 1), (Mirrored(), 3)):
        actor = Scripted()
        demonstration = make_demonstration(rounds=3)
        make_world().run(make_runner(demonstration, rule=LiesLeft(), actor=actor, matcher=matcher))
        assert actor.course == [*NAMES] * rounds


# Tries ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("number", [0, 1])
@pytest.mark.parametrize("lost", range(TRIES + 1))
def test_a_stage_in_which_the_garment_is_lost_is_begun_again(make_world, number, lost):
    world, matcher, name = make_world(), Matcher(), NAMES[number]
    actor = Scripted({(name, k): "some" for k in range(1, lost + 1)})
    world.run(make_runner(make_demonstration(), actor=actor, matcher=matcher))
    tries = min(lost + 1, TRIES)
    assert Counter(actor.course) == Counter(NAMES) | Counter({name: tries})
    assert get_repeats(world) == [("try", (name,))] * (tries - 1)
    ends = [counts for ended, counts in get_ends(world) if ended == name]
    assert ends == [*[False] * (tries - 1), True]
    # what has been let go by the first stage lies in another way
    assert matcher.looks == (tries if number == 0 else 1)
    # the last try is gone through to its end, whatever is seen
    reactions = [work.reaction for work in actor.works if work.stage.name == name]
    assert reactions == ["give up", "give up", "ignore"][:tries]


def test_the_number_of_tries_can_be_chosen(make_world):
    actor = Scripted({("one", k): "some" for k in (1, 2, 3)})
    world = make_world()
    world.run(make_runner(make_demonstration(), actor=actor, tries=1))
    assert actor.course == [*NAMES]
    assert get_ends(world) == [(name, True) for name in NAMES]


@pytest.mark.parametrize("cause", ["out of reach", "out of sight"])
def test_a_further_try_that_cannot_begin_leaves_the_stage_as_it_is(make_world, cause):
    def vanish(work):
        raise PerceptionError("nothing of it lies where it lay")

    second = cause if cause == "out of reach" else vanish
    world, actor = make_world(), Scripted({("two", 1): "some", ("two", 2): second})
    world.run(make_runner(make_demonstration(rounds=2), rule=Rule(0.9), actor=actor))
    assert actor.course == ["one", "two", "two", "three"]
    assert get_ends(world)[1:] == [("two", False), ("two", True), ("three", True)]
    assert len(world.get_marks(Believes)) == 1  # it counts as carried out


def test_a_first_try_that_sees_nothing_ends_the_episode(make_world):
    def vanish(work):
        raise PerceptionError("the camera sees nothing of the garment")

    world = make_world()
    runner = make_runner(make_demonstration(rounds=3), actor=Scripted({("two", 1): vanish}))
    with pytest.raises(PerceptionError, match="sees nothing"):
        world.run(runner)


def test_what_was_let_go_is_waited_for_before_a_stage_is_begun_again(make_world):
    world, steps = make_world(), []
    actor = Scripted({("two", 1): "some"})
    see = world.see_mask
    world.see_mask = lambda: steps.append(world.step) or see()
    world.run(make_runner(make_demonstration(), actor=actor))
    # twice at the end of the course, to see whether it is at rest, and twice in between
    assert len(steps) == 4


def test_one_try_is_told_from_another(make_world):
    """Random draws of a policy depend on stage, try and round alone."""
    turns = {("two", 1): "some", ("two", 4): "some"}
    actor, plain = Scripted(turns), Scripted()
    make_world().run(make_runner(make_demonstration(rounds=3), actor=actor))
    make_world().run(make_runner(make_demonstration(), actor=plain))
    draws = [work.draw for work in actor.works]
    assert len(set(draws)) == len(draws) == 11
    assert [work.draw for work in plain.works] == [(1, 1, 1), (2, 1, 1), (3, 1, 1)]
    assert set(draws) > {
        (1, 1, 1),
        (2, 1, 1),
        (3, 1, 1),
    }  # the first is the same however often it is done


# Laying down ------------------------------------------------------------------------------------


def make_fling(*others, **changes):
    """A stage of both hands that lays down what one of them still holds, and others."""
    fling = make_stage("fling", grasp=("left", "right"), on_loss="lay down")
    return make_demonstration(fling, *others, **changes)


@pytest.mark.parametrize(("lost", "held"), [(None, True), ("some", False), ("none", False)])
def test_what_waits_for_a_garment_that_is_held_is_left_out_when_it_is_lost(make_world, lost, held):
    world, rule = make_world(), Rule(0.9, 0.9)
    actor = Scripted({("fling", 1): lost})
    spread, last = make_stage("spread", when="held"), make_stage("last")
    world.run(make_runner(make_fling(spread, last), rule=rule, actor=actor))
    # the stage after that one goes on with what there is
    assert actor.course == ["fling", "spread", "last"] if held else ["fling", "last"]
    assert actor.course.count("fling") == 1  # in one try
    assert get_ends(world)[0] == ("fling", lost != "none")
    assert get_repeats(world) == []


@pytest.mark.parametrize("lost", ["some", "none"])
def test_what_was_not_carried_out_as_a_whole_is_not_believed_to_be_done(make_world, lost):
    world, rule = make_world(), Rule(0.9)
    actor = Scripted({("fling", 1): lost})
    demonstration = make_fling(make_stage("spread", when="held"), rounds=3)
    world.run(make_runner(demonstration, rule=rule, actor=actor))
    assert actor.course == ["fling", "fling", "spread"]
    assert get_repeats(world) == [("round", ("fling", "spread"))]
    assert len(rule.views) == 1  # nobody asks after the first round


def test_what_has_been_carried_out_once_stays_carried_out(make_world):
    world, rule = make_world(), Rule(0.5, 0.9)
    demonstration = make_fling(make_stage("spread", when="held"), rounds=3)
    actor = Scripted({("fling", 2): "some"})
    world.run(make_runner(demonstration, rule=rule, actor=actor))
    assert actor.course == ["fling", "spread", "fling"]
    assert rule.values == []


# Out of reach -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("rounds", "fails", "values", "gone_through"),
    [
        (2, {("one", 1)}, [0.5], 2),  # what has not been carried out as a whole cannot be done
        (2, {("two", 1), ("three", 1)}, [0.5], 2),
        (3, {("one", 1), ("one", 2)}, [0.5], 3),
        (3, {("one", 1)}, [0.9], 2),
        (3, {("one", 2)}, [0.5, 0.9], 2),  # it was carried out in the first round
        (2, {("one", 1), ("two", 1), ("three", 1)}, [], None),  # nothing changes for the next round
        (2, {("two", 2)}, [0.5, 0.5], 2),  # what was done before may be enough, and is judged
        (3, {("one", 2), ("two", 2), ("three", 2)}, [0.5], 2),  # nothing changes for the next round
        (1, {("one", 1)}, [], None),
    ],
)
def test_what_is_out_of_reach_is_left_out_of_all_but_the_last_round(
    make_world, rounds, fails, values, gone_through
):
    world, rule, actor = make_world(), Rule(*values), Scripted(dict.fromkeys(fails, "out of reach"))
    runner = make_runner(make_demonstration(rounds=rounds), rule=rule, actor=actor)
    if gone_through is None:
        with pytest.raises(UnreachableError, match="is out of reach"):
            world.run(runner)
    else:
        world.run(runner)
        assert actor.course == [*NAMES] * gone_through
    assert rule.values == []


def test_what_is_out_of_reach_and_not_begun_again_ends_the_episode(make_world):
    stages = (make_stage("one", again=False), make_stage("two"))
    actor = Scripted({("one", 1): "out of reach"})
    world = make_world()
    with pytest.raises(UnreachableError, match="one is out of reach"):
        world.run(make_runner(make_demonstration(*stages, rounds=2), actor=actor))
    assert actor.course == ["one"]


def test_a_hand_that_gets_stuck_on_its_way_lets_go_and_parks_before_what_follows(make_world):
    """A stage cannot be planned as a whole: the distance follows from the look after a stretch."""
    world = make_world()

    def get_stuck(work):
        motion = work.hands.motion
        rows = [
            motion.set_hands({"left": "close"}),
            motion.reach({"left": np.array([-0.3, 0.7, 0.4])}, GRASP_ORIENTATIONS["standard"]),
        ]
        yield from work.hands.send(np.concatenate(rows), recorded="stage")
        raise UnreachableError("left arm cannot reach it")

    actor = Scripted({("one", 1): get_stuck})
    world.run(make_runner(make_demonstration(rounds=2), rule=Rule(0.9), actor=actor))
    assert actor.course == [*NAMES] * 2
    assert all(world.looks), "a stage has looked at the garment past the arms"
    assert len(world.get_marks(StageEnds)) == len(world.get_marks(StageBegins))


# Conditions -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("when", "course"),
    [
        (None, [1, 1, 1]),
        ("round == 1", [1, 0, 0]),
        ("round > 1", [0, 1, 1]),
        ("round == 1 or skipped", [1, 0, 1]),
        ("not skipped", [1, 1, 1]),
        ("held", [1, 0, 1]),
        ("not held", [0, 1, 0]),
        ("0", [0, 0, 0]),
    ],
)
def test_a_stage_is_begun_when_its_condition_is_met(make_world, when, course):
    """In three rounds, in the second of which the stage before it has lost the garment."""
    fling = make_stage("fling", on_loss="lay down", grasp=("left", "right"))
    demonstration = make_demonstration(fling, make_stage("two", when=when), rounds=3)
    actor, world = Scripted({("fling", 2): "some"}), make_world()
    world.run(make_runner(demonstration, actor=actor))
    expected = [name for two in course for name in ("fling", *["two"] * two)]
    assert actor.course == expected


def test_a_round_in_which_no_stage_begins_is_not_counted(make_world):
    world = make_world()
    rule = Rule(0.6, 0.6, 0.6)
    stages = (
        make_stage("one", when="round == 1 or round == 3"),
        make_stage("two", when="round == 1"),
    )
    world.run(make_runner(make_demonstration(*stages, rounds=3), rule=rule))
    assert get_repeats(world) == [("round", ("one", "two"))]  # the third


@pytest.mark.parametrize(
    ("when", "asks"),
    [("held", 0), ("round == 1", 0), ("value < 0.65", 1), ("held or value > 1", 1)],
)
def test_the_garment_is_looked_at_only_for_conditions_that_name_what_is_measured(
    make_world, when, asks
):
    rule, world = Rule(0.6, 0.9), make_world()
    world.run(make_runner(make_demonstration(make_stage("one", when=when)), rule=rule))
    assert len(rule.views) == asks + 1  # and once at the end
    assert len(world.get_marks(Believes)) == asks + 1


@pytest.mark.parametrize(("higher", "begun"), [(0.09, 1), (0.11, 2)])
def test_a_condition_may_name_the_garment_as_it_lies_now_objects_and_points(
    make_world, higher, begun
):
    """The first of two stages lifts the garment towards a bar."""
    world, actor = make_world(), Scripted({})
    world.frames = {"bar": {"target": np.array([0.0, 0.8, world.cloud[:, 2].max() + 0.1])}}
    when = "garment.max.z > bar.target.z and left_cuff.x < 0"
    stages = (make_stage("one"), make_stage("two", when=when))
    act = actor.act

    def lift(work):
        world.cloud = world.cloud + np.float32([0, 0, higher])
        yield from act(work)

    actor.act = lift
    world.run(make_runner(make_demonstration(*stages), actor=actor))
    assert actor.course == ["one", "two"][:begun]


def test_a_round_begins_with_a_garment_that_is_held(make_world):
    """Whatever the round before has lost."""
    actor = Scripted({("two", 1): "none"})
    lost = make_stage("two", on_loss="lay down")
    demonstration = make_demonstration(make_stage("one", when="held"), lost, rounds=2)
    make_world().run(make_runner(demonstration, actor=actor))
    assert actor.course == ["one", "two", "one", "two"]


MENDED = (
    make_stage("fling", on_loss="lay down", when="round == 1 or skipped or value < 0.65"),
    make_stage("pull", when="held or value >= 0.65"),
    make_stage("spread", when="held or value >= 0.65"),
)


def test_the_conditions_are_those_of_fling_trousers():
    stages = load_demonstration("FlingTrousers-v1").stages
    assert [stage.when for stage in stages] == [stage.when for stage in MENDED]


@pytest.mark.parametrize(("value", "flings"), [(0.66, [1, 0, 1, 0]), (0.64, [1, 1, 1, 1])])
def test_what_is_nearly_done_is_mended_before_it_is_begun_again(make_world, value, flings):
    actor = Scripted()
    demonstration = make_demonstration(*MENDED, rounds=4)
    make_world().run(make_runner(demonstration, rule=Rule(*[value] * 99), actor=actor))
    assert actor.course == [n for f in flings for n in (*["fling"] * f, "pull", "spread")]


@pytest.mark.parametrize(
    ("lost", "value", "goes_on"),
    [("some", 0.65, True), ("some", 0.64, False), ("none", 0.64, False), (None, 0.64, True)],
)
def test_what_one_hand_has_laid_down_nearly_right_is_gone_on_with(make_world, lost, value, goes_on):
    actor = Scripted({("fling", 1): lost})
    demonstration = make_demonstration(*MENDED)
    make_world().run(make_runner(demonstration, rule=Rule(*[value] * 99), actor=actor))
    assert actor.course == (["fling", "pull", "spread"] if goes_on else ["fling"])


def test_what_cannot_be_mended_is_begun_again(make_world):
    actor = Scripted({("pull", 2): "out of reach", ("spread", 2): "out of reach"})
    demonstration = make_demonstration(*MENDED, rounds=3)
    make_world().run(make_runner(demonstration, rule=Rule(*[0.66] * 99), actor=actor))
    mends = ["pull", "spread"]
    assert actor.course == ["fling", *mends, *mends, "fling", *mends]


# Who acts ---------------------------------------------------------------------------------------


def test_a_stage_that_nobody_learns_is_scripted_whoever_acts(make_world):
    """An actor that is not even sent to points does not know that there is such a stage."""
    up = Move(targets={"left": ("-0.3", "0.8", "0.3")}, recorded=False)
    quiet = HandPose(pose="close", recorded=False)
    plain = make_stage("plain", quiet, up, Retreat())
    world, actor = make_world(), Scripted()
    world.run(make_runner(make_demonstration(plain, make_stage("two")), actor=actor))
    assert actor.course == ["two"]
    begins = {mark.name: mark for mark in world.get_marks(StageBegins)}
    assert begins["plain"].points_affordance_feature.max() > 0.99
    assert begins["two"].points_affordance_feature.max() == 0.0  # it finds its own way
    assert get_ends(world) == [("plain", True), ("two", True)]
    assert {c.recorded for c in world.commands} == {None, "approach", "stage"}
    assert sum(command.recorded == "stage" for command in world.commands) == 1


def test_what_begins_a_stage_is_what_was_seen_before_it(make_world):
    world = make_world()
    world.frames = {"stand": {"target": np.zeros(3)}}
    looks_again = make_stage("two", looks_again=True)
    actor = Scripted({("one", 1): lambda work: setattr(world, "cloud", world.cloud[::-1])})
    world.run(make_runner(make_demonstration(make_stage("one"), looks_again), actor=actor))
    first, second = world.get_marks(StageBegins)
    np.testing.assert_array_equal(first.garment_point_cloud, world.cloud[::-1])
    np.testing.assert_array_equal(second.garment_point_cloud, world.cloud)
    assert first.points["left_cuff"][0] < 0 < second.points["left_cuff"][0]
    assert first.object_point_cloud.shape == (2048, 3)
    # control steps since the reset, at which it looked
    assert world.commands[first.seen_at].recorded == "stage"
    extent = actor.works[0].names["garment"]
    np.testing.assert_allclose(extent["min"], (-0.4, 0.7, 0.0), atol=1e-6)
    np.testing.assert_allclose(extent["max"], (0.4, 0.8, 0.01), atol=1e-6)
    np.testing.assert_allclose(extent["centre"], (0.0, 0.75, 0.005), atol=1e-6)


def test_formulas_may_name_what_is_seen_of_the_objects(make_world):
    world, actor = make_world(), Scripted()
    world.frames = {"hanger": {"target": np.array([0.0, 0.8, 1.5])}}
    world.run(make_runner(make_demonstration(make_stage("one")), actor=actor))
    names = actor.works[0].names
    assert names["hanger"] is world.frames["hanger"]
    assert set(names) == {"garment", "hanger", "left_cuff", "right_cuff"}


class KnownPlaces:
    """A matcher for a garment that shows the demonstration's points alone, in their order."""

    def __init__(self, demonstration):
        self.places = np.array(list(demonstration.points.values()))

    def match(self, source_cloud, source_points, target_cloud):
        distance = np.linalg.norm(self.places[None] - source_points[:, None], axis=2)
        return distance.argmin(axis=1), np.exp(-distance)


def make_real(make_world, task_id="FoldTops-v1", *, ahead=0.8, **changes):
    """A world with the demonstration's garment so far ahead [m], and the expert's runner."""
    demonstration = load_demonstration(task_id)
    matcher = KnownPlaces(demonstration)
    world = make_world(task_id, matcher.places + np.array([0, ahead, 0]))
    runner = make_runner(demonstration, matcher=matcher, actor=Expert(), **changes)
    return world, runner


@pytest.mark.parametrize(("lost", "tries"), [(0, 1), (1, 2), (99, TRIES)])
def test_a_hand_of_the_expert_that_came_up_empty_goes_back(make_world, lost, tries):
    world, runner = make_real(make_world)
    world.loses = lambda stage, number, side: stage == "left_sleeve" and number <= lost
    first = dataclasses.replace(runner.demonstration, stages=runner.demonstration.stages[:1])
    world.run(dataclasses.replace(runner, demonstration=first))
    assert get_ends(world) == [*[("left_sleeve", False)] * (tries - 1), ("left_sleeve", True)]
    assert len(world.get_marks(StageBegins)) == tries
    assert all(world.looks)  # it is looked at again with the arms out of the way
    assert world.is_parked


def test_the_expert_does_all_that_was_demonstrated(make_world):
    world, runner = make_real(make_world)
    world.run(runner)
    assert get_ends(world) == [(stage.name, True) for stage in TOPS.stages]
    recorded = [command.recorded for command in world.commands]
    assert recorded.count("approach") % 5 == 0
    assert recorded.count("stage") > 300
    assert world.is_parked


def lay_out(task, demonstration):
    """The cloud of the demonstration's garment in the task, its points, and the frames."""
    frames = {
        item.name: make_prop(item.props[0]).compute_landmarks(
            np.array([*item.position, np.cos(item.yaw / 2), 0, 0, np.sin(item.yaw / 2)])
        )
        for item in task.objects
    }
    start = task.start
    vertices = load_garment(demonstration.garment).vertices[::5]
    cloud = np.concatenate([np.array(list(demonstration.points.values())).reshape(-1, 3), vertices])
    c, s = np.cos(start.yaw), np.sin(start.yaw)
    cloud = cloud @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]).T
    place = np.array([np.mean(start.x_range), np.mean(start.y_range), 0.0])
    if start.on is not None:
        owner, _, name = start.on.partition(".")
        place += frames[owner][name]
    return cloud + place, frames


class Marked:
    """Finds the marked points where they are: they come first in the cloud."""

    def __init__(self, demonstration):
        self.points = np.array(list(demonstration.points.values()))

    def match(self, source_cloud, source_points, target_cloud):
        away = np.linalg.norm(self.points[None] - source_points[:, None], axis=2)
        indices = away.argmin(axis=1)
        distance = np.linalg.norm(target_cloud[None] - target_cloud[indices][:, None], axis=2)
        return indices, np.exp(-distance)


@pytest.mark.parametrize(
    "task_id",
    [
        pytest.param(
            task, marks=() if task in ("FoldTops-v1", "StoreTops-v1") else pytest.mark.slow
        )
        for task in task_ids()
    ],
)
def test_every_demonstration_can_be_carried_out_on_its_own_garment(make_world, task_id):
    task, demonstration = get_task(task_id), load_demonstration(task_id)
    cloud, frames = lay_out(task, demonstration)
    world = make_world(task_id, cloud)
    world.frames = frames
    matcher = Marked(demonstration)
    if any(isinstance(step, Look) for stage in demonstration.stages for step in stage.steps):
        world.see_garment = lambda: cloud + follow_hands(world, cloud)
    world.run(
        make_runner(demonstration, matcher=matcher, actor=Expert(), rule=task.success, rounds=1)
    )
    assert get_ends(world) == [(stage.name, True) for stage in demonstration.stages]
    assert world.is_parked
    beliefs = world.get_marks(Believes)[-1].values
    assert np.isfinite(list(beliefs.values())).all()


def follow_hands(world, cloud):
    """Displacement of a garment lifted at its sides [m], shape (3,)."""
    hands = np.mean([world.get_grasp_point(side) for side in SIDES], axis=0)
    low, high = cloud.min(axis=0), cloud.max(axis=0)
    is_lifted = hands[2] > high[2] + 0.1
    return is_lifted * (hands - [*(low + high)[:2] / 2, low[2]]).astype(np.float32)


def test_lift_and_drop_takes_hold_lifts_straight_up_and_lets_go(make_world):
    world, runner = make_real(make_world)
    first = dataclasses.replace(runner.demonstration, stages=runner.demonstration.stages[:1])
    world.run(dataclasses.replace(runner, demonstration=first, actor=LiftAndDrop(), tries=1))
    motion, hand = world.motion, joint_slice("left", "hand")
    path, closed = [], []
    for command in world.commands:
        motion.reset(command.target)
        pose = motion.compute_poses()["left"]
        path.append(wrist_to_grasp(pose[:3], pose[3:], "left"))
        closed.append(bool(np.allclose(command.target[hand], HAND_POSES["close"], atol=1e-6)))
    held = np.array(path)[np.array(closed)]
    cuff = TOPS.points["left_cuff"] + [0, 0.8, 0]
    bottom = np.array([*cuff[:2], TOPS.stages[0].approach.height])
    np.testing.assert_allclose(held[0], bottom, atol=2e-3)
    np.testing.assert_allclose(held[-1], bottom + np.array([0, 0, LIFT_HEIGHT]), atol=2e-3)
    assert np.linalg.norm(held[:, :2] - bottom[:2], axis=1).max() < 5e-3
    np.testing.assert_allclose(world.commands[-1].target[hand], HAND_POSES["open"], atol=1e-6)
    assert world.is_parked
    right = joint_slice("right", "arm")
    targets = np.array([command.target for command in world.commands])
    assert np.ptp(targets[np.array(closed)][:, right], axis=0).max() == 0  # the other arm rests
    # it never succeeds by recording what it does
    assert {command.recorded for command in world.commands} == {None, "approach"}


def test_a_garment_that_lies_out_of_reach_is_said_to_be(make_world):
    world, runner = make_real(make_world, ahead=3.0)
    with pytest.raises(UnreachableError, match="left arm"):
        world.run(runner)


def test_a_setup_makes_runners_for_the_garment_of_its_environment():
    env = SimpleNamespace(task=get_task("FoldTops-v1"))
    setup = Setup(
        options=RunOptions(),
        env=env,
        demonstration=TOPS,
        matcher="exact",
        find_matcher=lambda env: ("matcher of", env),
        demo_cloud=np.zeros((3, 3)),
        motion=None,
    )
    actor = Expert()
    runner = setup.make_runner(actor)
    assert (runner.actor, runner.demonstration, runner.rule) == (actor, TOPS, env.task.success)
    assert (runner.rounds, runner.tries) == (None, TRIES)
    assert runner.get_matcher() == ("matcher of", env)
    other = make_demonstration()
    runner = setup.make_runner(actor, rounds=2, tries=1, demonstration=other)
    assert (runner.rounds, runner.tries, runner.demonstration) == (2, 1, other)


def test_it_is_a_method_of_evaluations():
    assert isinstance(make_runner(make_demonstration()), Method)


@pytest.mark.parametrize("step", [Wait(frames=1), HandPose(pose="close")])
def test_an_episode_is_played_the_same_twice(make_world, step):
    commands = []
    for _ in range(2):
        world = make_world()
        world.run(make_runner(make_demonstration(make_stage("one", step)), actor=Expert()))
        commands.append(np.array([command.target for command in world.commands]))
    np.testing.assert_array_equal(*commands)


@pytest.mark.slow
@pytest.mark.timeout(1800)
@pytest.mark.render
def test_looking_at_more_changes_nothing(coarse_garments):
    """As a recording does: equal commands, equal end."""
    setup = make_setup("FoldTops-v1")
    try:
        ends = []
        for listener in (EpisodeRecorder(setup.env), None):
            result = run_episode(
                setup.env, setup.motion, setup.make_runner(Expert()), seed=0, listener=listener
            )
            ends.append((result, setup.env.get_particles().copy()))
        (first, particles), (second, others) = ends
        assert first.success == second.success
        np.testing.assert_array_equal(first.commands, second.commands)
        np.testing.assert_array_equal(particles, others)
    finally:
        setup.env.close()


def test_the_declared_rule_of_a_task_is_what_is_believed_by(make_world):
    world, runner = make_real(make_world)
    rule = get_task("FoldTops-v1").success
    world.run(dataclasses.replace(runner, rule=rule))
    (belief,) = world.get_marks(Believes)
    assert 0 <= belief.values["value"] <= 1
