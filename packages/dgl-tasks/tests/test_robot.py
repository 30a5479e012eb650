"""The agent in a bare ManiSkill scene: order, tracking, rest, collisions."""

import gymnasium as gym
import numpy as np
import pytest
from mani_skill.agents.registration import REGISTERED_AGENTS
from mani_skill.envs.sapien_env import BaseEnv
from mani_skill.utils.building.ground import build_ground
from mani_skill.utils.registration import register_env
from mani_skill.utils.structs.types import SimConfig

from dgl_assets.robots import DEFAULT_ROBOT, HAND_POSES, SIDES
from dgl_tasks.control import ArmKinematics, plan_line
from dgl_tasks.grasps import GRASP_ORIENTATIONS, grasp_to_wrist
from dgl_tasks.robot import (
    BimanualUR10eShadow,
    let_robot_pass,
    make_agent_class,
)

HOME_CONFIGURATION = DEFAULT_ROBOT.compute_start()
JOINT_NAMES = DEFAULT_ROBOT.joint_names
build_bimanual_tree = DEFAULT_ROBOT.build_tree
joint_slice = DEFAULT_ROBOT.joint_slice

SIGN = {"left": -1.0, "right": 1.0}


def follow_line(arm, point, quaternion, q):
    """Joint path on the straight line that brings the grasp point to `point`."""
    goal = np.concatenate([grasp_to_wrist(point, quaternion, arm.side), quaternion])
    return arm.follow(plan_line(arm.compute_pose(q), goal), q)


@register_env("RobotBench-v0")
class RobotBench(BaseEnv):
    """The robot above a ground, nothing else."""

    def __init__(self, *args, robot, **kwargs):
        super().__init__(*args, robot_uids=robot, **kwargs)

    @property
    def _default_sim_config(self):
        return SimConfig(sim_freq=120, control_freq=60)

    def _load_scene(self, options):
        self.ground = build_ground(self.scene)
        let_robot_pass(self.ground)

    def _initialize_episode(self, env_idx, options):
        self.agent.set_joint_state(HOME_CONFIGURATION)

    def evaluate(self):
        return {}

    def _get_obs_extra(self, info):
        return {}


def _make(**kwargs):
    return gym.make(
        "RobotBench-v0",
        robot=make_agent_class(**kwargs),
        obs_mode="none",
        reward_mode="none",
        sim_backend="physx_cpu",
        render_backend="none",
    ).unwrapped


@pytest.fixture(scope="module")
def bench():
    env = _make()
    yield env
    env.close()


@pytest.fixture(scope="module")
def arms():
    cls = BimanualUR10eShadow
    return {
        "left": ArmKinematics("left", cls.left_base),
        "right": ArmKinematics("right", cls.right_base),
    }


@pytest.fixture
def env(bench):
    bench.reset(seed=0)
    return bench


def _step(env, q):
    env.step(np.asarray(q, dtype=np.float32)[None])


def _place(env, q):
    env.agent.set_joint_state(q)
    _step(env, q)


def _contacts(env):
    """Pairs of link or actor names that push on each other."""
    pairs = set()
    for contact in env.scene.sub_scenes[0].get_contacts():
        if sum(np.linalg.norm(point.impulse) for point in contact.points) > 1e-9:
            names = sorted(body.entity.name.removeprefix("scene-0_") for body in contact.bodies)
            pairs.add(tuple(names))
    return pairs


def test_agent_is_registered_and_classes_are_cached():
    assert REGISTERED_AGENTS["bimanual_ur10e_shadow"].agent_cls is BimanualUR10eShadow
    first = make_agent_class(left_base=(-0.9, 0.0, 0.5, 0.0))
    assert first is make_agent_class(left_base=(-0.9, 0.0, 0.5, 0.0))
    assert first is not make_agent_class()


def test_action_is_sixty_absolute_positions_in_task_order(env):
    assert env.action_space.shape == (60,)
    q = HOME_CONFIGURATION.copy()
    q[joint_slice("left", "hand")][2] = 0.3  # left FFJ4
    q[joint_slice("right", "arm")][5] = 0.4  # right wrist_3
    for _ in range(60):
        _step(env, q)
    np.testing.assert_allclose(env.agent.read_joints(), q, atol=2e-3)


def test_an_action_is_the_target_of_the_drives_to_the_last_bit(env):
    action = HOME_CONFIGURATION.astype(np.float32) + np.linspace(-0.1, 0.1, 60, dtype=np.float32)
    _step(env, action)
    joints = {joint.name: joint for joint in env.agent.robot.active_joints}
    targets = [joints[name]._objs[0].drive_target.item() for name in JOINT_NAMES]
    np.testing.assert_array_equal(np.array(targets, dtype=np.float32), action)


def test_state_is_placed_and_read_in_task_order(env):
    q = HOME_CONFIGURATION + np.linspace(0.001, 0.1, 60)
    env.agent.set_joint_state(q)
    np.testing.assert_allclose(env.agent.read_joints(), q, atol=1e-6)
    by_name = dict(
        zip(
            (joint.name for joint in env.agent.robot.active_joints),
            env.agent.robot.get_qpos()[0].tolist(),
            strict=True,
        )
    )
    np.testing.assert_allclose([by_name[n] for n in JOINT_NAMES], q, atol=1e-6)
    assert np.abs(env.agent.read_velocities()).max() == 0
    with pytest.raises(ValueError, match=r"\(60,\).*\(30,\)"):
        env.agent.set_joint_state(np.zeros(30))


def test_ee_poses_agree_with_the_kinematics(env, arms):
    q = HOME_CONFIGURATION.copy()
    env.agent.set_joint_state(q)
    poses = env.agent.read_hands()
    assert poses.shape == (2, 7)
    tree = build_bimanual_tree().compute_link_poses(dict(zip(JOINT_NAMES, q, strict=True)))
    for pose, side in zip(poses, SIDES, strict=True):
        expected = arms[side].compute_pose(q[joint_slice(side, "arm")])
        np.testing.assert_allclose(pose[:3], expected[:3], atol=1e-5)
        assert abs(pose[3:] @ expected[3:]) == pytest.approx(1.0, abs=1e-6)
        np.testing.assert_allclose(pose[:3], tree[f"{side}_ee"][:3, 3], atol=1e-5)


def test_robot_holds_still_without_gravity_or_jitter(env):
    for _ in range(30):
        _step(env, HOME_CONFIGURATION)
    assert np.abs(env.agent.read_velocities()).max() < 1e-4
    error = np.abs(env.agent.read_joints() - HOME_CONFIGURATION)
    assert error.max() < 1e-4


@pytest.mark.parametrize("side", SIDES)
def test_straight_line_is_tracked_and_settles(env, arms, side):
    """At 0.6 m/s the wrist lags less than 4 cm, and 20 control steps later less than 2 mm."""
    arm, part = arms[side], joint_slice(side, "arm")
    quaternion = GRASP_ORIENTATIONS["standard"][side]
    q = HOME_CONFIGURATION.copy()
    q[part] = follow_line(arm, (SIGN[side] * 0.6, 0.8, 0.5), quaternion, arm.home)[-1]
    _place(env, q)
    path = follow_line(arm, (SIGN[side] * 0.1, 0.8, 0.2), quaternion, q[part])
    lags = []
    for row in path:
        q[part] = row
        _step(env, q)
        lags.append(_wrist_error(env, arm, row, side))
    assert max(lags) < 0.04
    for _ in range(20):
        _step(env, q)
    assert _wrist_error(env, arm, path[-1], side) < 0.002


def _wrist_error(env, arm, q, side):
    pose = env.agent.read_hands()[SIDES.index(side), :3]
    return float(np.linalg.norm(pose - arm.compute_pose(q)[:3]))


@pytest.mark.parametrize("pose", ["close", "pinch"])
def test_hand_pose_is_reached_in_twenty_steps(env, pose):
    q = HOME_CONFIGURATION.copy()
    for side in SIDES:
        q[joint_slice(side, "hand")] = HAND_POSES["open"]
    _place(env, q)
    for side in SIDES:
        q[joint_slice(side, "hand")] = HAND_POSES[pose]
    for _ in range(20):
        _step(env, q)
    assert np.abs(env.agent.read_joints() - q).max() < 0.02


def test_a_side_ignores_itself(env):
    """The closed hand's capsules overlap; nothing pushes."""
    q = HOME_CONFIGURATION.copy()
    for side in SIDES:
        q[joint_slice(side, "hand")] = HAND_POSES["close"]
        q[joint_slice(side, "arm")][2] *= 1.15  # fold the forearm onto the upper arm
    _place(env, q)
    for _ in range(5):
        _step(env, q)
    assert not any(a.split("_")[0] == b.split("_")[0] for a, b in _contacts(env))


def test_left_meets_right(env, arms):
    q = HOME_CONFIGURATION.copy()
    for side in SIDES:
        quaternion = GRASP_ORIENTATIONS["standard"][side]
        wrist = grasp_to_wrist((0.0, 0.8, 0.5), quaternion, side)
        q[joint_slice(side, "arm")] = arms[side].solve(wrist, quaternion, arms[side].home)
    _place(env, q)
    touching = {tuple(name.split("_")[0] for name in pair) for pair in _contacts(env)}
    assert ("left", "right") in touching


def _press(env, arms):
    """Hold the open left hand so low that thumb and forearm housing are below z = 0."""
    q = HOME_CONFIGURATION.copy()
    quaternion = GRASP_ORIENTATIONS["standard"]["left"]
    arm = arms["left"]
    above = follow_line(arm, (-0.3, 0.7, 0.3), quaternion, arm.home)[-1]
    q[joint_slice("left", "arm")] = follow_line(arm, (-0.3, 0.7, 0.0), quaternion, above)[-1]
    q[joint_slice("left", "hand")] = HAND_POSES["open"]
    _place(env, q)
    touched = set()
    for _ in range(10):
        _step(env, q)
        touched |= {name for pair in _contacts(env) if "ground" in pair for name in pair}
    return touched - {"ground"}


def test_only_the_hands_meet_the_ground(env, arms):
    touched = _press(env, arms)
    assert "left_th_distal" in touched
    assert not touched & {"left_hand_forearm", "left_wrist_2_link", "left_wrist_3_link"}


def test_pressing_fingers_on_the_ground_stays_calm(env, arms):
    """Closing on the ground bends fingers, not the arm, and does not shake."""
    q = HOME_CONFIGURATION.copy()
    arm, quaternion = arms["left"], GRASP_ORIENTATIONS["standard"]["left"]
    above = follow_line(arm, (-0.4, 0.7, 0.3), quaternion, arm.home)[-1]
    q[joint_slice("left", "arm")] = follow_line(arm, (-0.4, 0.7, 0.02), quaternion, above)[-1]
    _place(env, q)
    q[joint_slice("left", "hand")] = HAND_POSES["close"]
    for _ in range(40):
        _step(env, q)
    speeds = []
    for _ in range(20):
        _step(env, q)
        speeds.append(float(np.abs(env.agent.read_velocities()).max()))
    assert max(speeds) < 0.5
    assert _wrist_error(env, arm, q[joint_slice("left", "arm")], "left") < 0.003


def test_other_bases_move_the_robot():
    env = _make(left_base=(-1.05, 1.15, 0.45, -np.pi / 2))
    env.reset(seed=0)
    link = env.agent.robot.links_map["left_base_link"]
    np.testing.assert_allclose(link.pose.p[0].numpy(), (-1.05, 1.15, 0.45), atol=1e-6)
    env.close()
