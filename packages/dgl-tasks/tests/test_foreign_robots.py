"""Imported robots in SAPIEN stand still, take the hand poses, and reach grasp points."""

import importlib.util
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from mani_skill.envs.sapien_env import BaseEnv
from mani_skill.utils.registration import register_env
from mani_skill.utils.structs.types import SimConfig

from dgl_assets import AssetNotFoundError
from dgl_assets.robots import DEFAULT_ROBOT, SIDES
from dgl_assets.robots.importing import RobotImportOptions, import_robot, load_robot
from dgl_assets.robots.importing.home import compute_reach
from dgl_tasks import get_task
from dgl_tasks.control import ArmKinematics
from dgl_tasks.grasps import orient, wrist_to_grasp
from dgl_tasks.motion import BimanualMotion
from dgl_tasks.robot import make_agent_class

_PATH = Path(__file__).parents[2] / "dgl-assets" / "tests" / "dgl_robot_samples.py"
_SPEC = importlib.util.spec_from_file_location("dgl_robot_samples", _PATH)
samples = importlib.util.module_from_spec(_SPEC)
_SPEC.loader.exec_module(samples)

pytestmark = pytest.mark.slow
ROBOTS = ("seven+lefty", "ur10e+sixteen", "both")
REST_SPEED = 1e-3
"""Speed of every joint below which a robot counts as at rest [rad/s or m/s]."""


@register_env("ForeignRobot-v0")
class ForeignRobot(BaseEnv):
    """A robot alone, at the time steps of the tasks."""

    def __init__(self, *args, robot, **kwargs):
        super().__init__(*args, robot_uids=robot, **kwargs)

    @property
    def _default_sim_config(self):
        return SimConfig(sim_freq=240, control_freq=60)

    def _load_scene(self, options):
        pass

    def _initialize_episode(self, env_idx, options):
        self.agent.set_joint_state(self.agent.model.compute_start("open"))

    def evaluate(self):
        return {}

    def _get_obs_extra(self, info):
        return {}


@pytest.fixture(scope="module")
def library(tmp_path_factory):
    folder = tmp_path_factory.mktemp("library")
    texts = {
        "six": ("arm", samples.six_joint_arm(), {"tool_palm": "-x"}),
        "sixteen": ("hand", samples.sixteen_joint_hand(), {"collision": "keep"}),
        "lefty": ("hand", samples.sixteen_joint_hand(is_left=True), {}),
        "both": ("pair", samples.pair(), {"hand_link": "h_palm"}),
    }
    for name, (kind, text, options) in texts.items():
        path = folder / f"{name}.urdf"
        path.write_text(text)
        import_robot(
            path, name=name, out=folder / "robots", kind=kind, options=RobotImportOptions(**options)
        )
    import_robot(
        samples.write_seven_joint_arm(folder),
        name="seven",
        out=folder / "robots",
        kind="arm",
        options=RobotImportOptions(ee_link="link8", tool_palm="-y", home=folder / "home.json"),
    )
    return folder / "robots"


@pytest.fixture(scope="module", params=ROBOTS)
def bench(request, library):
    robot = load_robot(request.param, library)
    env = gym.make(
        "ForeignRobot-v0",
        robot=make_agent_class(robot=robot),
        obs_mode="none",
        reward_mode="none",
        sim_backend="physx_cpu",
        render_backend="none",
    ).unwrapped
    env.reset(seed=0)
    yield env, robot
    env.close()


def _go(env, rows, settle=0):
    """Follow joint targets and wait; give the fastest joint of the last ten steps."""
    speeds = []
    for q in [*rows, *[rows[-1]] * settle]:
        env.step(np.asarray(q, dtype=np.float32)[None])
        speeds.append(float(np.abs(env.agent.read_velocities()).max()))
    return max(speeds[-10:])


def test_it_stands_still_at_home_with_the_fingers_forward(bench):
    env, robot = bench
    env.reset(seed=0)
    q = robot.compute_start("open")
    assert _go(env, [q] * 60) < REST_SPEED
    assert np.abs(env.agent.read_joints() - q).max() < 1e-3
    for side in SIDES:
        forward = env.agent.robot.links_map[f"{side}_ee"].pose.to_transformation_matrix()[0, :3, 0]
        assert float(forward[1]) > 0.95


def test_every_hand_pose_is_taken_and_held(bench):
    env, robot = bench
    env.reset(seed=0)
    for pose in robot.hand.poses:
        q = robot.compute_start(pose)
        assert _go(env, [q], settle=90) < REST_SPEED, pose
        assert np.abs(env.agent.read_joints() - q).max() < 5e-3, pose


def test_hands_reach_points_by_the_tasks_kinematics(bench):
    env, robot = bench
    env.reset(seed=0)
    motion = BimanualMotion(get_task("FoldTops-v1"), robot=robot)
    motion.reset(robot.compute_start("open"))
    size = compute_reach(robot.arm.tree) / compute_reach(DEFAULT_ROBOT.arm.tree)
    x, y = 0.8 - 0.35 * size, 0.65 * size  # a smaller arm reaches less far from its base
    goals = {"left": np.array([-x, y, 0.35]), "right": np.array([x, y, 0.35])}
    lower = {side: goal - (0, 0, 0.08) for side, goal in goals.items()}

    def rehearse(side, turn):
        quaternion = orient("standard", side, turn)
        motion.reach({side: goals[side]}, {side: quaternion})
        motion.move({side: lower[side]}, {side: quaternion})

    turns = motion.choose_turns(SIDES, rehearse)
    orientations = {side: orient("standard", side, turn) for side, turn in turns.items()}
    _go(env, motion.reach(goals, orientations))
    rows = motion.move(lower, orientations)
    assert rows.shape[1] == robot.dof
    assert (
        _go(env, [*rows, *motion.set_hands(dict.fromkeys(SIDES, "close"))], settle=60) < REST_SPEED
    )
    for side, pose in zip(SIDES, env.agent.read_hands(), strict=True):
        found = wrist_to_grasp(pose[:3], pose[3:], side, robot=robot)
        assert np.linalg.norm(found - lower[side]) < 2e-3
    _go(env, motion.park())


def test_placo_and_the_tree_agree(bench):
    _, robot = bench
    base = (0.3, -0.2, 0.5, 0.4)
    arm = ArmKinematics("left", base, robot=robot)
    tree = robot.build_side_tree("left", base, with_hand=False)
    rng = np.random.default_rng(0)
    low, high = np.array([(j.lower, j.upper) for j in robot.arm_joints]).T
    for q in rng.uniform(low, high, (5, len(low))):
        poses = tree.compute_link_poses(dict(zip(tree.moving_joint_names, q, strict=True)))
        np.testing.assert_allclose(arm.compute_pose(q)[:3], poses["left_ee"][:3, 3], atol=1e-6)


def test_left_hand_of_the_simulator_is_the_right_one_reflected(bench):
    """With equal joint values every link, seen from `ee`, is the other one reflected."""
    env, robot = bench
    q = robot.compute_start("close")
    env.agent.set_joint_state(q)
    flip = np.diag([1.0, 1.0, -1.0])
    links = env.agent.robot.links_map
    for link in robot.hand.trees["right"].links:
        seen = {}
        for side in SIDES:
            ee, body = (
                links[f"{side}_{n}"].pose.to_transformation_matrix()[0].numpy()
                for n in ("ee", link.name)
            )
            seen[side] = (np.linalg.inv(ee) @ body)[:3, 3]
        np.testing.assert_allclose(seen["left"], flip @ seen["right"], atol=1e-5)


def test_masses_of_the_simulator_are_those_of_the_file(bench):
    env, robot = bench
    links = {link.name: link for link in env.agent.robot.links}
    for side in SIDES:
        for link in (*robot.arm.tree.links, *robot.hand.trees[side].links):
            if link.mass:
                assert links[f"{side}_{link.name}"].mass[0].item() == pytest.approx(
                    link.mass, rel=1e-4
                )


def test_an_environment_takes_a_robot_by_name(library, coarse_garments):
    env = gym.make(
        "FoldTops-v1",
        robot="ur10e+sixteen",
        robots=library,
        obs_mode="none",
        reward_mode="none",
        sim_backend="physx_cpu",
        render_backend="none",
    ).unwrapped
    env.reset(seed=0)
    assert env.agent.model.name == "ur10e+sixteen"
    assert env.action_space.shape == (44,)
    q = env.agent.model.compute_start("open")
    for _ in range(3):
        env.advance(q)
    assert np.abs(env.agent.read_velocities()).max() < 0.05
    assert env.count_touching() == 0
    env.close()
    with pytest.raises(AssetNotFoundError, match="no robot 'nobody'"):
        gym.make("FoldTops-v1", robot="nobody", robots=library)
