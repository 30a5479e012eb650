"""Obstacles: distances to them, spheres inside the robot, and ways that are refused."""

import numpy as np
import pytest

from dgl_assets.props import PersonParameters, PlatformParameters, make_prop
from dgl_assets.robots import DEFAULT_ROBOT, SIDES
from dgl_tasks import get_task
from dgl_tasks.clearance import Obstacle, RobotSpheres
from dgl_tasks.errors import UnreachableError
from dgl_tasks.grasps import GRASP_ORIENTATIONS
from dgl_tasks.motion import ENTERED_MOST, BimanualMotion

BLOCK = make_prop(PlatformParameters(width=0.4, depth=0.4, height=0.4))
WIDE = make_prop(PlatformParameters(width=1.2, depth=1.2, height=0.4))
STANDARD = GRASP_ORIENTATIONS["standard"]
BASES = {"left": (-0.8, 0.0, 0.5, 0.0), "right": (0.8, 0.0, 0.5, 0.0)}


def place(prop, x, y, z=0.0, *, turn=0.0):
    pose = np.array([x, y, z, np.cos(turn / 2), 0.0, 0.0, np.sin(turn / 2)])
    return Obstacle(name="block", prop=prop, pose=pose)


@pytest.fixture
def motion():
    made = BimanualMotion(get_task("FoldTops-v1"))
    made.reset(DEFAULT_ROBOT.compute_start("open"))
    return made


def test_distances_are_those_in_the_world():
    turned = place(BLOCK, 1.0, 2.0, 0.1, turn=np.pi / 4)
    points = [(1.0, 2.0, 0.55), (1.0, 2.0, 0.47), (1.0, 1.76, 0.3), (3.0, 2.0, 0.3)]
    found = turned.compute_distance(np.array(points))
    # a corner points at the third: its faces are 0.2 m from the axis, the corner 0.283 m
    expected = [0.05, -0.03, (0.24 - 0.2 * np.sqrt(2)) / np.sqrt(2), 0.1]
    np.testing.assert_allclose(found, expected, atol=0.004)  # edges are rounded


def test_the_inside_of_a_person_is_told_from_the_outside():
    person = place(make_prop(PersonParameters(scale=0.75)), 0.2, 1.0)
    x, y, z = person.prop.landmarks["head_top"] + [0.2, 1.0, 0.0]
    found = person.compute_distance(np.array([(x, y, z + 0.03), (x, y, z - 0.05), (x, y, 0.8)]))
    assert found[0] == pytest.approx(0.03, abs=0.004)
    assert -0.055 < found[1] < -0.03
    assert found[2] < -0.05


def test_spheres_reach_from_the_forearm_to_the_fingertips():
    spheres = RobotSpheres(DEFAULT_ROBOT, BASES)
    joints = DEFAULT_ROBOT.compute_start("open")
    left, right = (spheres.compute_centres(side, joints) for side in SIDES)
    assert len(left) == len(right) == len(spheres.radii["left"])
    part = DEFAULT_ROBOT.joint_slice("left", "all")
    poses = DEFAULT_ROBOT.build_side_tree("left", BASES["left"]).compute_link_poses(
        dict(zip(DEFAULT_ROBOT.joint_names[part], joints[part], strict=True))
    )
    for link, within in (("left_mf_distal", 0.02), ("left_forearm_link", 0.2)):
        assert np.linalg.norm(left - poses[link][:3, 3], axis=1).min() < within
    # the shoulder is beside the base, and stays out of it
    assert np.linalg.norm(left - BASES["left"][:3], axis=1).min() > 0.15


def test_only_ways_through_an_obstacle_are_refused(motion):
    goals = {side: np.array([x, 0.7, 0.3]) for side, x in (("left", -0.3), ("right", 0.3))}
    motion.reach(goals, STANDARD)
    aside = {side: goal + np.array([0, 0, 0.25]) for side, goal in goals.items()}
    end = motion.target.copy()
    motion.obstacles = [place(BLOCK, -0.3, 0.75, 0.1)]
    with pytest.raises(UnreachableError, match=r"left hand would enter block by \d+\.\d cm"):
        motion.move(goals | {"left": goals["left"] + [0.0, 0.1, 0.0]}, STANDARD)
    np.testing.assert_array_equal(motion.target, end)
    motion.obstacles = [place(BLOCK, -0.3, 0.75, -0.2)]
    assert len(motion.move(aside, STANDARD)) > 10
    motion.obstacles = [place(BLOCK, -0.3, 0.75, 0.1)]
    with pytest.raises(UnreachableError, match="enter block"):
        motion.reach(goals, STANDARD)
    assert len(motion.park()) > 10  # whatever is in the way


def test_a_way_may_enter_by_as_much_as_pressing_hands_do(motion):
    goal = {"left": np.array([-0.3, 0.7, 0.3])}
    motion.reach(goal, STANDARD)
    down = {"left": goal["left"] - [0.0, 0.0, 0.1]}
    with motion.rehearsal():
        spheres = RobotSpheres(DEFAULT_ROBOT, BASES)
        rows = motion.move(down, STANDARD)
        lowest = spheres.compute_centres("left", rows[-1])[:, 2] - spheres.radii["left"]
        palm = lowest[~spheres._of_fingers["left"]].min()
        assert lowest.min() < palm - 0.01  # fingers give way
    for deeper, is_refused in ((-0.01, False), (0.01, True)):
        top = palm + ENTERED_MOST + deeper
        motion.obstacles = [place(WIDE, -0.3, 0.75, top - 0.4)]
        with motion.rehearsal():
            if is_refused:
                with pytest.raises(UnreachableError):
                    motion.move(down, STANDARD)
            else:
                motion.move(down, STANDARD)
