"""Policies as actors: observations, start poses, loss of the garment."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

from dgl_assets import load_garment
from dgl_assets.robots import DEFAULT_ROBOT, SIDES
from dgl_collect.actors import Expert
from dgl_collect.demonstration import load_demonstration
from dgl_collect.hold_watch import HoldWatch
from dgl_collect.matching import ExactMatcher
from dgl_collect.point_finder import APART, HANDS_APART, PointFinder
from dgl_collect.policy_actor import Learned, PolicyActor
from dgl_collect.stage_runner import TRIES, StageRunner
from dgl_collect.steps import Approach, Demonstration, Grasp, HandPose, Stage
from dgl_gam import compute_affordance
from dgl_tasks import get_task
from dgl_tasks.coverage import sample_visible_surface
from dgl_tasks.errors import UnreachableError
from dgl_tasks.grasps import orient
from dgl_tasks.messages import BeginsAgain, StageBegins, StageEnds

joint_slice = DEFAULT_ROBOT.joint_slice

POINTS = {"left_cuff": np.array([-0.4, 0.7, 0.01]), "right_cuff": np.array([0.4, 0.7, 0.01])}
CLOUD = np.array([POINTS["left_cuff"], (0.0, 0.8, 0.0), POINTS["right_cuff"]])
CHUNK = 4


def make_stage(name="one", *, grasp=("left",), points=None, **changes):
    points = points or {side: Grasp(points=(f"{side}_cuff",)) for side in grasp}
    steps = (Approach(), HandPose(pose="close"))
    return Stage(name=name, grasp=points, steps=steps, **changes)


def make_demonstration(*stages, **changes):
    stages = stages or (make_stage(),)
    return Demonstration(task="FoldTops-v1", garment="any", points=POINTS, stages=stages, **changes)


class Nearest:
    """Takes the garments to be the same: similar is what is near."""

    def match(self, source_cloud, source_points, target_cloud):
        distance = np.linalg.norm(target_cloud[None] - source_points[:, None], axis=2)
        return distance.argmin(axis=1), -distance


class Never:
    """A rule that is not met."""

    landmarks, frames = (), ()

    def __call__(self, view):
        return SimpleNamespace(value=0.0, success=False)


class Listener:
    """A policy that notes what it observes, and keeps the hands where they are."""

    def __init__(self, world, *, size=CHUNK):
        self.world, self.size = world, size
        self.stages, self.seeds, self.frames, self.hands = [], [], [], []

    def reset(self, observation, *, seed=None):
        self.stages.append(observation)
        self.seeds.append(seed)
        self.hands.append({side: self.world.get_grasp_point(side) for side in SIDES})

    def observe(self, observation):
        self.frames.append(("observe", self.world.step))

    def act(self, observation):
        assert set(observation) == {"joint_state", "ee_pose", "image", "env_point_cloud"}
        self.frames.append(("act", self.world.step))
        return np.tile(observation["joint_state"], (self.size, 1))


class Lifter(Listener):
    """Closes the left hand, lifts it and opens it again, as a policy for a sleeve."""

    def act(self, observation):
        motion = self.world.motion
        with motion.rehearsal():
            if len(self.frames) == 0:
                self.number = 0
            self.number += 1
            self.frames.append(("act", self.world.step))
            rows = motion.set_hands({"left": "close"})
            if self.number > 1:
                up = self.world.get_grasp_point("left") + np.array([0, 0, 0.1])
                rows = motion.move({"left": up}, {"left": orient("standard", "left")})
        return rows[4::5]

    def reset(self, observation, *, seed=None):
        super().reset(observation, seed=seed)
        self.frames = []


def make_runner(demonstration, policies, *, is_sent=True, chunks=2, matcher=None, **changes):
    return StageRunner(
        demonstration=demonstration,
        demo_cloud=CLOUD,
        rule=Never(),
        get_matcher=lambda: matcher or Nearest(),
        actor=PolicyActor(
            policies={
                name: Learned(policy=policy, chunks=chunks) for name, policy in policies.items()
            },
            is_sent=is_sent,
        ),
        **changes,
    )


# What it is given -------------------------------------------------------------------------------


def test_hands_go_to_the_matched_points_and_then_the_policy_acts(make_world):
    world = make_world(cloud=CLOUD)
    policy = Listener(world)
    demonstration = make_demonstration(make_stage(grasp=("left", "right")))
    world.run(make_runner(demonstration, {"one": policy}, chunks=3))
    (hands,) = policy.hands
    for side in SIDES:
        expected = (*POINTS[f"{side}_cuff"][:2], 0.03)
        np.testing.assert_allclose(hands[side], expected, atol=2e-3)
    assert sum(command.recorded == "stage" for command in world.commands) == 3 * CHUNK * 5
    assert world.is_parked
    assert [(mark.name, mark.counts) for mark in world.get_marks(StageEnds)] == [("one", True)]


def test_the_policy_gets_each_observation_once(make_world):
    world = make_world(cloud=CLOUD)
    policy = Listener(world)
    world.run(make_runner(make_demonstration(), {"one": policy}))
    assert [kind for kind, _ in policy.frames] == (["act"] + ["observe"] * (CHUNK - 1)) * 2
    steps = np.array([step for _, step in policy.frames])
    np.testing.assert_array_equal(steps - steps[0], 5 * np.arange(2 * CHUNK))


def test_what_stays_the_same_in_a_stage_is_given_at_its_beginning(make_world):
    world = make_world(cloud=CLOUD)
    policy = Listener(world)
    demonstration = make_demonstration(make_stage(grasp=("left", "right"), moved_at_most=None))
    world.run(make_runner(demonstration, {"one": policy}))
    (given,) = policy.stages
    (begins,) = world.get_marks(StageBegins)
    assert set(given) == {"garment_point_cloud", "points_affordance_feature"}
    np.testing.assert_array_equal(given["garment_point_cloud"], world.cloud)
    np.testing.assert_array_equal(
        given["points_affordance_feature"], begins.points_affordance_feature
    )
    _, similarity = Nearest().match(CLOUD, np.array(list(POINTS.values())), world.cloud)
    np.testing.assert_allclose(
        given["points_affordance_feature"], compute_affordance(similarity), atol=1e-6
    )


def test_the_other_hand_of_a_one_handed_stage_stays_and_its_affordance_is_the_same(make_world):
    world = make_world(cloud=CLOUD)
    policy = Listener(world)
    demonstration = make_demonstration(make_stage(grasp=("right",)))
    world.run(make_runner(demonstration, {"one": policy}))
    affordance = policy.stages[0]["points_affordance_feature"]
    np.testing.assert_array_equal(affordance[:, 0], affordance[:, 1])
    assert affordance.argmax(axis=0).tolist() == [2, 2]
    arm, hand = joint_slice("left", "arm"), joint_slice("left", "hand")
    stage = [command.target for command in world.commands if command.recorded == "stage"]
    np.testing.assert_allclose(
        np.array(stage)[:, arm], [DEFAULT_ROBOT.arm.parked["left"]] * len(stage), atol=1e-6
    )
    assert np.ptp(np.array(stage)[:, hand], axis=0).max() < 1e-6


def test_objects_are_shown_where_there_are_some(make_world):
    world = make_world(cloud=CLOUD)
    world.frames = {"stand": {"target": np.zeros(3)}}
    policy = Listener(world)
    world.run(make_runner(make_demonstration(), {"one": policy}))
    assert policy.stages[0]["object_point_cloud"].shape == (2048, 3)


def test_without_the_matcher_hands_stay_and_there_is_no_affordance(make_world):
    class Refuses:
        def match(self, *_):
            return np.zeros(2, int), np.zeros((2, 3))  # the look at the beginning

    world = make_world(cloud=CLOUD)
    policy = Listener(world)
    world.run(make_runner(make_demonstration(), {"one": policy}, is_sent=False, matcher=Refuses()))
    assert not policy.stages[0]["points_affordance_feature"].any()
    assert policy.stages[0]["points_affordance_feature"].shape == (3, 2)
    arms = np.r_[tuple(joint_slice(side, "arm") for side in SIDES)]
    (begins,) = world.get_marks(StageBegins)
    targets = np.array([command.target[arms] for command in world.commands[begins.seen_at :]])
    assert np.ptp(targets, axis=0).max() < 1e-6
    assert world.is_parked


def test_a_policy_that_finds_its_own_way_is_brought_back(make_world):
    class Wanderer(Listener):
        def act(self, observation):
            motion = self.world.motion
            with motion.rehearsal():
                place = {"left": np.array([-0.3, 0.7, 0.3])}
                rows = motion.reach(place, {"left": orient("standard", "left")})
            self.frames.append(("act", self.world.step))
            return rows[4::5]

    world = make_world(cloud=CLOUD)
    world.run(make_runner(make_demonstration(), {"one": Wanderer(world)}, is_sent=False, chunks=1))
    assert world.is_parked
    assert all(world.is_open(side) for side in SIDES)


@pytest.mark.slow
def test_stages_follow_each_other_with_their_own_policies_and_seeds(make_world):
    def run(seed, **changes):
        world = make_world(cloud=CLOUD)
        world.seed = seed
        policies = {name: Listener(world) for name in ("one", "two")}
        demonstration = make_demonstration(make_stage("one"), make_stage("two"), **changes)
        world.run(make_runner(demonstration, policies))
        assert [mark.name for mark in world.get_marks(StageEnds)][:2] == ["one", "two"]
        return [policy.seeds for policy in policies.values()]

    once = run(5)
    assert once == run(5)
    assert once != run(6)
    rounds = run(5, rounds=3)
    assert [seeds[:1] for seeds in rounds] == once  # whatever comes after
    assert len({seed for seeds in rounds for seed in seeds}) == 6


def test_a_policy_has_at_least_one_chunk():
    with pytest.raises(ValueError, match="chunks must be at least 1; got 0"):
        Learned(policy=None, chunks=0)


def test_targets_that_no_robot_can_take_are_refused(make_world):
    class Wrong(Listener):
        def act(self, observation):
            return np.zeros((2, 59))

    world = make_world(cloud=CLOUD)
    with pytest.raises(ValueError, match=r"actions must have shape \(N, 60\); got \(1, 59\)"):
        world.run(make_runner(make_demonstration(), {"one": Wrong(world)}))


# Where it is sent -------------------------------------------------------------------------------


def test_a_hand_of_a_policy_goes_to_what_it_can_reach(make_world):
    """The expert could not do what it has to do there; a policy goes its own way."""
    cloud = np.array([(-0.4, 1.56, 0.01), (-0.4, 1.48, 0.0), (0.4, 0.7, 0.01)])
    points = {"left_cuff": cloud[0], "right_cuff": cloud[2]}
    demonstration = dataclasses.replace(make_demonstration(), points=points)
    world = make_world(cloud=cloud)
    policy = Listener(world)
    runner = make_runner(demonstration, {"one": policy})
    world.run(runner)
    np.testing.assert_allclose(policy.hands[0]["left"], (*cloud[1][:2], 0.03), atol=2e-3)
    with pytest.raises(UnreachableError, match="left arm cannot reach"):
        make_world(cloud=cloud).run(dataclasses.replace(runner, actor=Expert()))


class Spy:
    """Another actor, and what it was sent to."""

    def __init__(self, actor):
        self._actor, self.works = actor, []
        self.is_sent, self.follows_steps = actor.is_sent, actor.follows_steps

    def act(self, work):
        self.works.append(work)
        yield from self._actor.act(work)


def send_both(world_of, runner, *, number=0):
    """Collect the found and the used grasp points, of the expert and of a policy."""
    sent = []
    for make in (lambda world: Expert(), lambda world: _make_still(runner.demonstration, world)):
        world = world_of()
        spy = Spy(make(world))
        world.run(dataclasses.replace(runner, actor=spy))
        sent.append(spy.works[number])
    return sent


def _make_still(demonstration, world):
    """A policy that does nothing for each stage."""
    names = [stage.name for stage in demonstration.stages]
    return PolicyActor(policies={name: Learned(policy=Listener(world), chunks=1) for name in names})


TROUSERS = load_demonstration("FoldTrousers-v1")
HEMS = TROUSERS.stages[1]


@pytest.fixture(scope="module")
def trousers():
    """The cloud of trousers with overlapping legs, and the exact matcher."""
    source, target = load_garment(TROUSERS.garment), load_garment("Trousers/000042")
    particles = target.vertices.astype(float)
    left = particles[:, 0] < 0
    particles[left, 0] = -particles[left, 0] - 0.08
    particles[left, 2] += 0.02
    turned = particles[:, [1, 0, 2]] * [-1, 1, 1] + [0.0, 0.8, 0.0]  # the waistband to the left
    cloud = sample_visible_surface(turned, target.faces)[::7].astype(np.float32)
    surface = sample_visible_surface(source.vertices, source.faces).astype(np.float32)
    return cloud, surface, ExactMatcher(source, target, turned)


def test_hems_are_taken_midway_between_two_matched_points_whoever_acts(make_world, trousers):
    """By the expert and by a policy, even with the exact matcher, which has no such point."""
    cloud, surface, matcher = trousers
    names = HEMS.grasp["right"].points
    wanted = np.array([TROUSERS.points[name] for name in names])
    found = cloud[matcher.match(surface, wanted, cloud)[0]]
    assert 0.05 < np.linalg.norm(found[0] - found[1]) < APART  # two places, for one hand
    midway = found.mean(axis=0)
    demonstration = dataclasses.replace(TROUSERS, stages=(HEMS,), rounds=1)
    runner = StageRunner(
        demonstration=demonstration,
        demo_cloud=surface,
        rule=get_task("FoldTrousers-v1").success,
        get_matcher=lambda: matcher,
        actor=Expert(),
    )
    works = send_both(lambda: make_world("FoldTrousers-v1", cloud), runner)
    for work in works:
        assert list(work.grasp) == ["right"]
        np.testing.assert_allclose(work.places["right"], midway, atol=1e-6)
        np.testing.assert_allclose(work.grasp["right"], (*midway[:2], 0.0), atol=1e-6)
    np.testing.assert_array_equal(*(work.begins.points_affordance_feature for work in works))


def test_where_two_hands_find_no_two_places_both_are_sent_alike(make_world):
    """The cloth near the old points is narrower than two hands, so the finder looks elsewhere."""
    before = np.array([(0.0, 0.6, 0.0), (0.2, 0.6, 0.0), (0.1, 0.95, 0.0)])
    after = np.array([(0.06, 0.6, 0.0), (0.14, 0.6, 0.0), (0.1, 0.95, 0.0)])
    points = {"left_cuff": before[0], "right_cuff": before[1]}
    stage = make_stage("two", grasp=("left", "right"), moved_at_most=0.15)
    demonstration = dataclasses.replace(make_demonstration(make_stage(), stage), points=points)
    finder = PointFinder(demonstration, CLOUD)
    finder.look(before.astype(np.float32), Nearest())
    for name in points:  # within reach of the search, and too near to each other
        near = np.linalg.norm((after - finder.points[name])[:, :2], axis=1) <= stage.moved_at_most
        assert near.tolist() == [True, True, False], name
    assert np.linalg.norm(after[0] - after[1]) < HANDS_APART
    wanted, _ = finder.find_grasps(stage, after.astype(np.float32), Nearest(), {})
    assert np.linalg.norm((wanted["left"] - wanted["right"])[:2]) >= HANDS_APART

    def make_changing_world():
        world, looks = make_world(cloud=before), []
        see = world.see_garment

        def see_garment():
            looks.append(world.step)
            if len(looks) == 3:  # as a whole, then for stage one, then for this one
                world.cloud = after.astype(np.float32)
            return see()

        world.see_garment = see_garment
        return world

    for work in send_both(make_changing_world, make_runner(demonstration, {}), number=1):
        assert work.stage is stage
        for side in SIDES:
            np.testing.assert_array_equal(work.places[side], wanted[side])
            np.testing.assert_allclose(work.grasp[side], (*wanted[side][:2], 0.03), atol=1e-6)


# When it has lost hold --------------------------------------------------------------------------


@pytest.mark.parametrize(("lost", "tries"), [(0, 1), (1, 2), (99, TRIES)])
def test_a_policy_that_has_lost_the_garment_begins_again(make_world, lost, tries):
    world = make_world(cloud=CLOUD)
    world.loses = lambda stage, number, side: number <= lost
    policy = Lifter(world)
    world.run(make_runner(make_demonstration(), {"one": policy}, chunks=5))
    assert len(policy.seeds) == len(set(policy.seeds)) == tries
    assert len(world.get_marks(BeginsAgain)) == tries - 1
    ends = [mark.counts for mark in world.get_marks(StageEnds)]
    assert ends == [*[False] * (tries - 1), True]
    assert all(world.looks)
    # the last try is gone through to its end; one that is lost ends as soon as two looks in turn
    # have said so
    begins = [mark.seen_at for mark in world.get_marks(StageBegins)]
    stage = [k for k, command in enumerate(world.commands) if command.recorded == "stage"]
    lengths = [
        sum(a <= k < b for k in stage) for a, b in zip(begins, [*begins[1:], np.inf], strict=True)
    ]
    assert len(policy.frames) > 3
    assert all(length < lengths[-1] for length in lengths[:-1])


@pytest.mark.parametrize("empty", [("left",), ("left", "right")])
def test_what_one_hand_of_a_policy_has_lost_the_other_lays_down(make_world, monkeypatch, empty):
    monkeypatch.setattr(HoldWatch, "confirm", lambda watch, seen: set(empty))
    world = make_world(cloud=CLOUD)
    policy = Listener(world)
    fling = make_stage(grasp=("left", "right"), on_loss="lay down")
    world.run(make_runner(make_demonstration(fling), {"one": policy}, chunks=3))
    # with nothing left to lay down it ends at once; else it goes on to its end
    chunks = 3 if len(empty) == 1 else 1
    assert [kind for kind, _ in policy.frames].count("act") == chunks
    assert [mark.counts for mark in world.get_marks(StageEnds)] == [len(empty) == 1]


class Looks:
    """As much of the hands as a watch looks at."""

    def __init__(self, *working):
        self.low, self.empty, self.working = set(working), set(), working
        sensed = SimpleNamespace(
            joint_state=np.zeros(60, np.float32),
            get_grasp_point=lambda side: np.array([0, 0.7, 0.0 if side in self.low else 0.5]),
        )
        self.hands = SimpleNamespace(sensed=sensed, motion=SimpleNamespace(robot=DEFAULT_ROBOT))
        self.begin()

    def begin(self):
        self.watch = HoldWatch(self.hands, self.working)

    def look(self, times=1):
        return [self.watch.confirm(self.empty - self.low) for _ in range(times)]


def test_a_hand_that_came_up_empty_has_lost_the_garment():
    work = Looks("left", "right")
    work.low, work.empty = set(), {"left"}
    work.begin()
    assert work.look(3) == [set()] * 3  # has not been down yet
    work.low = {"left", "right"}
    work.watch.note(np.zeros(60))
    work.low = set()
    assert work.look() == [set()]  # a single look may be past cloth that the hand hides
    assert work.look(2) == [{"left"}] * 2
    work.empty = {"right"}
    assert work.look(2) == [set(), {"right"}]  # the other one
    work.empty = {"left", "right"}
    assert work.look(2) == [{"right"}, {"left", "right"}]
    work.empty = set()
    assert work.look() == [set()]
    work.empty = {"left"}
    assert work.look(2) == [set(), {"left"}]  # two in turn
    work.begin()
    assert work.look(3) == [set()] * 3  # a stage that begins with hands that are up


def come_up_empty():
    """A watch over a hand that has been down and holds nothing."""
    work = Looks("left")
    work.low, work.empty = set(), {"left"}
    return work


def test_the_only_hand_that_works_has_lost_all():
    assert come_up_empty().look(2) == [set(), {"left"}]


@pytest.mark.parametrize(
    ("fingers", "is_lost"),
    [
        ([0.0, 0.2, 0.1], True),  # never closed: what it came for stayed where it was
        ([0.0, 0.7, 0.7], True),
        ([0.7, 0.7, 0.4], True),  # still closed by more than a half
        ([0.7, 0.7, 0.3], False),
        ([0.7, 0.1, 0.7], True),  # closed again
    ],
)
def test_a_hand_that_was_told_to_let_go_has_lost_nothing(fingers, is_lost):
    work = come_up_empty()
    for angle in fingers:
        target = np.zeros(60)
        target[joint_slice("left", "hand")] = angle  # of 24 joints: 0.7 is 3.4 in all
        work.watch.note(target)
    assert work.look(2) == [set(), {"left"} if is_lost else set()]
