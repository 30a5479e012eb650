"""Grasp geometry, lines, joint-speed limits and inverse kinematics."""

import re

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dgl_assets.robots import DEFAULT_ROBOT, SIDES, UR10E
from dgl_tasks.control import ArmKinematics, limit_joint_speed, plan_line
from dgl_tasks.errors import UnreachableError
from dgl_tasks.grasps import (
    GRASP_ORIENTATIONS,
    grasp_to_wrist,
    turn_inward,
    wrist_to_grasp,
)
from dgl_tasks.rotations import to_quaternion, to_rotation

BASES = {"left": (-0.8, 0.0, 0.5, 0.0), "right": (0.8, 0.0, 0.5, 0.0)}
SIGN = {"left": -1.0, "right": 1.0}
SPEEDS = np.array([joint.speed for joint in DEFAULT_ROBOT.arm_joints])
TURNS = tuple(np.radians((0.0, 15.0, 30.0, 45.0)))


def measure_angle(first, second):
    """Angle [rad] between two orientations wxyz."""
    return float((to_rotation(first).inv() * to_rotation(second)).magnitude())


def follow_line(arm, point, quaternion, q, turn=0.0):
    """Joint path on the straight line that brings the grasp point to `point`."""
    quaternion = turn_inward(quaternion, turn, arm.side)
    goal = np.concatenate([grasp_to_wrist(point, quaternion, arm.side), quaternion])
    return arm.follow(plan_line(arm.compute_pose(q), goal), q)


def first_turn(arm, point, quaternion, q):
    """The first of TURNS with which the arm reaches; the error of the last one if none does."""
    for turn in TURNS:
        try:
            follow_line(arm, point, quaternion, q, turn)
        except UnreachableError:
            if turn == TURNS[-1]:
                raise
        else:
            return turn
    raise AssertionError


@pytest.fixture(scope="module")
def arms():
    return {side: ArmKinematics(side, BASES[side]) for side in SIDES}


@pytest.fixture(scope="module")
def retreats(arms):
    """Joint positions at the retreat points, reached from home."""
    return {
        side: follow_line(
            arms[side],
            (SIGN[side] * 0.6, 0.8, 0.5),
            GRASP_ORIENTATIONS["standard"][side],
            arms[side].home,
        )[-1]
        for side in SIDES
    }


# Rows of the specification: fingers, palm normal, wrist minus grasp point.
ROWS = [
    ("standard", "left", (0.341, 0.940, 0), (0, 0, -1), (-0.150, -0.339, 0.025)),
    ("standard", "right", (-0.341, 0.940, 0), (0, 0, -1), (0.150, -0.339, 0.025)),
    ("hems", "right", (-0.866, 0, -0.5), (0.5, 0, -0.866), (0.308, 0.025, 0.207)),
    ("scoop", "left", (0.612, 0.612, -0.5), (0.354, 0.354, 0.866), (-0.218, -0.253, 0.163)),
    ("tray", "left", (0.706, 0.708, 0), (0, 0, 1), (-0.244, -0.280, -0.025)),
]


@pytest.mark.parametrize(("name", "side", "fingers", "palm", "offset"), ROWS)
def test_grasp_orientations_match_the_specification(name, side, fingers, palm, offset):
    q = GRASP_ORIENTATIONS[name][side]
    R = to_rotation(q).as_matrix()
    np.testing.assert_allclose(R[:, 0], fingers, atol=2e-3)
    np.testing.assert_allclose(R[:, 1], palm, atol=2e-3)
    point = np.array([0.1, 0.7, 0.02])
    wrist = grasp_to_wrist(point, q, side)
    np.testing.assert_allclose(wrist - point, offset, atol=2.5e-3)
    np.testing.assert_allclose(wrist_to_grasp(wrist, q, side), point, atol=1e-12)


def test_turn_inward_points_the_hands_at_each_other():
    for side in SIDES:
        q = GRASP_ORIENTATIONS["standard"][side]
        before = to_rotation(q).as_matrix()
        after = to_rotation(turn_inward(q, np.radians(30), side)).as_matrix()
        assert np.degrees(np.arccos(before[:, 0] @ after[:, 0])) == pytest.approx(30, abs=1e-6)
        assert SIGN[side] * after[0, 0] < SIGN[side] * before[0, 0]
        np.testing.assert_allclose(after[:, 1], before[:, 1], atol=2e-3)


def test_unknown_side_is_refused():
    with pytest.raises(ValueError, match="'both'"):
        grasp_to_wrist((0, 0, 0), (1, 0, 0, 0), "both")


# Lines ----------------------------------------------------------------------------------------

IDENTITY = (1.0, 0.0, 0.0, 0.0)


def test_line_has_even_spacing_and_ends_at_the_goal():
    line = plan_line(np.array([0, 0, 0, *IDENTITY]), np.array([0.3, 0, 0, *IDENTITY]), spacing=0.01)
    assert len(line) == 30
    np.testing.assert_allclose(np.diff(line[:, 0]), 0.01)
    np.testing.assert_allclose(line[-1, :3], (0.3, 0, 0))
    assert len(plan_line(line[0], line[0] + np.array([0.0101, 0, 0, 0, 0, 0, 0]))) == 2


def test_line_of_no_length_is_empty_and_pure_rotation_is_not():
    pose = np.array([0.1, 0.2, 0.3, *IDENTITY])
    assert plan_line(pose, pose).shape == (0, 7)
    turned = np.array([0.1, 0.2, 0.3, np.cos(0.1), 0, 0, np.sin(0.1)])  # 0.2 rad
    line = plan_line(pose, turned)
    assert len(line) == 5
    angles = [measure_angle(a, b) for a, b in zip(line[:-1, 3:], line[1:, 3:], strict=True)]
    np.testing.assert_allclose(angles, 0.04, atol=1e-9)


def test_line_refuses_bad_arguments():
    pose = np.array([0, 0, 0, *IDENTITY])
    with pytest.raises(ValueError, match=r"goal_pose must have shape \(7,\).*\(6,\)"):
        plan_line(pose, pose[:6])
    with pytest.raises(ValueError, match="positive"):
        plan_line(pose, pose, spacing=0.0)


def test_a_line_turns_the_short_way_whatever_the_signs():
    b = np.array([np.cos(0.5), np.sin(0.5), 0, 0])
    for goal in (b, -b):
        line = plan_line(np.array([0, 0, 0, *IDENTITY]), np.array([0.1, 0, 0, *goal]))
        middle = line[len(line) // 2 - 1]
        share = middle[0] / 0.1
        assert measure_angle(middle[3:], IDENTITY) == pytest.approx(share, abs=1e-9)


def test_quaternions_round_trip_through_matrices():
    rng = np.random.default_rng(1)
    cases = [*rng.normal(size=(30, 4)), *np.eye(4)]
    for q in cases:
        R = to_rotation(q).as_matrix()
        np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
        assert measure_angle(q, to_quaternion(Rotation.from_matrix(R))) < 1e-7
    with pytest.raises(ValueError, match="not all zero"):
        to_rotation(np.zeros(4)).as_matrix()


def test_joint_speed_is_limited_only_where_needed():
    start = np.zeros(6)
    path = np.array([[0.01] * 6, [0.41, *[0.01] * 5]])
    limited = limit_joint_speed(path, start, SPEEDS)
    steps = np.abs(np.diff(np.vstack([start, limited]), axis=0)) * 60
    assert (steps <= SPEEDS + 1e-9).all()
    np.testing.assert_allclose(limited[0], path[0])
    np.testing.assert_allclose(limited[-1], path[-1])
    # 0.4 rad at 120 degrees/s is 11.5 steps of 1/60 s.
    assert len(limited) == 1 + 12
    assert limit_joint_speed(np.zeros((0, 6)), start, SPEEDS).shape == (0, 6)


# Inverse kinematics ----------------------------------------------------------------------------


@pytest.mark.parametrize("side", SIDES)
def test_solutions_are_exact_and_within_limits(arms, side):
    arm, rng = arms[side], np.random.default_rng(5)
    limits = np.array([j.limit for j in UR10E])
    solved = 0
    for _ in range(40):
        q_true = arm.home + rng.uniform(-0.7, 0.7, 6)
        if abs(np.sin(q_true[4])) < 0.2:
            continue  # near the wrist singularity neighbouring solutions are far apart
        goal = arm.compute_pose(q_true)
        q = arm.solve(goal[:3], goal[3:], arm.home)
        again = arm.compute_pose(q)
        assert np.linalg.norm(again[:3] - goal[:3]) < 1e-3
        assert measure_angle(again[3:], goal[3:]) < 2e-3
        assert (np.abs(q) <= limits).all()
        solved += 1
    assert solved > 20


def test_start_at_the_goal_returns_it(arms):
    arm = arms["left"]
    goal = arm.compute_pose(arm.home)
    np.testing.assert_allclose(arm.solve(goal[:3], goal[3:], arm.home), arm.home, atol=1e-4)


def test_solutions_do_not_depend_on_earlier_calls(arms):
    arm = arms["left"]
    near, far = (arm.compute_pose(arm.home + turn) for turn in (0.1, 0.3))
    first = arm.solve(near[:3], near[3:], arm.home)
    arm.solve(far[:3], far[3:], arm.home)
    again = ArmKinematics("left", BASES["left"])
    for solver in (arm, again):
        np.testing.assert_array_equal(solver.solve(near[:3], near[3:], arm.home), first)


def test_far_point_is_unreachable_by_its_distance(arms):
    q = GRASP_ORIENTATIONS["standard"]["left"]
    with pytest.raises(UnreachableError, match="left arm cannot reach") as caught:
        arms["left"].solve((-0.8, 3.0, 0.5), q, arms["left"].home)
    # UR10e reaches 1.3 m, the point is 3 m away.
    (away,) = re.findall(r"([\d.]+) mm", str(caught.value))
    assert 1300 < float(away) < 2200


def test_a_jump_is_refused_and_named(arms):
    arm = arms["left"]
    goal = arm.compute_pose(arm.home + 0.5 * np.eye(6)[0])
    with pytest.raises(UnreachableError, match=r"shoulder_pan_joint by 0\.50 rad"):
        arm.solve(goal[:3], goal[3:], arm.home, max_step=0.4)
    arm.solve(goal[:3], goal[3:], arm.home, max_step=0.6)


@pytest.mark.parametrize("side", SIDES)
def test_a_fold_is_one_continuous_motion_from_home(arms, side):
    """Home, retreat, cuff, lift, across the body, back: no branch change, within joint speeds."""
    arm, s = arms[side], SIGN[side]
    quaternion = GRASP_ORIENTATIONS["standard"][side]
    q = arm.home
    home_signs = np.sign(np.sin(q[[2, 4]]))
    points = [(s * 0.6, 0.8, 0.5), (s * 0.5, 0.65, 0.02), (s * 0.5, 0.65, 0.3)]
    points += [
        (-s * 0.2, 0.9, 0.3),
        (-s * 0.2, 0.9, 0.1),
        (s * 0.6, 0.8, 0.5),
        (s * 0.2, 0.6, 0.02),
    ]
    for point in points:
        path = follow_line(arm, point, quaternion, q)
        steps = np.abs(np.diff(np.vstack([q, path]), axis=0)) * 60
        assert (steps <= SPEEDS + 1e-9).all()
        assert (np.sign(np.sin(path[:, [2, 4]])) == home_signs).all(), "elbow or wrist flipped"
        end = arm.compute_pose(path[-1])
        np.testing.assert_allclose(wrist_to_grasp(end[:3], end[3:], side), point, atol=5e-4)
        q = path[-1]


@pytest.mark.parametrize("side", SIDES)
def test_whole_fold_area_is_reached_with_inward_turns(arms, retreats, side):
    """Beside its base an arm needs the hand turned; with up to 45 degrees nothing is left out."""
    arm, quaternion = arms[side], GRASP_ORIENTATIONS["standard"][side]
    turned = 0
    for x in np.arange(-0.2, 0.71, 0.15):
        for y in np.arange(0.5, 1.11, 0.15):
            point = (SIGN[side] * x, y, 0.02)
            turned += first_turn(arm, point, quaternion, retreats[side]) > 0
    assert 0 < turned < 12


def test_beside_the_base_the_plain_orientation_is_unreachable(arms, retreats):
    point, q = (-0.6, 0.6, 0.02), GRASP_ORIENTATIONS["standard"]["left"]
    with pytest.raises(UnreachableError):
        follow_line(arms["left"], point, q, retreats["left"])
    assert first_turn(arms["left"], point, q, retreats["left"]) == TURNS[1]


def test_following_nothing_goes_nowhere(arms):
    assert arms["left"].follow(np.zeros((0, 7)), arms["left"].home).shape == (0, 6)
