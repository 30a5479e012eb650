"""The robot in SAPIEN holds home, reaches targets, takes each hand pose, and rests."""

import importlib.util
from pathlib import Path

import gymnasium as gym
import imageio.v3 as iio
import numpy as np
import pytest
from mani_skill.envs.sapien_env import BaseEnv
from mani_skill.utils.registration import register_env
from mani_skill.utils.structs.types import SimConfig

from dgl_assets.robots import DEFAULT_ROBOT, HAND_POSES, SIDES
from dgl_tasks.control import ArmKinematics
from dgl_tasks.grasps import GRASP_ORIENTATIONS, grasp_to_wrist
from dgl_tasks.robot import BimanualUR10eShadow, make_agent_class

HOME_CONFIGURATION = DEFAULT_ROBOT.compute_start()
joint_slice = DEFAULT_ROBOT.joint_slice

EXAMPLE = Path(__file__).parents[1] / "examples" / "draw_hand_poses.py"
REST_SPEED = 1e-3
"""Speed of every joint below which the robot counts as at rest [rad/s]."""
SECOND = 60
"""Control steps."""


@register_env("RobotAtRest-v0")
class RobotAtRest(BaseEnv):
    """The robot alone, at the time steps of the tasks."""

    def __init__(self, *args, robot, **kwargs):
        super().__init__(*args, robot_uids=robot, **kwargs)

    @property
    def _default_sim_config(self):
        return SimConfig(sim_freq=240, control_freq=60)

    def _load_scene(self, options):
        pass

    def _initialize_episode(self, env_idx, options):
        self.agent.set_joint_state(HOME_CONFIGURATION)

    def evaluate(self):
        return {}

    def _get_obs_extra(self, info):
        return {}


@pytest.fixture(scope="module")
def bench():
    env = gym.make(
        "RobotAtRest-v0",
        robot=make_agent_class(),
        obs_mode="none",
        reward_mode="none",
        sim_backend="physx_cpu",
        render_backend="none",
    ).unwrapped
    yield env
    env.close()


@pytest.fixture
def env(bench):
    bench.reset(seed=0)
    return bench


def _go(env, q, steps):
    """Drive to joint targets; give the fastest joint in each of the last ten steps [rad/s]."""
    speeds = []
    for _ in range(steps):
        env.step(np.asarray(q, dtype=np.float32)[None])
        speeds.append(float(np.abs(env.agent.read_velocities()).max()))
    return max(speeds[-10:])


def _error(env, q):
    return float(np.abs(env.agent.read_joints() - q).max())


def test_home_is_held(env):
    assert _go(env, HOME_CONFIGURATION, SECOND) < REST_SPEED
    assert _error(env, HOME_CONFIGURATION) < 1e-4


@pytest.mark.parametrize("height", [0.1, 0.4])
def test_moved_targets_are_reached_and_held(env, height):
    """From home straight to a grasp before each arm: the harshest command there is."""
    q = HOME_CONFIGURATION.copy()
    for side, base in zip(
        SIDES, (BimanualUR10eShadow.left_base, BimanualUR10eShadow.right_base), strict=True
    ):
        arm, quaternion = ArmKinematics(side, base), GRASP_ORIENTATIONS["standard"][side]
        point = np.array([-0.35 if side == "left" else 0.35, 0.75, height])
        wrist = grasp_to_wrist(point, quaternion, side)
        q[joint_slice(side, "arm")] = arm.solve(wrist, quaternion, arm.home)
    assert _go(env, q, 3 * SECOND) < REST_SPEED
    assert _error(env, q) < 1e-3
    for side, pose in zip(SIDES, env.agent.read_hands(), strict=True):
        quaternion = GRASP_ORIENTATIONS["standard"][side]
        point = np.array([-0.35 if side == "left" else 0.35, 0.75, height])
        assert np.linalg.norm(pose[:3] - grasp_to_wrist(point, quaternion, side)) < 1e-3


@pytest.mark.parametrize("pose", sorted(HAND_POSES))
def test_each_hand_pose_is_taken_and_held(env, pose):
    q = HOME_CONFIGURATION.copy()
    for side in SIDES:
        q[joint_slice(side, "hand")] = HAND_POSES[pose]
    assert _go(env, q, 2 * SECOND) < REST_SPEED
    assert _error(env, q) < 2e-3
    left, right = (env.agent.read_joints()[joint_slice(s, "hand")] for s in SIDES)
    np.testing.assert_allclose(left, right, atol=2e-3)


@pytest.mark.slow
@pytest.mark.render
def test_the_picture_of_the_poses_is_drawn_and_the_poses_differ(tmp_path):
    spec = importlib.util.spec_from_file_location("draw_hand_poses", EXAMPLE)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    speeds = module.main(tmp_path / "poses.png", seconds=0.2, samples=1)
    assert set(speeds) == set(HAND_POSES)
    sheet = iio.imread(tmp_path / "poses.png").astype(float)
    pictures = np.split(sheet[: module.HEIGHT], len(speeds), axis=1)
    for k, first in enumerate(pictures):
        assert first.std() > 20, "a hand is to be seen"
        for second in pictures[:k]:
            assert (np.abs(first - second).max(axis=2) > 40).mean() > 0.02
