"""Ways along which hands turn as they like: where they pass, and what they keep clear of."""

from itertools import pairwise

import numpy as np
import pytest

from dgl_assets.props import PlatformParameters, make_prop
from dgl_assets.robots import DEFAULT_ROBOT, SIDES
from dgl_tasks import get_task
from dgl_tasks.clearance import Obstacle, RobotSpheres
from dgl_tasks.control import ArmKinematics
from dgl_tasks.errors import UnreachableError
from dgl_tasks.free_way import Waypoint, choose_orientations
from dgl_tasks.grasps import HandAngles, orient, wrist_to_grasp
from dgl_tasks.motion import BimanualMotion
from dgl_tasks.rotations import to_rotation

TASK = get_task("FoldTops-v1")
BASES = {"left": TASK.left_base, "right": TASK.right_base}
START = np.array([-0.4, 0.6, 0.5])
AHEAD = HandAngles(pitch=30.0)


@pytest.fixture(scope="module")
def arm():
    return ArmKinematics("left", BASES["left"])


@pytest.fixture
def motion():
    made = BimanualMotion(TASK)
    made.reset(DEFAULT_ROBOT.compute_start("close"))
    places = {side: START * [-1 if side == "right" else 1, 1, 1] for side in SIDES}
    made.reach(places, {side: orient(AHEAD, side) for side in SIDES})
    return made


def make_start(motion):
    joints = motion.target[DEFAULT_ROBOT.joint_slice("left", "arm")]
    return Waypoint(joints=joints, quaternion=motion.compute_poses()["left"][3:])


def choose(arm, motion, points, is_clear=lambda joints: True, **options):
    corners = np.concatenate([START[None], points])
    parts = [np.linspace(a, b, 5)[1:] for a, b in pairwise(corners)]
    start = make_start(motion)
    return choose_orientations(arm, DEFAULT_ROBOT, parts, start, is_clear=is_clear, **options)


def point_fingers(way):
    return np.stack([to_rotation(each.quaternion).apply([1.0, 0.0, 0.0]) for each in way])


def measure_turns(way, start):
    rotations = [to_rotation(each.quaternion) for each in (start, *way)]
    return [np.degrees((a.inv() * b).magnitude()) for a, b in pairwise(rotations)]


LEVEL = START + np.linspace(0, 1, 6)[1:, None] * [0.4, 0.1, 0.2]


def test_the_hand_passes_each_point_and_turns_no_more_than_it_must(arm, motion):
    way = choose(arm, motion, LEVEL)
    for point, each in zip(LEVEL, way, strict=True):
        pose = arm.compute_pose(each.joints)
        np.testing.assert_allclose(wrist_to_grasp(pose[:3], pose[3:], "left"), point, atol=1e-3)
    assert max(measure_turns(way, make_start(motion))) < 1.0


def test_the_hand_turns_step_by_step_where_it_would_touch(arm, motion):
    """Nothing is clear, beyond the second point, but hands that point inwards."""

    def is_clear(joints):
        pose = arm.compute_pose(joints)
        along = to_rotation(pose[3:]).apply([1.0, 0.0, 0.0])
        point = wrist_to_grasp(pose[:3], pose[3:], "left")
        return point[0] < LEVEL[1, 0] + 0.01 or along[0] > 0.7

    way = choose(arm, motion, LEVEL, is_clear)
    assert all(is_clear(each.joints) for each in way)
    assert to_rotation(way[-1].quaternion).apply([1.0, 0.0, 0.0])[0] > 0.7
    turns = measure_turns(way, make_start(motion))
    assert 25 < max(turns) < 46  # a step of yaw and one of pitch at most
    assert sum(turns) > 40


def test_fingers_point_at_a_place_where_the_arm_allows_it(arm, motion):
    """The way alone would not turn them; they need some steps of 30 degrees."""
    place = np.array([0.6, 0.7, 0.7])
    aims = place - LEVEL
    aims /= np.linalg.norm(aims, axis=1, keepdims=True)
    aimed, plain = (
        (point_fingers(choose(arm, motion, LEVEL, towards=at)) * aims).sum(axis=1)
        for at in (place, None)
    )
    assert plain[-1] < np.cos(np.radians(60))
    assert aimed[-1] > np.cos(np.radians(25))


def test_the_arm_passes_all_points_between(arm, motion):
    """A way is refused if only its ends are within reach."""
    corner = START - np.array([3.0, 0.0, 0.0])
    part = np.concatenate([np.linspace(START, corner, 40), np.linspace(corner, LEVEL[0], 40)])
    with pytest.raises(UnreachableError, match="with any orientation of the hand, point 1 of 1"):
        choose_orientations(
            arm, DEFAULT_ROBOT, [part], make_start(motion), is_clear=lambda joints: True
        )


def test_ways_that_do_not_exist_are_refused_with_the_place(arm, motion):
    with pytest.raises(UnreachableError, match=r"\[3.0, 0.6, 0.5\] with any orientation .*point 2"):
        choose(arm, motion, np.array([LEVEL[0], [3.0, 0.6, 0.5]]))
    with pytest.raises(UnreachableError, match="without touching an obstacle, point 1 of 5"):
        choose(arm, motion, LEVEL, lambda joints: False)


def test_both_hands_pass_their_via_points_together_and_without_a_stop(motion):
    arms = {side: ArmKinematics(side, BASES[side]) for side in SIDES}
    corners = {
        "left": START + np.array([[0.0, 0.0, 0.3], [0.3, 0.0, 0.3]]),
        "right": START * [-1, 1, 1] + np.array([[0.0, 0.0, 0.1], [0.0, 0.1, 0.1]]),
    }
    before = motion.target.copy()
    rows, ends = motion.pass_through(corners, spacing=0.01)
    hands = {s: DEFAULT_ROBOT.joint_slice(s, "hand") for s in SIDES}
    places = {}
    for side in SIDES:
        poses = [arms[side].compute_pose(r[DEFAULT_ROBOT.joint_slice(side, "arm")]) for r in rows]
        places[side] = np.array([wrist_to_grasp(p[:3], p[3:], side) for p in poses])
        np.testing.assert_allclose(places[side][-1], corners[side][-1], atol=1e-3)
        np.testing.assert_allclose(abs(poses[-1][3:] @ ends[side]), 1.0, atol=1e-5)
        assert (rows[:, hands[side]] == before[hands[side]]).all()
    passed = {side: np.linalg.norm(places[side] - corners[side][0], axis=1) for side in SIDES}
    assert max(each.min() for each in passed.values()) < 0.025  # the corner is rounded
    assert abs(int(passed["left"].argmin()) - int(passed["right"].argmin())) <= 4
    speed = np.linalg.norm(np.diff(places["left"], axis=0), axis=1)
    middle = speed[len(speed) // 4 : -len(speed) // 4]
    assert middle.min() > 0.004
    assert max(speed[0], speed[-1]) < 0.005
    assert speed.max() < 0.013


def test_a_way_of_no_length_is_done(motion):
    pose = motion.compute_poses()["left"]
    here = wrist_to_grasp(pose[:3], pose[3:], "left")
    rows, ends = motion.pass_through({"left": np.stack([here, here])})
    assert rows.shape == (0, DEFAULT_ROBOT.dof)
    np.testing.assert_array_equal(ends["left"], pose[3:])


def test_a_way_goes_round_an_obstacle_or_is_refused(motion):
    block = make_prop(PlatformParameters(width=0.3, depth=0.3, height=0.45))
    pose = np.array([-0.1, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0])
    motion.obstacles = [Obstacle(name="block", prop=block, pose=pose)]
    through = {"left": np.array([[-0.1, 0.9, 0.3]])}
    before = motion.target.copy()
    with pytest.raises(UnreachableError, match="without touching an obstacle"):
        motion.pass_through(through)
    np.testing.assert_array_equal(motion.target, before)
    beside = {"left": np.array([[-0.4, 0.85, 0.4], [-0.35, 0.9, 0.3]])}
    rows, _ = motion.pass_through(beside)
    spheres = RobotSpheres(DEFAULT_ROBOT, BASES)
    touched = spheres.find_touched("left", rows[::5], motion.obstacles)
    assert touched is None or touched[1] < 0.02
