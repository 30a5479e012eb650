"""Rows of joint targets: where they end, how fast they are, and what cannot be reached."""

import numpy as np
import pytest

from dgl_assets.robots import DEFAULT_ROBOT, HAND_POSES, SIDES
from dgl_tasks import get_task
from dgl_tasks.control import ArmKinematics
from dgl_tasks.errors import UnreachableError
from dgl_tasks.grasps import (
    GRASP_ORIENTATIONS,
    HandAngles,
    find_sides,
    orient,
    turn_inward,
    wrist_to_grasp,
)
from dgl_tasks.motion import (
    HAND_FRAMES,
    RAMP_FRAMES,
    REACH_STEP,
    TURNS,
    UPRIGHT_STEP,
    BimanualMotion,
)
from dgl_tasks.observation import CONTROL_FREQUENCY
from dgl_tasks.rotations import to_rotation

HOME_CONFIGURATION = DEFAULT_ROBOT.compute_start()
joint_slice = DEFAULT_ROBOT.joint_slice

TASK = get_task("FoldTops-v1")
SPEEDS = np.array([joint.speed for joint in DEFAULT_ROBOT.arm_joints])
STANDARD = GRASP_ORIENTATIONS["standard"]
SIGN = {"left": -1.0, "right": 1.0}
ARM = {side: joint_slice(side, "arm") for side in SIDES}
HAND = {side: joint_slice(side, "hand") for side in SIDES}


def measure_angle(first, second):
    """Angle [rad] between two orientations wxyz."""
    return float((to_rotation(first).inv() * to_rotation(second)).magnitude())


@pytest.fixture(scope="module")
def shared():
    return BimanualMotion(TASK)


@pytest.fixture
def motion(shared):
    shared.reset(HOME_CONFIGURATION)
    return shared


@pytest.fixture(scope="module")
def arms():
    bases = {"left": TASK.left_base, "right": TASK.right_base}
    return {side: ArmKinematics(side, bases[side]) for side in SIDES}


def grasp_point(arms, row, side):
    pose = arms[side].compute_pose(row[ARM[side]])
    return wrist_to_grasp(pose[:3], pose[3:], side)


def goals(height, *, x=0.3, y=0.75):
    return {side: np.array([SIGN[side] * x, y, height]) for side in SIDES}


def start_above_garment(motion):
    motion.reach(goals(0.25), STANDARD)


def test_lines_end_at_their_goals_and_stay_straight(motion, arms):
    start_above_garment(motion)
    begin = {side: grasp_point(arms, motion.target, side) for side in SIDES}
    end = goals(0.05, x=0.35, y=0.7)
    rows = motion.move(end, STANDARD)
    assert rows.shape[1] == 60
    for side in SIDES:
        np.testing.assert_allclose(grasp_point(arms, rows[-1], side), end[side], atol=1e-3)
        orientation = arms[side].compute_pose(rows[-1][ARM[side]])[3:]
        assert measure_angle(orientation, STANDARD[side]) < 2e-3
        way = end[side] - begin[side]
        for row in rows[:: len(rows) // 5]:
            offset = grasp_point(arms, row, side) - begin[side]
            along = offset @ way / (way @ way)
            assert -1e-6 <= along <= 1 + 1e-3
            assert np.linalg.norm(offset - along * way) < 2e-3


def test_both_hands_are_equally_far_at_every_row(motion, arms):
    """The left hand has three times the way of the right; they move in proportion."""
    start_above_garment(motion)
    begin = {side: grasp_point(arms, motion.target, side) for side in SIDES}
    end = {"left": begin["left"] + (0.1, 0.0, 0.21), "right": begin["right"] + (0, 0, 0.077)}
    rows = motion.move(end, STANDARD)
    for row in rows:
        done = [
            np.linalg.norm(grasp_point(arms, row, side) - begin[side])
            / np.linalg.norm(end[side] - begin[side])
            for side in SIDES
        ]
        assert done[0] == pytest.approx(done[1], abs=0.05)


def make_ways(motion, arms, shift, *, count=40):
    """Both hands go straight by a shift [m] while their fingers close."""
    start_above_garment(motion)
    begin = {side: grasp_point(arms, motion.target, side) for side in SIDES}
    share = np.linspace(0, 1, count + 1)[1:, None]
    points = {side: place + share * np.array(shift) for side, place in begin.items()}
    turned = {side: np.tile(STANDARD[side], (count, 1)) for side in SIDES}
    fingers = HAND_POSES["open"] + share * (HAND_POSES["close"] - HAND_POSES["open"])
    return points, turned, dict.fromkeys(SIDES, fingers)


def test_ways_are_followed_a_sample_a_row_with_their_fingers(motion, arms):
    points, turned, fingers = make_ways(motion, arms, (0.05, 0.1, 0.05))
    rows = motion.follow(points, turned, fingers)
    assert rows.shape == (40, 60)
    for side in SIDES:
        found = np.stack([grasp_point(arms, row, side) for row in rows])
        np.testing.assert_allclose(found, points[side], atol=1e-3)
        np.testing.assert_allclose(rows[:, HAND[side]], fingers[side], atol=1e-12)
    np.testing.assert_array_equal(motion.target, rows[-1])


def test_ways_too_fast_for_the_arms_take_longer(motion, arms):
    points, turned, fingers = make_ways(motion, arms, (0.05, 0.1, 0.05), count=2)
    start = motion.target.copy()
    rows = motion.follow(points, turned, fingers)
    steps = np.diff(np.concatenate([start[None], rows]), axis=0)[:, ARM["left"]]
    assert len(rows) > 2
    assert (np.abs(steps) <= SPEEDS / CONTROL_FREQUENCY * 1.01).all()


def test_samples_out_of_reach_are_refused_or_skipped(motion, arms):
    points, turned, fingers = make_ways(motion, arms, (0.0, 1.2, 0.0))
    with pytest.raises(UnreachableError):
        motion.follow(points, turned, fingers)
    rows = motion.follow(points, turned, fingers, must_reach=False)
    ends = [grasp_point(arms, rows[-1], side) for side in SIDES]
    for side, end in zip(SIDES, ends, strict=True):
        missed = np.linalg.norm(points[side] - end, axis=1)
        assert missed.min() < 1e-3  # it waits at the last sample within reach
        assert missed[-1] > 0.1


def test_the_longer_line_sets_the_number_of_rows(motion):
    start_above_garment(motion)
    point = goals(0.25)
    point["left"] = point["left"] + (0, 0, 0.2)
    rows = motion.move(point, STANDARD, spacing=0.01)
    assert len(rows) == pytest.approx(20 + RAMP_FRAMES, abs=1)
    point["left"] = point["left"] - (0, 0, 0.2)
    rows = motion.move(point, STANDARD, spacing=0.005)
    assert len(rows) == pytest.approx(40 + RAMP_FRAMES, abs=1)


@pytest.mark.parametrize(("length", "ramp"), [(0.2, RAMP_FRAMES), (0.04, 2)])
def test_hands_leave_and_arrive_at_rest(motion, arms, length, ramp):
    """0.6 m/s, reached in 8 frames, or in half of those of a shorter way."""
    start_above_garment(motion)
    rows = [motion.target, *motion.move(goals(0.25 + length), STANDARD)]
    heights = np.array([grasp_point(arms, row, "left")[2] for row in rows])
    assert heights[-1] - heights[0] == pytest.approx(length, abs=1e-3)
    speed = np.concatenate([[0], np.diff(heights), [0]]) * CONTROL_FREQUENCY
    assert np.max(speed) == pytest.approx(0.6, rel=0.1)
    acceleration = np.abs(np.diff(speed)) * CONTROL_FREQUENCY
    assert acceleration.max() < 1.3 * 0.6 / ramp * CONTROL_FREQUENCY


def test_a_line_of_no_length_is_done(motion):
    start_above_garment(motion)
    before = motion.target.copy()
    rows = motion.move(goals(0.25), STANDARD)
    assert len(rows) <= 1  # what inverse kinematics left open, at most
    np.testing.assert_allclose(motion.target, before, atol=2e-3)
    assert motion.move({}, {}).shape == (0, 60)
    assert motion.move_joints({"left": motion.target[ARM["left"]]}).shape == (0, 60)


def test_motion_is_continuous_and_within_the_arms_speed(motion):
    """Over a whole fold: reach, lower, close, lift, carry, open, park."""
    plan = [
        motion.park,
        lambda: motion.reach(goals(0.23), STANDARD),
        lambda: motion.move(goals(0.03), STANDARD),
        lambda: motion.set_hands({"left": "close", "right": "close"}),
        lambda: motion.move(goals(0.3), STANDARD),
        lambda: motion.move(goals(0.3, x=0.15, y=1.0), STANDARD),
        lambda: motion.set_hands({"left": "open", "right": "open"}),
        motion.park,
    ]
    rows = np.concatenate([motion.target[None], *(step() for step in plan)])
    speed = np.abs(np.diff(rows, axis=0)) * CONTROL_FREQUENCY
    for side in SIDES:
        assert np.all(speed[:, ARM[side]] <= SPEEDS + 1e-6)
    np.testing.assert_allclose(rows[-1], motion.target)
    for side in SIDES:
        np.testing.assert_allclose(rows[-1][ARM[side]], DEFAULT_ROBOT.arm.parked[side])


def test_hands_close_gradually_and_the_arms_hold(motion):
    rows = motion.set_hands({"right": "close"})
    assert rows.shape == (HAND_FRAMES, 60)
    np.testing.assert_allclose(rows[-1][HAND["right"]], HAND_POSES["close"])
    others = np.setdiff1d(np.arange(60), np.arange(60)[HAND["right"]])
    np.testing.assert_array_equal(rows[:, others], np.tile(HOME_CONFIGURATION[others], (20, 1)))
    way = rows[:, HAND["right"]] @ HAND_POSES["close"]
    assert np.all(np.diff(way) >= -1e-12)
    steps = np.abs(np.diff(np.vstack([HOME_CONFIGURATION, rows]), axis=0)).max(axis=1)
    assert steps.max() < 0.15 * np.abs(HAND_POSES["close"]).max()
    assert steps[-1] == 0.0  # the last rows let the fingers arrive


def test_an_unknown_hand_pose_is_refused(motion):
    with pytest.raises(ValueError, match=r"must be one of .*'close'.*got 'fist'"):
        motion.set_hands({"left": "fist"})


def test_what_is_out_of_reach_raises_and_moves_nothing(motion):
    start_above_garment(motion)
    before = motion.target.copy()
    far = {"left": np.array([2.5, 3.0, 0.1])}
    with pytest.raises(UnreachableError, match="left arm cannot reach"):
        motion.move(far, STANDARD)
    np.testing.assert_array_equal(motion.target, before)
    with pytest.raises(UnreachableError):
        motion.reach(far, STANDARD)
    np.testing.assert_array_equal(motion.target, before)


def test_a_hand_that_can_is_not_turned(motion):
    before = motion.target.copy()
    asked = []

    def rehearse(side, turn):
        asked.append(side)
        motion.reach({side: goals(0.1)[side]}, {side: orient("standard", side, turn)})

    assert motion.choose_turns(SIDES, rehearse) == {"left": 0.0, "right": 0.0}
    assert asked == ["left", "right"]
    np.testing.assert_array_equal(motion.target, before)


def test_a_hand_that_cannot_is_turned_as_little_as_needed(motion):
    """Near the base the straight hand would have to bend back too far."""
    point = {"left": np.array([-0.6, 0.5, 0.05])}

    def rehearse(side, turn):
        orientation = orient("standard", side, turn)
        motion.reach({side: point[side] + (0, 0, 0.2)}, {side: orientation})
        motion.move(point, {side: orientation})

    with pytest.raises(UnreachableError):
        rehearse("left", 0.0)
    motion.reset(HOME_CONFIGURATION)
    chosen = motion.choose_turns(("left",), rehearse)["left"]
    np.testing.assert_array_equal(motion.target, HOME_CONFIGURATION)
    assert abs(chosen) > 0.2
    smaller = [turn for turn in TURNS if abs(turn) < abs(chosen) - 1e-6]
    assert smaller
    for turn in smaller:
        motion.reset(HOME_CONFIGURATION)
        with pytest.raises(UnreachableError):
            rehearse("left", turn)


def test_when_no_turn_helps_the_message_is_that_of_no_turn(motion):
    before = motion.target.copy()
    tried = []

    def rehearse(side, turn):
        tried.append(turn)
        motion.set_hands({side: "close"})
        raise UnreachableError(f"attempt {len(tried)}")

    with pytest.raises(UnreachableError, match=r"attempt 1$"):
        motion.choose_turns(("right",), rehearse)
    assert tried == list(TURNS)
    np.testing.assert_array_equal(motion.target, before)


def test_where_no_turn_can_do_what_is_wanted_what_has_to_do_decides(motion):
    tried = []

    def wanted(side, turn):
        raise UnreachableError("wanted")

    def least(side, turn):
        tried.append(turn)
        if len(tried) < 3:
            raise UnreachableError(f"least {len(tried)}")

    assert motion.choose_turns(("right",), wanted, least) == {"right": TURNS[2]}

    def nothing(side, turn):
        raise UnreachableError("least")

    with pytest.raises(UnreachableError, match="least"):
        motion.choose_turns(("right",), wanted, nothing)


ANGLES = {
    "standard": HandAngles(yaw=20),
    "heap": HandAngles(yaw=20, pitch=30),
    "sides": HandAngles(yaw=65),
    "heap_sides": HandAngles(yaw=65, pitch=30),
    "hems": HandAngles(yaw=90, pitch=30),
    "scoop": HandAngles(yaw=45, pitch=30, roll=180),
    "tray": HandAngles(yaw=45, roll=180),
}


def test_named_orientations_are_angles_that_anyone_can_give():
    assert set(ANGLES) == set(GRASP_ORIENTATIONS)
    for name, angles in ANGLES.items():
        for side in find_sides(name):
            given = orient(angles, side)
            assert np.degrees(measure_angle(given, orient(name, side))) < 0.1
            np.testing.assert_allclose(
                orient(angles, side, 0.4), turn_inward(given, 0.4, side), atol=1e-12
            )
    # the thumb of a hand that points straight ahead sinks on both sides, and the palms see each
    # other
    for side, sign in (("left", -1), ("right", 1)):
        x, y, z = to_rotation(orient(HandAngles(roll=90), side)).as_matrix().T
        np.testing.assert_allclose((x, sign * z), ((0, 1, 0), (0, 0, -1)), atol=1e-12)
        assert find_sides(HandAngles()) == SIDES
        assert y[0] * sign == pytest.approx(1.0)


def test_only_a_hand_with_its_thumb_up_turns_its_wrist_half_around(motion):
    """With palms down, such a reach would be that of another branch."""
    goal = {"right": np.array([0.1, 0.8, 0.65])}
    motion.reach(goal, {"right": orient(HandAngles(roll=-90), "right")})
    change = np.abs(motion.target - HOME_CONFIGURATION)[ARM["right"]]
    assert REACH_STEP < change.max() <= UPRIGHT_STEP
    motion.reset(HOME_CONFIGURATION)
    with pytest.raises(UnreachableError, match="left arm would jump"):
        motion.reach({"left": np.array([-0.4, 0.6, 0.18])}, GRASP_ORIENTATIONS["heap_sides"])


def test_an_orientation_that_is_none_is_refused(refuse):
    assert not refuse(
        [
            (lambda: find_sides("cap"), r"orientation must be one of \['standard', .*; got 'cap'"),
            (lambda: find_sides({"yaw": 3}), "orientation must be one of .*; got {'yaw': 3}"),
            (lambda: HandAngles(yaw=200), "yaw should be less than or equal to 180; got 200"),
            (lambda: HandAngles(pitch=90), "pitch should be less than or equal to 80; got 90"),
            (lambda: HandAngles(roll="up"), "roll should be a valid number; got 'up'"),
        ]
    )


@pytest.mark.parametrize("side", SIDES)
def test_an_orientation_is_named_and_turned_inward(side):
    np.testing.assert_allclose(orient("heap", side), GRASP_ORIENTATIONS["heap"][side], atol=1e-12)
    turned = orient("standard", side, 0.4)
    np.testing.assert_array_equal(turned, turn_inward(STANDARD[side], 0.4, side))
    assert measure_angle(turned, STANDARD[side]) == pytest.approx(0.4, abs=1e-6)


@pytest.mark.parametrize(
    ("name", "ahead"),
    [("sides", "standard"), ("heap_sides", "heap")],
)
def test_hands_that_come_from_the_sides_point_45_degrees_more_at_each_other(name, ahead):
    for side, inwards in (("left", 1), ("right", -1)):
        x, y, z = to_rotation(GRASP_ORIENTATIONS[name][side]).as_matrix()[:, 0]
        before = to_rotation(GRASP_ORIENTATIONS[ahead][side]).as_matrix()[:, 0]
        turn = np.arctan2(inwards * x, y) - np.arctan2(inwards * before[0], before[1])
        assert np.degrees(turn) == pytest.approx(45, abs=1e-3)
        assert z == pytest.approx(before[2], abs=1e-6)


def test_the_fingers_of_a_heap_grasp_point_down_by_30_degrees():
    for side in SIDES:
        along = to_rotation(GRASP_ORIENTATIONS["heap"][side]).as_matrix()[:, 0]
        level = to_rotation(STANDARD[side]).as_matrix()[:, 0]
        assert along[2] == pytest.approx(-0.5, abs=1e-3)
        np.testing.assert_allclose(along[:2] / np.cos(np.radians(30)), level[:2], atol=1e-3)
