"""Methods without learning: what the hands of one do, and that the other does what collection does."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from dgl_collect.execution import TRIES, Execution, _HoldLost
from dgl_collect.scripted import LIFT_HEIGHT, Expert, LiftAndDrop

from dgl_assets.robots import HAND_POSES, SIDES, joint_slice
from dgl_collect.attempt import make_setup
from dgl_collect.demonstration import RetargetedWaypoint, Stretch, load_demonstration
from dgl_tasks import get_task
from dgl_tasks.driver import Driver
from dgl_tasks.errors import PerceptionError, UnreachableError
from dgl_tasks.evaluation import run_episode
from dgl_tasks.grasps import GRASP_ORIENTATIONS, wrist_to_grasp
from dgl_tasks.hanging import Hanging
from dgl_tasks.motion import BimanualMotion
from dgl_tasks.policy import EpisodePolicy
from dgl_tasks.robot import DEFAULT_ROBOT_DIRECTORY

TASK = get_task("FoldTops-v1")
CUFF = np.array([-0.4, 0.7, 0.01])


class DryDriver(Driver):
    """Plans and remembers, and moves nothing."""

    def send(self, rows, listener=None, *, film_steps=5):
        self.commands.extend(rows)

    def see_garment(self):
        return np.array([[0.0, 0.8, 0.0], CUFF, [0.4, 0.7, 0.0]], np.float32)


class CuffMatcher:
    """Finds the cuff wherever it is asked for a point."""

    def match(self, source_cloud, source_points, target_cloud):
        count = len(source_points)
        return np.ones(count, np.int64), np.ones((count, len(target_cloud)), np.float32)


@pytest.fixture
def dry():
    env = SimpleNamespace(task=TASK)
    motion = BimanualMotion(TASK, DEFAULT_ROBOT_DIRECTORY)
    setup = SimpleNamespace(
        env=env,
        motion=motion,
        demonstration=load_demonstration("FoldTops-v1"),
        demo_cloud=np.zeros((3, 3), np.float32),
        find_matcher=lambda env: CuffMatcher(),
    )
    motion.reset(motion.robot.compute_start("open"))
    motion.park()
    return setup, DryDriver(env, motion, seed=0)


def test_lift_and_drop_takes_hold_lifts_straight_up_and_lets_go(dry):
    setup, driver = dry
    LiftAndDrop(setup=setup).run(driver)
    motion, hand = setup.motion, joint_slice("left", "hand")
    path, closed = [], []
    for row in driver.commands:
        motion.reset(row)
        pose = motion.compute_poses()["left"]
        path.append(wrist_to_grasp(pose[:3], pose[3:], "left"))
        closed.append(bool(np.allclose(row[hand], HAND_POSES["close"], atol=1e-6)))
    path, closed = np.array(path), np.array(closed)
    held = path[closed]
    bottom = np.array([*CUFF[:2], TASK.stages[0].grasp_height])
    np.testing.assert_allclose(held[0], bottom, atol=2e-3)
    np.testing.assert_allclose(held[-1], bottom + np.array([0, 0, LIFT_HEIGHT]), atol=2e-3)
    assert np.linalg.norm(held[:, :2] - bottom[:2], axis=1).max() < 5e-3
    np.testing.assert_allclose(driver.commands[-1][hand], HAND_POSES["open"], atol=1e-6)
    assert driver.is_parked
    right = joint_slice("right", "arm")
    assert np.ptp(np.array(driver.commands)[:, right], axis=0).max() == 0  # the other arm rests


def test_points_are_looked_for_near_where_they_first_lay(dry):
    setup, driver = dry
    execution = Execution(setup, 0, driver=driver, recorded="nothing")
    stage, cloud = TASK.stages[0], driver.see_garment()
    anywhere = np.array([*CUFF[:2], stage.grasp_height])
    np.testing.assert_allclose(execution.find_grasps(stage, cloud)[0]["left"], anywhere, atol=1e-6)
    # the matcher likes the left cuff, but the point lay at the right one
    execution.finder.points = {"left_cuff": np.array([0.4, 0.6, 0.0])}
    grasp, similarity = execution.find_grasps(stage, cloud)
    np.testing.assert_allclose(grasp["left"][:2], (0.4, 0.7), atol=1e-6)
    assert similarity.shape == (2, 3)
    moved = dataclasses.replace(stage, moved_at_most=None)
    np.testing.assert_allclose(execution.find_grasps(moved, cloud)[0]["left"], anywhere, atol=1e-6)
    execution.finder.points = {"left_cuff": np.array([0.4, 0.5, 0.0])}
    with pytest.raises(PerceptionError, match=r"left_sleeve: nothing of the garment lies within"):
        execution.find_grasps(stage, cloud)


class SaggingDriver(DryDriver):
    """Sees a garment that is taut when the hands are this far apart [m]."""

    taut = 0.5

    def get_grasp_point(self, side):
        pose = self.motion.compute_poses()[side]
        return wrist_to_grasp(pose[:3], pose[3:], side)

    def see_hanging(self):
        span = np.linalg.norm(self.get_grasp_point("right") - self.get_grasp_point("left"))
        return Hanging(sag=max(self.taut - span, 0.0), length=0.7)


@pytest.mark.parametrize(("taut", "each"), [(0.5, 0.04), (0.43, 0.0), (0.9, 0.15), (9.0, 0.0)])
def test_hands_move_apart_until_the_garment_is_taut(dry, taut, each):
    setup, _ = dry
    driver = SaggingDriver(setup.env, setup.motion, seed=0)
    driver.taut = taut
    execution = Execution(setup, 0, driver=driver, recorded="nothing")
    targets = {"left": np.array([-0.2, 0.7, 0.5]), "right": np.array([0.2, 0.7, 0.5])}
    orientations = GRASP_ORIENTATIONS["heap"]
    driver.send(setup.motion.reach(targets, orientations))
    stretch = Stretch(sag=0.03, step=0.01, at_most=0.15, spacing=0.005)
    waypoint = RetargetedWaypoint(targets=targets, spacing=0.01, stretch=stretch)
    seen = execution.stretch(waypoint, stretch, orientations, None)
    # by whole steps; no farther than allowed; not at all where nothing hangs between them
    assert seen == {"half_span": pytest.approx(0.2 + each, abs=1e-6), "hanging": 0.7}
    left, right = driver.get_grasp_point("left"), driver.get_grasp_point("right")
    np.testing.assert_allclose(left, targets["left"] - [each, 0, 0], atol=2e-3)
    np.testing.assert_allclose(right, targets["right"] + [each, 0, 0], atol=2e-3)


class SlidingDriver(SaggingDriver):
    """Sees a garment that slides out of a hand when the hands are farther apart than this [m]."""

    held = 0.43

    def see_hanging(self):
        seen = super().see_hanging()
        span = np.linalg.norm(self.get_grasp_point("right") - self.get_grasp_point("left"))
        return dataclasses.replace(seen, sag=seen.sag + 2 * max(span - self.held, 0.0))


def test_hands_stop_moving_apart_when_the_garment_slides(dry):
    setup, _ = dry
    driver = SlidingDriver(setup.env, setup.motion, seed=0)
    execution = Execution(setup, 0, driver=driver, recorded="nothing")
    targets = {"left": np.array([-0.2, 0.7, 0.5]), "right": np.array([0.2, 0.7, 0.5])}
    driver.send(setup.motion.reach(targets, GRASP_ORIENTATIONS["heap"]))
    stretch = Stretch(sag=0.01, step=0.01, at_most=0.15, spacing=0.005)
    waypoint = RetargetedWaypoint(targets=targets, spacing=0.01, stretch=stretch)
    seen = execution.stretch(waypoint, stretch, GRASP_ORIENTATIONS["heap"], None)
    assert seen["half_span"] == pytest.approx(0.22, abs=1e-6)  # the second step gains nothing


def make_stage_driver(setup, heights):
    """A driver that sees, each time, a raised point this far below the left hand [m]."""

    class LiftingDriver(SaggingDriver):
        looks = iter(heights)

        def see_points(self):
            return self.get_grasp_point("left")[None] - [0, 0, next(self.looks)]

        def settle(self):
            pass

    driver = LiftingDriver(setup.env, setup.motion, seed=0)
    setup.env.get_particles = lambda: driver.get_grasp_point("left")[None]
    return driver


# the last look of each try is for cloth that hangs on the hand as it leaves
@pytest.mark.parametrize(
    ("heights", "tries"),
    [([0.05, 0.2], 0.0), ([0.2, 0.2, 0.05, 0.2], 1.0), ([0.2] * (2 * TRIES - 1), TRIES - 1.0)],
)
def test_a_hand_that_came_up_empty_goes_back(dry, heights, tries):
    setup, _ = dry
    driver = make_stage_driver(setup, heights)
    execution = Execution(setup, 0, driver=driver, recorded="nothing")
    ahead = np.array([0, 0.8, 0])
    execution.finder.points = {n: point + ahead for n, point in setup.demonstration.points.items()}
    looks = []
    execution.look = lambda: looks.append(driver.is_parked)
    assert execution._run_stage(TASK.stages[0], is_final=True) == "all"
    assert driver.measurements.get("further_tries", 0.0) == tries
    assert next(driver.looks, None) is None
    assert looks == [True] * int(tries)  # it is looked at again with the arms out of the way
    assert driver.events == []


@pytest.mark.parametrize(
    ("task", "number", "far", "seen"),
    [
        ("FlingTrousers-v1", 0, (0.2, 0.05), "lost"),
        ("FlingTrousers-v1", 1, (0.05, 0.2), "lost"),
        ("FlingTrousers-v1", 1, (0.2, 0.2), "nothing left"),
        ("FlingTrousers-v1", 1, (0.05, 0.05), "held"),
        ("FoldTops-v1", 1, (0.2, 0.2), "held"),  # nobody looks
    ],
)
def test_what_hangs_is_looked_at_after_each_waypoint(dry, task, number, far, seen):
    setup, _ = dry
    setup.env.task, setup.demonstration = get_task(task), load_demonstration(task)
    driver = make_stage_driver(setup, [])
    driver.see_points = lambda: np.stack(
        [driver.get_grasp_point(s) - [0, 0, d] for s, d in zip(SIDES, far, strict=True)]
    )
    driver.send(
        setup.motion.reach(
            {"left": np.array([-0.2, 0.5, 0.6]), "right": np.array([0.2, 0.5, 0.6])},
            GRASP_ORIENTATIONS["heap_sides"],
        )
    )
    execution = Execution(setup, 0, driver=driver, recorded="nothing")
    stage = get_task(task).stages[0]
    assert execution._check_hold(stage, number, "ignore")
    if seen == "nothing left":
        with pytest.raises(_HoldLost):
            execution._check_hold(stage, number, "lay down")
    else:
        assert execution._check_hold(stage, number, "lay down") == (seen == "held")
    if seen == "lost":
        with pytest.raises(_HoldLost):
            execution._check_hold(stage, number, "give up")


@pytest.mark.parametrize(("far", "hold"), [(0.2, "none"), (0.05, "all")])
def test_a_round_before_the_last_ends_when_nothing_is_left_to_lay_down(dry, far, hold):
    setup, _ = dry
    driver = make_stage_driver(
        setup, [far, far]
    )  # the second look is for cloth that hangs on the hand
    execution = Execution(setup, 0, driver=driver, recorded="nothing")
    ahead = np.array([0, 0.8, 0])
    execution.finder.points = {n: point + ahead for n, point in setup.demonstration.points.items()}
    sent = []
    driver.leave = lambda *args: sent.append(len(driver.commands))
    assert execution._run_stage(TASK.stages[0], is_final=False) == hold
    assert len(sent) == int(hold == "all")  # in one try
    assert driver.measurements.get("further_tries", 0.0) == 0.0


@pytest.mark.parametrize(
    ("rounds", "reasons", "gone_through"),
    [
        (1, [], 1),  # not even judged
        (3, [None], 1),
        (3, ["below the threshold", None], 2),
        (
            3,
            ["below the threshold", "still moving"],
            3,
        ),  # what the last one has done is judged by whoever asked
    ],
)
def test_what_is_seen_not_to_be_done_begins_again(dry, rounds, reasons, gone_through):
    setup, driver = dry
    setup.env.task = dataclasses.replace(TASK, rounds=rounds)
    execution = Execution(setup, 0, driver=driver, recorded="nothing")
    driver.settle = lambda: None
    judged = iter(reasons)
    driver.judge = lambda points: SimpleNamespace(reason=next(judged))
    course = []
    execution.look = lambda: course.append("look")

    def run_stage(stage, *, is_final):
        assert is_final == (course.count("look") == rounds - 1)
        course.append(stage.name)
        execution.records[stage.name] = len(course)
        driver.events.append(("slipped", f"in round {course.count(stage.name)}"))
        return "all"

    execution._run_stage = run_stage
    execution.perform()
    names = [stage.name for stage in TASK.stages]
    assert course == [*names, *["look", *names] * (gone_through - 1)]
    assert next(judged, None) is None
    # what came before the last round is neither recorded nor held against it
    last = len(course) - len(names) + 1
    assert execution.records == {name: last + k for k, name in enumerate(names)}
    assert {where for _, where in driver.events} == {f"in round {gone_through}"}
    assert driver.measurements.get("further_rounds", 0.0) == gone_through - 1


def test_stages_that_stay_done_are_not_begun_again(dry):
    setup, driver = dry
    setup.env.task = dataclasses.replace(TASK, rounds=3, again_from=1)
    execution = Execution(setup, 0, driver=driver, recorded="nothing")
    driver.settle = lambda: None
    judged = iter(["below the threshold", None])
    driver.judge = lambda points: SimpleNamespace(reason=next(judged))
    execution.look = lambda: pytest.fail("the points are those of the garment as it first lay")
    course = []

    def run_stage(stage, *, is_final):
        # no further round would mend the first stage
        assert is_final == (stage is TASK.stages[0])
        course.append(stage.name)
        execution.records[stage.name] = len(course)
        driver.events.append(("slipped", f"{stage.name}, {len(course)}"))
        return "all"

    execution._run_stage = run_stage
    execution.perform()
    first, *others = [stage.name for stage in TASK.stages]
    assert course == [first, *others, *others]
    assert execution.records == {first: 1, others[0]: 4, others[1]: 5}
    # what went wrong in the stage that was kept still counts
    kept = [f"{first}, 1", f"{others[0]}, 4", f"{others[1]}, 5"]
    assert [where for _, where in driver.events] == kept
    assert driver.measurements["further_rounds"] == 1.0


@pytest.mark.parametrize(
    ("apart", "known", "expected"),
    [
        (0.24, True, 0.12),
        (0.26, True, 0.26),  # one hand cannot take both: the one that lies where it first lay
        (0.26, False, 0.13),  # nobody has looked before
    ],
)
def test_of_points_too_far_apart_the_one_left_behind_is_grasped(dry, apart, known, expected):
    setup, driver = dry
    execution = Execution(setup, 0, driver=driver, recorded="nothing")
    if known:
        execution.finder.points = {
            "left_hem": np.array([0.9, 0.8, 0.0]),
            "right_hem": np.array([0.5, 0.8, 0.0]),
        }
    found = np.array([[0.0, 0.8, 0.01], [apart, 0.8, 0.01]], np.float32)
    grasp = execution.finder._choose_grasp(["left_hem", "right_hem"], found)
    np.testing.assert_allclose(grasp, (expected, 0.8, 0.01), atol=1e-6)


def unreachable(stage, **_):
    raise UnreachableError(f"{stage.name} is out of reach", distance=0.1)


@pytest.mark.parametrize("hold", ["some", "none"])
@pytest.mark.parametrize("number", [0, 1])
def test_a_round_in_which_the_garment_is_lost_ends_at_once(dry, number, hold):
    execution, course = go_through(dry, rounds=2, fails={(1, number)}, fail=lambda stage: hold)
    execution.perform()
    names = [stage.name for stage in TASK.stages]
    assert course == [*names[: number + 1], "look", *names]


@pytest.mark.parametrize(
    ("rounds", "fails", "reasons", "gone_through"),
    [
        (2, {(1, 0)}, [], 2),  # what has not been carried out as a whole cannot be done
        (2, {(1, 1), (1, 2)}, [], 2),
        (3, {(1, 0), (2, 0)}, [], 3),
        (3, {(1, 0)}, [None], 2),
        (3, {(2, 0)}, ["below the threshold", None], 2),  # it was carried out in the first round
        (2, {(1, 0), (1, 1), (1, 2)}, [], None),  # nothing changes for the next round
        (2, {(2, 1)}, ["below the threshold"], None),  # there is no further round
        (1, {(1, 0)}, [], None),
    ],
)
def test_what_is_out_of_reach_is_left_out_of_all_but_the_last_round(
    dry, rounds, fails, reasons, gone_through
):
    execution, course = go_through(dry, rounds=rounds, fails=fails, fail=unreachable)
    judged = iter(reasons)
    execution.driver.judge = lambda points: SimpleNamespace(reason=next(judged))
    if gone_through is None:
        with pytest.raises(UnreachableError):
            execution.perform()
    else:
        execution.perform()
        names = [stage.name for stage in TASK.stages]
        assert course == [*names, *["look", *names] * (gone_through - 1)]
    assert list(judged) == []


def go_through(dry, *, rounds, fails, fail):
    """An attempt whose stages fail in `fails`, pairs of the round and the stage, and what it does."""
    setup, driver = dry
    setup.env.task = dataclasses.replace(TASK, rounds=rounds)
    execution = Execution(setup, 0, driver=driver, recorded="nothing")
    driver.settle = lambda: None
    driver.send(driver.motion.hold(1))
    course = []
    execution.look = lambda: course.append("look" if driver.is_parked else "look past the arms")

    def run_stage(stage, *, is_final):
        course.append(stage.name)
        failing = (course.count("look") + 1, TASK.stages.index(stage)) in fails
        execution._newest = {stage.name: len(course)}
        return fail(stage) if failing else "all"

    execution._run_stage = run_stage
    return execution, course


@pytest.mark.parametrize(
    ("hold", "value", "first_round"),
    [
        ("some", 0.65, 3),
        ("some", 0.64, 1),
        ("none", 0.65, 1),  # not laid down at all, as good as it may look
    ],
)
def test_what_one_hand_has_laid_down_nearly_right_is_gone_on_with(dry, hold, value, first_round):
    execution, course = go_through(dry, rounds=2, fails={(1, 0)}, fail=lambda stage: hold)
    execution.env.task = dataclasses.replace(TASK, rounds=2, nearly_done=0.65)
    execution.driver.judge = lambda points: SimpleNamespace(
        reason=None, verdict=SimpleNamespace(value=value)
    )
    execution.perform()
    names = [stage.name for stage in TASK.stages]
    assert course == (names if first_round == 3 else [names[0], "look", *names])
    # what is recorded of a stage is what counted
    assert execution.records[names[0]] == (1 if first_round == 3 else 3)


@pytest.mark.parametrize(
    ("nearly_done", "begins"),
    [(None, [0, 0, 0]), (0.7, [0, 0, 0]), (0.65, [1, 0, 1])],
)
def test_what_is_nearly_done_is_mended_before_it_is_begun_again(dry, nearly_done, begins):
    execution, course = go_through(dry, rounds=4, fails=set(), fail=None)
    execution.env.task = dataclasses.replace(TASK, rounds=4, nearly_done=nearly_done)
    execution.driver.judge = lambda points: SimpleNamespace(
        reason="below the threshold", verdict=SimpleNamespace(value=0.66)
    )
    execution.perform()
    names = [stage.name for stage in TASK.stages]
    # the garment is looked at as a whole when it is begun anew
    expected = [n for first in begins for n in (names[1:] if first else ["look", *names])]
    assert course == [*names, *expected]


def test_what_cannot_be_mended_is_begun_again(dry):
    names = [stage.name for stage in TASK.stages]
    execution, course = go_through(dry, rounds=3, fails=set(), fail=None)
    run_stage = execution._run_stage

    def run_or_refuse(stage, *, is_final):
        hold = run_stage(stage, is_final=is_final)
        return unreachable(stage) if len(names) < len(course) < 2 * len(names) else hold

    execution._run_stage = run_or_refuse
    execution.env.task = dataclasses.replace(TASK, rounds=3, nearly_done=0.65)
    execution.driver.judge = lambda points: SimpleNamespace(
        reason="below the threshold", verdict=SimpleNamespace(value=0.66)
    )
    execution.perform()
    assert course == [*names, *names[1:], "look", *names]


@pytest.mark.parametrize("again", [{}, {"rounds": 2, "again_from": 1}])
def test_what_is_out_of_reach_and_not_begun_again_ends_the_attempt(dry, again):
    setup, driver = dry
    setup.env.task = dataclasses.replace(TASK, **again)
    execution = Execution(setup, 0, driver=driver, recorded="nothing")
    execution._run_stage = unreachable
    with pytest.raises(UnreachableError):
        execution.perform()


def test_both_are_methods_of_evaluations():
    assert isinstance(LiftAndDrop(setup=None), EpisodePolicy)
    assert isinstance(Expert(setup=None), EpisodePolicy)


@pytest.mark.slow
@pytest.mark.timeout(1800)
@pytest.mark.render
def test_the_expert_does_what_collection_does():
    """Looking at more, as a recording does, changes nothing: equal commands, equal end."""
    setup = make_setup("FoldTops-v1")
    try:
        attempt = Execution(setup, 0)
        outcome = attempt.execute()
        garment, particles = setup.env.garment.name, setup.env.get_particles().copy()
        result = run_episode(setup.env, setup.motion, Expert(setup=setup), seed=0, garment=garment)
        assert result.success == outcome.success
        assert result.steps == attempt.driver.step_count
        np.testing.assert_array_equal(setup.env.get_particles(), particles)
    finally:
        setup.env.close()
