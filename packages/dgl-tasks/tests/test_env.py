"""The environment without pictures: draws, determinism, state, observation and judgement."""

import dataclasses

import gymnasium
import numpy as np
import pytest
import torch
from mani_skill.utils.geometry.rotation_conversions import (
    euler_angles_to_matrix,
    matrix_to_euler_angles,
    quaternion_to_matrix,
)

import dgl_tasks
from dgl_assets.robots import HAND_POSES, JOINT_NAMES, joint_slice
from dgl_tasks.grasps import wrist_to_grasp
from dgl_tasks.perception import take_picture

TASK = dgl_tasks.get_task("FoldTops-v1")
HARDLY_SETTLED = dataclasses.replace(TASK, settle_frames=2)
"""For what does not depend on where the garment comes to rest."""
GARMENT = "Tops_LongSleeve/001294"


@pytest.fixture(scope="module")
def env():
    """One environment for the whole module: each test resets it."""
    made = gymnasium.make(
        "FoldTops-v1", obs_mode="state", sim_backend="physx_cpu", render_backend="none"
    )
    yield made.unwrapped
    made.close()


@pytest.fixture(scope="module")
def memory():
    """Where `settled` keeps the state that it restores."""
    return {}


@pytest.fixture
def settled(env, memory):
    """The environment just after a reset with one seed and garment, restored where that is quicker."""
    if memory and env.draws == memory["draws"]:
        env.set_state_dict(memory["state"])
    else:
        env.reset(seed=7, options={"garment": GARMENT})
        memory.update(draws=dict(env.draws), state=env.get_state_dict())
    return env


def get_action(env):
    """A fixed action that is not the resting one: both hands half closed."""
    action = env.agent.get_joint_state()[0].numpy().copy()
    for side in ("left", "right"):
        action[joint_slice(side, "hand")] = 0.5 * HAND_POSES["close"]
    return action


def run(env, frames):
    action = get_action(env)
    for _ in range(frames):
        env.step(action)
    return env.get_particles().copy(), env.agent.get_joint_state()[0].numpy().copy()


def put_particles(env, positions, velocities=None):
    velocities = np.zeros_like(positions) if velocities is None else velocities
    env.cloth.state.set_particles(
        positions[None].astype(np.float32), velocities[None].astype(np.float32)
    )


def press_into_box(env, *, share=1.0):
    """Scale the garment horizontally about the box's centre until it fits; leave a part outside."""
    x0, y0, x1, y1 = env.judge_visible_surface().box
    positions = env.get_particles().astype(np.float64)
    low, high = positions[:, :2].min(axis=0), positions[:, :2].max(axis=0)
    size = 0.98 * np.array([x1 - x0, y1 - y0])
    unit = (positions[:, :2] - low) / (high - low)
    positions[:, :2] = np.array([x0, y0]) + 0.01 * size + unit * size * [1.0 / share, 1.0]
    positions[:, 2] = 0.004
    return positions


def test_spaces_and_observation(settled):
    assert settled.single_action_space.shape == (60,)
    assert settled.get_obs().shape == (1, 134)
    parts = settled.get_obs(unflattened=True)
    q, v = parts["agent"]["joint_positions"], parts["agent"]["joint_velocities"]
    assert q.shape == v.shape == (1, len(JOINT_NAMES))
    torch.testing.assert_close(q, settled.agent.get_joint_state())
    poses = parts["extra"]["ee_poses"].reshape(2, 7)
    torch.testing.assert_close(poses, settled.agent.get_ee_poses()[0])
    assert poses[0, 0] < 0 < poses[1, 0]  # left first
    np.testing.assert_allclose(np.linalg.norm(poses[:, 3:], axis=1), 1.0, atol=1e-5)


def test_the_joint_targets_are_reached(settled):
    action = get_action(settled)
    for _ in range(60):
        settled.advance(action)
    np.testing.assert_allclose(settled.agent.get_joint_state()[0].numpy(), action, atol=0.03)


def test_the_garment_lies_where_it_was_drawn(settled):
    particles = settled.get_particles()
    assert particles.shape == settled.garment.vertices.shape
    middle = (particles.min(axis=0) + particles.max(axis=0)) / 2
    np.testing.assert_allclose(middle[:2], (settled.draws["x"], settled.draws["y"]), atol=0.02)
    assert particles[:, 2].min() > 0
    assert particles[:, 2].max() < 0.06


def test_advancing_moves_like_stepping(settled):
    state, before = settled.get_state_dict(), int(settled.elapsed_steps[0])
    settled.set_state_dict(state)
    stepped = run(settled, 10)
    assert int(settled.elapsed_steps[0]) == before + 10
    settled.set_state_dict(state)
    action = get_action(settled)
    for _ in range(10):
        settled.advance(action)
    np.testing.assert_array_equal(settled.get_particles(), stepped[0])
    np.testing.assert_array_equal(settled.agent.get_joint_state()[0].numpy(), stepped[1])
    assert int(settled.elapsed_steps[0]) == before + 20


@pytest.mark.parametrize("is_flat", [False, True])
def test_a_restored_state_goes_on_to_the_last_bit(settled, is_flat):
    """The joints of the first run differ by rounding: PhysX keeps more of them than it tells."""
    run(settled, 5)
    state = settled.get_state().clone() if is_flat else settled.get_state_dict()
    restore = settled.set_state if is_flat else settled.set_state_dict
    first = run(settled, 10)
    restored = []
    for _ in range(2):
        restore(state)
        now = settled.get_state() if is_flat else settled.get_state_dict()["garment"]["positions"]
        before = state if is_flat else state["garment"]["positions"]
        torch.testing.assert_close(now, before, rtol=0, atol=0)
        restored.append(run(settled, 10))
    for a, b in zip(*restored, strict=True):
        np.testing.assert_array_equal(a, b)
    np.testing.assert_array_equal(restored[0][0], first[0])
    np.testing.assert_allclose(restored[0][1], first[1], rtol=0, atol=1e-6)


def test_a_state_does_not_change_after_it_was_taken(settled):
    state = settled.get_state_dict()
    copy = {
        (part, key): value.clone() for part, node in state.items() for key, value in node.items()
    }
    run(settled, 5)
    for (part, key), value in copy.items():
        torch.testing.assert_close(state[part][key], value, rtol=0, atol=0)


def test_a_garment_that_lies_flat_is_no_success(settled):
    outcome = settled.evaluate()
    assert set(outcome) == {"success", "success_value", "is_still", "is_released"}
    assert all(value.shape == (1,) for value in outcome.values())
    assert not outcome["success"]
    assert 0.3 < float(outcome["success_value"]) < 0.85
    assert outcome["is_still"]
    assert outcome["is_released"]
    assert float(settled.get_reward(None, None, outcome)) == 0.0


def test_a_garment_inside_the_box_is_a_success(settled):
    half_out, inside = press_into_box(settled, share=0.6), press_into_box(settled)
    put_particles(settled, inside)
    outcome = settled.evaluate()
    assert float(outcome["success_value"]) == 1.0
    assert outcome["success"]
    assert float(settled.get_reward(None, None, outcome)) == 1.0
    put_particles(settled, half_out)
    outcome = settled.evaluate()
    assert float(outcome["success_value"]) < 0.85
    assert not outcome["success"]


def test_the_dense_reward_grows_with_what_is_done(settled):
    def reward():
        return float(settled.compute_normalized_dense_reward(None, torch.zeros(60), {}))

    lying, half_out = settled.get_particles(), press_into_box(settled, share=0.6)
    inside = press_into_box(settled)
    rewards = [reward()]
    for positions in (half_out, inside):
        put_particles(settled, positions)
        rewards.append(reward())
    assert 0 < rewards[0] < rewards[1] < 0.75 < rewards[2] <= 1
    assert float(settled.compute_dense_reward(None, torch.zeros(60), {})) == 4 * rewards[2]
    put_particles(settled, inside, np.full_like(inside, 0.05))
    assert 0.75 < reward() < rewards[2]
    # nothing is gained with hands that are nearer by half a metre, except for reaching
    before = settled.compute_reward_terms()
    put_particles(settled, lying - [0, 0.4, 0])
    assert settled.compute_reward_terms().reach < before.reach == 1.0


def test_rewards_of_each_mode_are_given_by_step():
    for mode, largest in (("normalized_dense", 1.0), ("dense", 4.0), ("sparse", 1.0)):
        made = gymnasium.make(
            "FoldTops-v1",
            task=HARDLY_SETTLED,
            reconfiguration_freq=0,
            obs_mode="state",
            reward_mode=mode,
            render_backend="none",
        )
        made.reset(seed=7, options={"garment": GARMENT})
        reward = made.step(made.unwrapped.agent.get_joint_state()[0].numpy())[1]
        made.close()
        assert reward.shape == (1,)
        assert (0 < float(reward) < largest) is (mode != "sparse")


# Of Pinocchio and of NumPy, by SAPIEN's wrapper.
@pytest.mark.filterwarnings("ignore:Deprecated member:UserWarning")
@pytest.mark.filterwarnings("ignore:__array__ implementation:DeprecationWarning")
def test_end_effectors_go_where_they_are_told():
    made = gymnasium.make(
        "FoldTops-v1",
        task=HARDLY_SETTLED,
        reconfiguration_freq=0,
        obs_mode="state",
        control_mode="pd_ee_pose",
        render_backend="none",
    )
    made.reset(seed=7, options={"garment": GARMENT})
    agent = made.unwrapped.agent
    start = agent.get_ee_poses()[0]
    way = torch.tensor([[0.05, 0.15, -0.05], [-0.1, 0.1, 0.05]])
    angles = matrix_to_euler_angles(quaternion_to_matrix(start[:, 3:]), "XYZ")
    angles[0, 0] += 0.2
    hand = torch.tensor(HAND_POSES["close"].tolist())
    for k in range(1, 61):
        position = start[:, :3] + way * min(k / 30, 1)
        parts = [torch.cat([position[i], angles[i], hand]) for i in range(2)]
        made.step(torch.cat(parts).numpy())
    reached = agent.get_ee_poses()[0]
    np.testing.assert_allclose(reached[:, :3].numpy(), (start[:, :3] + way).numpy(), atol=2e-3)
    wanted = euler_angles_to_matrix(angles, "XYZ").numpy()
    np.testing.assert_allclose(quaternion_to_matrix(reached[:, 3:]).numpy(), wanted, atol=5e-3)
    for side in ("left", "right"):
        fingers = agent.get_joint_state()[0, joint_slice(side, "hand")]
        np.testing.assert_allclose(fingers.numpy(), HAND_POSES["close"], atol=0.05)
    # out of reach: the arm stays
    parts = [torch.cat([start[i, :3] + 5.0, angles[i], hand]) for i in range(2)]
    for _ in range(10):
        made.step(torch.cat(parts).numpy())
    stayed = agent.get_ee_poses()[0, :, :3]
    np.testing.assert_allclose(stayed.numpy(), reached[:, :3].numpy(), atol=5e-3)
    made.close()


def test_a_garment_that_moves_is_no_success(settled):
    positions = press_into_box(settled)
    for speed, is_still in ((0.04, True), (0.06, False)):
        velocities = np.zeros_like(positions)
        velocities[:, 2] = speed
        put_particles(settled, positions, velocities)
        outcome = settled.evaluate()
        assert bool(outcome["is_still"]) is is_still
        assert bool(outcome["success"]) is is_still


def test_a_garment_that_a_hand_touches_is_not_released(settled):
    assert not settled.is_touching()
    lying = settled.get_particles().astype(np.float64)
    # the middle of the cloth goes right through the palm
    pose = settled.agent.get_ee_poses()[0, 0].numpy()
    palm = pose[:3] + 0.8 * (wrist_to_grasp(pose[:3], pose[3:], "left") - pose[:3])
    nearest = np.argsort(np.linalg.norm(lying[:, :2] - lying[:, :2].mean(axis=0), axis=1))[:200]
    touched = lying.copy()
    touched[nearest] += palm - lying[nearest].mean(axis=0)
    put_particles(settled, touched)
    settled.cloth.step()
    assert settled.is_touching()
    assert not settled.evaluate()["is_released"]
    put_particles(settled, lying)
    settled.cloth.step()
    assert not settled.is_touching()


def test_equal_seeds_give_equal_particles_to_the_last_bit(env):
    runs = []
    for _ in range(2):
        env.reset(seed=8)  # what was there before leaves no trace
        env.reset(seed=7, options={"garment": GARMENT})
        runs.append(run(env, 20))
    for a, b in zip(*runs, strict=True):
        np.testing.assert_array_equal(a, b)


def swing_arms(env, seed, frames, *, inwards):
    """Swing both arms, all joints of which tremble on the way; returns the joint positions in every frame.

    Inwards their hands meet, and fingers get between each other.
    """
    env.reset(seed=seed, options={"garment": GARMENT})
    start = env.agent.get_joint_state()[0].numpy().copy()
    tremor = 0.3 * np.random.default_rng(1).uniform(-1, 1, start.size)
    states = []
    for frame in range(frames):
        action = start + inwards * tremor * np.sin(frame / 10)
        share = min(frame / 60, 1.0) * (1.1 if inwards else -0.5)
        for side, turn in (("left", -share), ("right", share)):
            action[joint_slice(side, "arm").start] += turn
        env.advance(action)
        states.append(env.agent.get_joint_state()[0].numpy().copy())
    return np.array(states)


def test_arms_that_collide_do_so_alike_after_any_episode(env):
    first = swing_arms(env, 7, 150, inwards=True)
    swing_arms(env, 8, 60, inwards=False)  # in which nothing touches

    np.testing.assert_array_equal(swing_arms(env, 7, 150, inwards=True), first)


def test_draws_follow_from_the_seed_alone_and_lie_in_their_ranges(env):
    draws = []
    for seed in (5, 4, 5):
        env.reset(seed=seed)
        draws.append(dict(env.draws))
    assert draws[0] == draws[2] != draws[1]
    for draw in draws:
        assert TASK.x_range[0] <= draw["x"] <= TASK.x_range[1]
        assert TASK.y_range[0] <= draw["y"] <= TASK.y_range[1]
        assert draw["garment"].startswith("Tops_LongSleeve/")


def test_the_garment_can_be_chosen_and_nothing_else_changes(settled):
    """And a state belongs to its garment."""
    chosen, state, count = (
        dict(settled.draws),
        settled.get_state_dict(),
        len(settled.get_particles()),
    )
    assert settled.garment.name == chosen["garment"] == GARMENT
    settled.reset(seed=7)
    assert settled.garment.name == settled.draws["garment"] != GARMENT
    assert {k: settled.draws[k] for k in "xy"} == {k: chosen[k] for k in "xy"}
    with pytest.raises(ValueError, match=f"must be of this garment.*got {count}"):
        settled.set_state_dict(state)


def test_several_environments_in_one_process_are_refused():
    with pytest.raises(ValueError, match=r"num_envs must be 1 \(one process .*got 2"):
        gymnasium.make("FoldTops-v1", num_envs=2, render_backend="none")


def test_pictures_of_a_scene_that_cannot_render_are_an_error(env):
    with pytest.raises(RuntimeError, match="render_backend"):
        take_picture(env, "garment_camera")
