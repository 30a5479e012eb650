"""What is scripted around every method: coming, leaving, actions of a policy. No pictures needed."""

import dataclasses
from functools import partial
from types import SimpleNamespace

import gymnasium
import numpy as np
import pytest
from dgl_tasks.approach import (
    CLEARANCE,
    FREE_DRAW_BACKS,
    REACHABLE_SPACING,
    REACHABLE_WITHIN,
    find_reachable,
    plan_approach,
    plan_free,
    plan_leave,
)
from dgl_tasks.leaving import LEAVES

import dgl_tasks
from dgl_assets import load_garment
from dgl_assets.robots import HAND_POSES, SIDES, joint_slice
from dgl_tasks.driver import CAUGHT_DISTANCE, FINAL_FRAMES, FINAL_WAITS, FREE_ROLLS, Driver
from dgl_tasks.errors import PerceptionError, UnreachableError
from dgl_tasks.grasps import GRASP_ORIENTATIONS, wrist_to_grasp
from dgl_tasks.motion import PARKED, BimanualMotion
from dgl_tasks.observation import STEPS_PER_FRAME
from dgl_tasks.perception import Picture
from dgl_tasks.robot import DEFAULT_ROBOT_DIRECTORY

TASK = dgl_tasks.get_task("FoldTops-v1")
POINT = {"left": np.array([-0.4, 0.7, 0.1])}
STANDARD = {"left": GRASP_ORIENTATIONS["standard"]["left"]}


@pytest.fixture(scope="module")
def env():
    """Of a coarse garment: what the hands do does not depend on it."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("dgl_tasks.env.load_garment", partial(load_garment, spacing=0.025))
        made = gymnasium.make(
            "FoldTops-v1", obs_mode="none", sim_backend="physx_cpu", render_backend="none"
        )
        made.reset(seed=0)
        yield made.unwrapped
        made.close()


@pytest.fixture(scope="module")
def planner():
    return BimanualMotion(TASK, DEFAULT_ROBOT_DIRECTORY)


@pytest.fixture
def motion(planner):
    planner.reset(planner.robot.compute_start("open"))
    return planner


@pytest.fixture
def driver(env, motion, monkeypatch):
    """An episode in its midst, without cameras: the arms are where the last test has left them."""
    made = Driver(env, motion, seed=0)
    monkeypatch.setattr(made, "see_points", env.get_particles)
    motion.reset(made.get_joint_state())
    return made


def test_a_hand_comes_down_from_above_and_waits_at_the_grasp_point(motion):
    rows = plan_approach(motion, POINT, STANDARD)
    part = joint_slice("left", "arm")
    path = np.array([grasp_point(motion, row) for row in rows])
    np.testing.assert_allclose(path[-1], POINT["left"], atol=1e-3)
    np.testing.assert_array_equal(rows[-10:, part], np.tile(rows[-1, part], (10, 1)))
    low = path[:, 2] < POINT["left"][2] + 0.14  # whatever is near the cloth is right above the goal
    assert np.abs(path[low, :2] - POINT["left"][:2]).max() < 5e-3


def test_what_is_out_of_reach_is_taken_as_near_to_it_as_can_be(motion):
    stage, nothing = TASK.stages[0], np.zeros((0, 3))
    y = np.arange(0.7, 1.7, 0.005)
    strip = np.column_stack([np.full(len(y), -0.4), y, np.full(len(y), 0.01)])

    def can_reach(point):
        try:
            np.testing.assert_array_equal(
                find_reachable(motion, stage, "left", point, nothing), point
            )
        except UnreachableError:
            return False
        return True

    farthest = max((place for place in strip if can_reach(place)), key=lambda place: place[1])
    inside, outside = (farthest + np.array([0, y, 0]) for y in (-0.3, 0.05))
    np.testing.assert_array_equal(find_reachable(motion, stage, "left", inside, strip), inside)
    place = find_reachable(motion, stage, "left", outside, strip)
    assert place.tolist() in strip.tolist()
    assert farthest[1] - 2 * REACHABLE_SPACING < place[1] <= farthest[1]
    # what lies too far from the point is another place of the garment
    with pytest.raises(UnreachableError) as of_the_point:
        find_reachable(motion, stage, "left", outside, nothing)
    far = strip[strip[:, 1] < outside[1] - REACHABLE_WITHIN]
    with pytest.raises(UnreachableError) as error:
        find_reachable(motion, stage, "left", outside, far)
    assert str(error.value) == str(of_the_point.value)


def grasp_point(motion, row):
    motion.reset(row)
    pose = motion.compute_poses()["left"]
    return wrist_to_grasp(pose[:3], pose[3:], "left")


@pytest.mark.parametrize("name", sorted(LEAVES))
def test_a_hand_rolls_draws_back_and_rises(motion, name):
    leave = LEAVES[name]
    plan_approach(motion, POINT, STANDARD)
    *parts, up = plan_leave(motion, POINT, STANDARD, name)
    rolled = motion.compute_poses()["left"][3:]
    last, low = grasp_point(motion, up[-1]), grasp_point(motion, parts[-1][-1])
    assert last[2] - POINT["left"][2] == pytest.approx(leave.rise + CLEARANCE, abs=2e-3)
    assert low[2] - POINT["left"][2] == pytest.approx(leave.rise, abs=2e-3)
    back = np.linalg.norm(last[:2] - POINT["left"][:2])
    assert back == pytest.approx(leave.draw_backs[0], abs=2e-3)
    angle = 2 * np.arccos(min(1.0, abs(float(np.dot(rolled, STANDARD["left"])))))
    assert angle == pytest.approx(leave.roll, abs=1e-2)


def test_a_hand_with_cloth_on_it_goes_down_again_back_and_up(motion):
    plan_approach(motion, POINT, STANDARD)
    down, wait, back, up = plan_free(motion, POINT, STANDARD)
    ends = [grasp_point(motion, rows[-1]) - POINT["left"] for rows in (down, wait, back, up)]
    np.testing.assert_allclose([end[2] for end in ends], [-CLEARANCE] * 3 + [0.0], atol=2e-3)
    level = [float(np.linalg.norm(end[:2])) for end in ends]
    np.testing.assert_allclose(level, [0.0, 0.0, FREE_DRAW_BACKS[0], FREE_DRAW_BACKS[0]], atol=2e-3)


def leave_and_count(driver, monkeypatch, distances):
    """Let the left hand leave where cloth is seen so far below it, look after look [m]; the steps taken."""
    looks = iter(distances)

    def see():
        distance = next(looks)
        if distance is None:
            raise PerceptionError("no pixel of the garment")
        return driver.get_grasp_point("left")[None] - [0, 0, distance]

    monkeypatch.setattr(driver, "see_points", see)
    plan_approach(driver.motion, POINT, STANDARD)
    before = driver.step_count
    driver.leave(POINT, STANDARD)
    check_parked(driver)
    assert next(looks, "all") == "all"
    return driver.step_count - before


def test_hands_leave_flat_and_are_open_again_once_parked(driver, monkeypatch):
    leave_and_count(driver, monkeypatch, [1.0])
    part = joint_slice("left", "hand")
    hands = np.array(driver.commands)[:, part]
    heights = np.array([grasp_point(driver.motion, row)[2] for row in driver.commands])
    rising = (heights > POINT["left"][2] + 0.02) & (heights < POINT["left"][2] + CLEARANCE - 0.01)
    assert rising.any()
    np.testing.assert_allclose(
        hands[rising], HAND_POSES["flat"] * np.ones((rising.sum(), 1)), atol=1e-5
    )
    np.testing.assert_allclose(hands[-1], HAND_POSES["open"], atol=1e-5)


def test_what_hangs_on_a_risen_hand_is_put_down_again(driver, monkeypatch):
    near, far = CAUGHT_DISTANCE - 0.01, CAUGHT_DISTANCE + 0.01
    plain = leave_and_count(driver, monkeypatch, [far])
    assert leave_and_count(driver, monkeypatch, [None]) == plain  # nothing is seen of the garment
    assert "freed_hands" not in driver.measurements
    once = leave_and_count(driver, monkeypatch, [near, far])
    assert driver.measurements["freed_hands"] == 1
    assert once > plain + 60  # down, a wait, back and up again
    leave_and_count(driver, monkeypatch, [near] * len(FREE_ROLLS))
    assert driver.measurements["freed_hands"] == 1 + len(FREE_ROLLS)


def test_a_hand_that_does_not_get_free_rolls_on(driver, monkeypatch):
    planned = []
    plan = plan_free

    def note(motion, points, orientations):
        planned.append(orientations["left"])
        return plan(motion, points, orientations)

    monkeypatch.setattr("dgl_tasks.driver.plan_free", note)
    leave_and_count(driver, monkeypatch, [0.0] * len(FREE_ROLLS))
    turns = [2 * np.arccos(min(1.0, abs(float(np.dot(planned[0], q))))) for q in planned]
    np.testing.assert_allclose(turns, np.cumsum(FREE_ROLLS), atol=2e-3)
    assert FREE_ROLLS[0] == 0.0 < turns[-1]


def test_a_hand_that_cannot_go_down_again_parks_with_what_it_has(driver, monkeypatch):
    def refuse(*_):
        raise UnreachableError("no way down", distance=0.1)

    monkeypatch.setattr("dgl_tasks.driver.plan_free", refuse)
    leave_and_count(driver, monkeypatch, [0.0])
    assert "freed_hands" not in driver.measurements


def test_an_action_is_reached_within_five_steps_and_planning_goes_on_from_the_last(driver):
    start = driver.get_joint_state().astype(np.float64)
    driver.motion.reset(start)
    actions = np.stack([start, start + 0.01])
    told = []

    class Listener:
        def before_step(self, target, observe):
            told.append(target.copy())

    driver.execute(actions, Listener())
    assert driver.step_count == len(told) == 2 * STEPS_PER_FRAME
    expected = start + 0.01 * np.array([0, 0, 0, 0, 0, 0.2, 0.4, 0.6, 0.8, 1])[:, None]
    np.testing.assert_allclose(told, expected, atol=1e-6)
    np.testing.assert_array_equal(driver.commands, told)
    np.testing.assert_array_equal(driver.motion.target, actions[-1])
    assert driver.measurements["max_penetration_m"] < 0.02
    driver.execute(np.zeros((0, 60)))
    assert driver.step_count == 2 * STEPS_PER_FRAME


@pytest.mark.parametrize(
    ("actions", "message"),
    [
        (np.zeros(60), r"actions must have shape \(N, 60\); got \(60,\)"),
        (np.zeros((4, 59)), r"actions must have shape \(N, 60\); got \(4, 59\)"),
        (np.full((1, 60), np.nan), "actions must be finite"),
    ],
)
def test_actions_that_no_robot_can_take_are_refused(driver, actions, message):
    with pytest.raises(ValueError, match=message):
        driver.execute(actions)
    assert driver.step_count == 0


def test_films_run_three_times_as_fast_while_the_arms_come_and_go(env, motion, monkeypatch):
    pictures = []
    monkeypatch.setattr("dgl_tasks.perception.film", lambda _: driver.step_count)
    driver = Driver(env, motion, seed=0, film=pictures.append)
    motion.reset(driver.get_joint_state())
    driver.execute(motion.hold(6))  # 30 steps
    driver.settle()
    assert pictures == [*range(0, 30, 5), *range(30, driver.step_count, 15)]


@pytest.mark.parametrize(("moves", "waits"), [(0, 1), (2, 3), (9, FINAL_WAITS)])
def test_what_still_moves_is_waited_for(driver, monkeypatch, moves, waits):
    still = iter([False] * moves + [True])
    monkeypatch.setattr(driver.env, "is_still", lambda: next(still))
    monkeypatch.setattr(driver.env, "advance", lambda target: None)
    driver.settle()
    driver.settle()  # has been waited for
    assert driver.step_count == waits * FINAL_FRAMES


def test_what_has_been_touched_since_is_waited_for_again(driver, monkeypatch):
    monkeypatch.setattr(driver.env, "is_still", lambda: True)
    monkeypatch.setattr(driver.env, "advance", lambda target: None)
    driver.settle()
    driver.send(driver.motion.hold(1))
    driver.settle()
    assert driver.step_count == 2 * FINAL_FRAMES + 1


@pytest.mark.parametrize(
    ("least", "expected"), [(0.65, True), (0.66, True), (0.67, False), (None, False)]
)
def test_what_is_nearly_done_is_seen_once_it_lies_still(driver, monkeypatch, least, expected):
    task = dataclasses.replace(TASK, nearly_done=least)
    monkeypatch.setattr(driver.env, "task", task)
    seen = []
    monkeypatch.setattr(driver, "settle", lambda: seen.append("settle"))

    def judge(points):
        seen.append(points)
        return SimpleNamespace(verdict=SimpleNamespace(value=0.66))

    monkeypatch.setattr(driver, "judge", judge)
    assert driver.is_nearly_done({"hem": POINT["left"]}) is expected
    assert seen == ([] if least is None else ["settle", {"hem": POINT["left"]}])


@pytest.mark.parametrize(
    ("segment", "inside", "reason"),
    [(7, True, None), (7, False, "below the threshold"), (8, True, "out of sight")],
)
def test_a_garment_that_is_carried_out_of_sight_is_judged_too(
    driver, monkeypatch, segment, inside, reason
):
    place = np.mean(list(driver.env.before.points.values()), axis=0)
    picture = Picture(
        rgb=np.zeros((2, 2, 3), np.uint8),
        points=np.tile(place + np.array([0 if inside else 5, 0, 0]), (2, 2, 1)),
        segments=np.full((2, 2), segment),
    )
    monkeypatch.setattr("dgl_tasks.perception.take_picture", lambda *_: picture)
    monkeypatch.setattr(type(driver.env), "garment_segment", 7)
    monkeypatch.setattr(
        driver.env, "evaluate", lambda: dict.fromkeys(("is_released", "is_still"), np.True_)
    )
    judgement = driver.judge()
    assert judgement.reason == reason
    assert judgement.verdict.value == (1.0 if reason is None else 0.0)


def check_parked(driver):
    for side in SIDES:
        np.testing.assert_allclose(driver.motion.target[joint_slice(side, "arm")], PARKED[side])


def test_wherever_a_policy_ends_the_hands_open_and_park(driver):
    plan_approach(driver.motion, POINT, STANDARD)
    action = driver.motion.target.copy()
    action[joint_slice("left", "hand")] = HAND_POSES["close"]
    driver.motion.reset(action)
    driver.retreat(("left",))
    check_parked(driver)
    hand = driver.get_joint_state()[joint_slice("left", "hand")]
    np.testing.assert_allclose(hand, HAND_POSES["open"], atol=0.1)
    assert driver.step_count > 100  # rolled, drawn back and risen, not torn away


def test_parked_hands_do_not_tell_how_long_ago_the_arms_swung(driver, motion):
    motion.reset(motion.robot.compute_start("open"))
    driver.start("Tops_LongSleeve/000000")
    started = driver.get_joint_state()
    np.testing.assert_allclose(started, motion.target, atol=1e-3)
    above = {"left": POINT["left"] + (0, 0, 0.3)}  # no cloth comes along from there
    plan_approach(motion, above, STANDARD)
    driver.execute(motion.target[None])
    driver.retreat()
    np.testing.assert_allclose(driver.get_joint_state(), started, atol=1e-3)
    # without the wait they would: the swing itself leaves them elsewhere
    driver.send(motion.reach(above, STANDARD))
    driver.send(motion.park())
    assert np.abs(driver.get_joint_state() - started).max() > 0.02


def test_where_there_is_no_way_straight_up_the_arms_park_at_once(driver, motion, monkeypatch):
    def refuse(*_):
        raise ValueError("fingers must not point straight up or down")

    monkeypatch.setattr("dgl_tasks.driver.plan_leave", refuse)
    driver.retreat()
    check_parked(driver)
