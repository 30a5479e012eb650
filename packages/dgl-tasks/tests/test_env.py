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
from dgl_assets.robots import DEFAULT_ROBOT, HAND_POSES
from dgl_tasks.control import interpolate_action
from dgl_tasks.env import STILL_SPEED
from dgl_tasks.errors import RenderingUnavailableError
from dgl_tasks.grasps import wrist_to_grasp
from dgl_tasks.observation import STEPS_PER_ACTION
from dgl_tasks.success import CoversFlatArea
from dgl_tasks.views import TrueView

JOINT_NAMES = DEFAULT_ROBOT.joint_names
joint_slice = DEFAULT_ROBOT.joint_slice

TASK = dgl_tasks.get_task("FoldTops-v1")
HARDLY_SETTLED = dataclasses.replace(TASK, start=dataclasses.replace(TASK.start, settle_frames=2))
"""For what does not depend on where the garment comes to rest."""
GARMENT = "Tops_LongSleeve/001294"


@pytest.fixture(scope="module")
def env(coarse_garments):
    """One environment for the whole module: each test resets it."""
    made = gymnasium.make(
        "FoldTops-v1", obs_mode="state", sim_backend="physx_cpu", render_backend="none"
    )
    yield made.unwrapped
    made.close()


@pytest.fixture(scope="module")
def memory():
    """State that `settled` restores, kept for the module."""
    return {}


@pytest.fixture
def settled(env, memory):
    """The environment after a reset with one seed and garment, restored if that is quicker."""
    if memory and env.draws == memory["draws"]:
        env.set_state_dict(memory["state"])
    else:
        env.reset(seed=7, options={"garment": GARMENT})
        memory.update(draws=dict(env.draws), state=env.get_state_dict())
    return env


def get_action(env):
    """A fixed action that is not the resting one: both hands half closed."""
    action = env.agent.read_joints().copy()
    for side in ("left", "right"):
        action[joint_slice(side, "hand")] = 0.5 * HAND_POSES["close"]
    return action


def resting(env):
    """Joint targets of the start."""
    return env.agent.model.compute_start("open").astype(np.float32)


def run(env, actions, action=None):
    """Step with one action again and again; the particles and the joint positions at the end."""
    action = get_action(env) if action is None else action
    for _ in range(actions):
        env.step(action)
    return env.get_particles().copy(), env.agent.read_joints().copy()


def put_particles(env, positions, velocities=None):
    velocities = np.zeros_like(positions) if velocities is None else velocities
    env.cloth.state.set_particles(
        positions[None].astype(np.float32), velocities[None].astype(np.float32)
    )


def press_into_box(env, *, share=1.0):
    """Scale the garment horizontally about the box's centre until it fits; leave a part outside."""
    x0, y0, x1, y1 = env.apply_rule().box
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
    np.testing.assert_array_equal(q[0], settled.agent.read_joints())
    poses = parts["extra"]["ee_poses"].reshape(2, 7)
    np.testing.assert_array_equal(poses, settled.agent.read_hands())
    assert poses[0, 0] < 0 < poses[1, 0]  # left first
    np.testing.assert_allclose(np.linalg.norm(poses[:, 3:], axis=1), 1.0, atol=1e-5)


def test_the_joint_targets_are_reached(settled):
    action = get_action(settled)
    for _ in range(60):
        settled.advance(action)
    np.testing.assert_allclose(settled.agent.read_joints(), action, atol=0.03)


def test_the_garment_lies_where_it_was_drawn(settled):
    particles = settled.get_particles()
    assert particles.shape == settled.garment.vertices.shape
    middle = (particles.min(axis=0) + particles.max(axis=0)) / 2
    np.testing.assert_allclose(middle[:2], (settled.draws["x"], settled.draws["y"]), atol=0.02)
    assert particles[:, 2].min() > 0
    assert particles[:, 2].max() < 0.08


def test_an_action_is_five_control_steps_on_a_straight_line(settled, monkeypatch):
    start, action, targets = resting(settled), get_action(settled), []
    settled.advance(start)
    before = int(settled.elapsed_steps[0])
    with monkeypatch.context() as patch:
        patch.setattr(settled, "advance", lambda target: targets.append(np.array(target)))
        settled.step(action)
    share = np.array([0.2, 0.4, 0.6, 0.8, 1.0])[:, None]
    np.testing.assert_allclose(targets, start + share * (action - start), atol=1e-6)
    np.testing.assert_array_equal(targets[-1], action)
    assert int(settled.elapsed_steps[0]) == before + 1
    # the next line begins where this one has ended
    settled.step(action)
    with monkeypatch.context() as patch:
        targets.clear()
        patch.setattr(settled, "advance", lambda target: targets.append(np.array(target)))
        settled.step(start)
    np.testing.assert_allclose(targets, action + share * (start - action), atol=1e-6)


def test_advancing_moves_like_stepping(settled):
    """A step goes on from the targets that `advance` has given."""
    start, action = resting(settled), get_action(settled)
    state = settled.get_state_dict()
    run(settled, 1, action)  # PhysX keeps more of the joints than it tells, so both come from here
    settled.set_state_dict(state)
    settled.advance(start)
    stepped = run(settled, 2, action)
    settled.set_state_dict(state)
    settled.advance(start)
    before = int(settled.elapsed_steps[0])
    for row in interpolate_action(start, action):
        settled.advance(row.astype(np.float32))
    for _ in range(STEPS_PER_ACTION):
        settled.advance(action)
    np.testing.assert_array_equal(settled.get_particles(), stepped[0])
    np.testing.assert_array_equal(settled.agent.read_joints(), stepped[1])
    assert int(settled.elapsed_steps[0]) == before


def test_without_an_action_the_targets_stay(settled):
    start, action = resting(settled), get_action(settled)
    state = settled.get_state_dict()
    runs = []
    for again in (None, action):
        settled.set_state_dict(state)
        settled.advance(start)
        settled.step(action)
        settled.step(again)
        settled.advance(again)
        runs.append((settled.get_particles().copy(), settled.agent.read_joints()))
    for a, b in zip(*runs, strict=True):
        np.testing.assert_array_equal(a, b)


def test_actions_are_clipped_to_the_action_space_and_that_is_logged_once(settled, caplog):
    space, state = settled.single_action_space, settled.get_state_dict()
    states = []
    settled._bounds.clear()
    for scale in (1.0, 100.0):
        settled.set_state_dict(state)
        for _ in range(2):
            settled.step(scale * space.high)
        states.append(settled.get_state())
    torch.testing.assert_close(*states, rtol=0, atol=0)
    told = [record.getMessage() for record in caplog.records if "clipped" in record.message]
    assert len(told) == 1
    assert "clipped to the action space: number" in told[0]


def test_a_broken_state_is_refused_and_named(settled, refuse):
    state = settled.get_state_dict()
    garment = {k: v for k, v in state["garment"].items() if k != "forces"}
    nan = torch.full_like(state["targets"]["joints"], torch.nan)
    assert not refuse(
        (lambda change=change: settled.set_state_dict(state | change), message)
        for change, message in (
            ({"garment": garment}, r"must have 'garment\.forces'; it has \['is_stuck', 'memory'"),
            ({"garment": 3}, "'garment' must be a dict; got"),
            ({"targets": {"joints": nan}}, r"state 'targets\.joints' must be finite numbers"),
        )
    )
    lacking = {name: value for name, value in state.items() if name != "targets"}
    assert not refuse([(lambda: settled.set_state_dict(lacking), "must have 'targets'")])


def test_another_task_needs_another_environment(settled):
    with pytest.raises(AttributeError, match="task"):
        settled.task = HARDLY_SETTLED
    assert settled.task == TASK


@pytest.mark.parametrize("is_flat", [False, True])
def test_a_restored_state_goes_on_to_the_last_bit(settled, is_flat):
    """The joints of the first run differ by rounding: PhysX keeps more of them than it tells."""
    run(settled, 1)
    state = settled.get_state().clone() if is_flat else settled.get_state_dict()
    restore = settled.set_state if is_flat else settled.set_state_dict
    first = run(settled, 2)
    restored = []
    for _ in range(2):
        restore(state)
        now = settled.get_state() if is_flat else settled.get_state_dict()["garment"]["positions"]
        before = state if is_flat else state["garment"]["positions"]
        torch.testing.assert_close(now, before, rtol=0, atol=0)
        restored.append(run(settled, 2))
    for a, b in zip(*restored, strict=True):
        np.testing.assert_array_equal(a, b)
    np.testing.assert_array_equal(restored[0][0], first[0])
    np.testing.assert_allclose(restored[0][1], first[1], rtol=0, atol=1e-6)


def test_what_was_commanded_before_a_state_is_restored_leaves_no_trace(settled):
    start, action = resting(settled), get_action(settled)
    settled.step(start)
    state = settled.get_state_dict()
    settled.step(start)
    undisturbed = settled.agent.read_joints().copy()
    settled.set_state_dict(state)
    run(settled, 3, action)
    settled.set_state_dict(state)
    settled.step(start)
    joints = settled.agent.read_joints()
    np.testing.assert_allclose(joints, undisturbed, rtol=0, atol=1e-5)


def test_a_state_does_not_change_after_it_was_taken(settled):
    state = settled.get_state_dict()
    copy = {
        (part, key): value.clone() for part, node in state.items() for key, value in node.items()
    }
    run(settled, 1)
    for (part, key), value in copy.items():
        torch.testing.assert_close(state[part][key], value, rtol=0, atol=0)


def test_a_garment_that_lies_flat_is_no_success(settled):
    outcome = settled.evaluate()
    criteria = outcome.pop("criteria")
    assert set(outcome) == {"success", "success_value", "is_still", "is_released"}
    assert all(value.shape == (1,) for value in (*outcome.values(), *criteria.values()))
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
    reward = settled.get_reward(None, None, outcome)
    assert (float(reward), reward.dtype) == (1.0, torch.float32)
    put_particles(settled, half_out)
    outcome = settled.evaluate()
    assert float(outcome["success_value"]) < 0.85
    assert not outcome["success"]


@pytest.mark.parametrize(
    ("share", "speed", "reason"),
    [
        (1.0, 0.0, None),
        (0.6, 0.0, "below the threshold"),
        (0.6, 0.1, "below the threshold"),
        (1.0, 0.1, "still moving"),
    ],
)
def test_what_is_evaluated_is_what_is_judged(settled, share, speed, reason):
    positions = press_into_box(settled, share=share)
    put_particles(settled, positions, np.full_like(positions, speed / np.sqrt(3)))
    check_evaluation(settled, reason)


def check_evaluation(env, reason):
    """Tensors say what the verdict says, which is the rule's with two criteria more."""
    told, verdict, rule = env.evaluate(), env.judge(), env.apply_rule()
    assert verdict.reason == reason
    assert bool(told["success"]) is verdict.success is (reason is None)
    assert float(told["success_value"]) == pytest.approx(verdict.value) == rule.value
    assert verdict.criteria[: len(rule.criteria)] == rule.criteria
    assert verdict.box == rule.box
    released, still = verdict.criteria[len(rule.criteria) :]
    assert released.value == env.count_touching()
    assert still.value == env.measure_speed()
    assert bool(told["is_released"]) is released.is_met
    assert bool(told["is_still"]) is still.is_met is (env.measure_speed() < STILL_SPEED)
    measured = {name: float(value) for name, value in told["criteria"].items()}
    assert measured == pytest.approx({c.name: c.value for c in verdict.criteria})


def test_the_view_is_the_truth(settled):
    view, garment = settled.view, settled.garment
    np.testing.assert_array_equal(view.surface, settled.get_particles())
    assert set(view.landmarks) == set(TASK.success.landmarks)
    before = {name: place.copy() for name, place in view.landmarks.items()}
    for name, place in before.items():
        np.testing.assert_array_equal(place, view.surface[garment.landmarks[name]])
    # they stay where they lay at the start, whatever becomes of the garment
    put_particles(settled, settled.get_particles() + np.float32([0.1, 0.0, 0.0]))
    moved = settled.view
    for name, place in before.items():
        np.testing.assert_array_equal(moved.landmarks[name], place)
    np.testing.assert_allclose(
        moved.top.mean(axis=0) - view.top.mean(axis=0), [0.1, 0, 0], atol=1e-3
    )
    lying_flat = TrueView(
        particles=garment.vertices,
        upright=garment.vertices,
        faces=garment.faces,
        landmarks={},
        flat_area=view.flat_area,
        frames={},
    )
    assert CoversFlatArea()(lying_flat).value == 1.0
    assert view.frames == {}


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


def test_rewards_of_each_mode_are_given_by_step(settled, monkeypatch):
    for mode, largest in (("normalized_dense", 1.0), ("dense", 4.0), ("sparse", 1.0)):
        monkeypatch.setattr(settled, "_reward_mode", mode)
        reward = settled.step(settled.agent.read_joints())[1]
        assert reward.shape == (1,)
        assert (0 < float(reward) < largest) is (mode != "sparse")


# Of Pinocchio and of NumPy, by SAPIEN's wrapper.
of_pinocchio = pytest.mark.filterwarnings(
    "ignore:Deprecated member:UserWarning",
    "ignore:__array__ implementation:DeprecationWarning",
)


def test_hand_poses_move_like_the_joint_targets_that_they_stand_for(settled, refuse):
    start = resting(settled)
    action, state = start.copy(), settled.get_state_dict()
    for side in ("left", "right"):
        hand = joint_slice(side, "hand")
        action[hand] = 0.5 * (start[hand] + HAND_POSES["close"])
    run(settled, 1, action)  # PhysX keeps more of the joints than it tells, so both come from here
    settled.set_state_dict(state)
    settled.advance(start)
    moved = run(settled, 2, action)
    short = settled.agent.hand_pose_actions.from_joints(action)
    assert short[[6, 17]].tolist() == pytest.approx([0.5, 0.5], abs=2e-5)  # half closed
    settled.set_state_dict(state)
    settled.advance(start)
    try:
        settled.step({"control_mode": "pd_hand_poses", "action": short})
        assert settled.agent.single_action_space.shape == (22,)
        settled.step(short)
        too_long = lambda: settled.step(action)  # noqa: E731
        assert not refuse([(too_long, r"action must have shape \(22,\) .*; got \(60,\)")])
        assert settled.agent.read_joints() == pytest.approx(moved[1], abs=1e-4)
        assert settled.get_particles() == pytest.approx(moved[0], abs=1e-3)
        np.testing.assert_allclose(settled._target, action, atol=3e-5)
    finally:
        settled.agent.set_control_mode("pd_joint_pos")


@pytest.fixture(scope="module")
def pose_env(coarse_garments):
    made = gymnasium.make(
        "FoldTops-v1",
        task=HARDLY_SETTLED,
        reconfiguration_freq=0,
        obs_mode="state",
        control_mode="pd_ee_pose",
        render_backend="none",
    )
    yield made
    made.close()


@pytest.fixture
def by_pose(pose_env):
    pose_env.unwrapped.agent.set_control_mode("pd_ee_pose")
    pose_env.reset(seed=7, options={"garment": GARMENT})
    return pose_env


def make_pose_action(positions, angles):
    """Both ends at these places with these angles, and closed hands."""
    hand = torch.tensor(HAND_POSES["close"].tolist())
    parts = [torch.cat([positions[i], angles[i], hand]) for i in range(2)]
    return torch.cat(parts).numpy()


@of_pinocchio
def test_end_effectors_go_where_they_are_told(by_pose):
    agent = by_pose.unwrapped.agent
    start = torch.from_numpy(agent.read_hands())
    way = torch.tensor([[0.05, 0.15, -0.05], [-0.1, 0.1, 0.05]])
    angles = matrix_to_euler_angles(quaternion_to_matrix(start[:, 3:]), "XYZ")
    angles[0, 0] += 0.2
    for k in range(1, 17):
        by_pose.step(make_pose_action(start[:, :3] + way * min(k / 8, 1), angles))
    reached = torch.from_numpy(agent.read_hands())
    np.testing.assert_allclose(reached[:, :3].numpy(), (start[:, :3] + way).numpy(), atol=2e-3)
    wanted = euler_angles_to_matrix(angles, "XYZ").numpy()
    np.testing.assert_allclose(quaternion_to_matrix(reached[:, 3:]).numpy(), wanted, atol=5e-3)
    for side in ("left", "right"):
        fingers = agent.read_joints()[joint_slice(side, "hand")]
        np.testing.assert_allclose(fingers, HAND_POSES["close"], atol=0.05)
    # out of reach: the arm stays
    for _ in range(2):
        by_pose.step(make_pose_action(start[:, :3] + 5.0, angles))
    stayed = agent.read_hands()[:, :3]
    np.testing.assert_allclose(stayed, reached[:, :3].numpy(), atol=5e-3)


@of_pinocchio
def test_joint_targets_go_on_from_where_poses_have_brought_the_arms(by_pose):
    agent = by_pose.unwrapped.agent
    start = torch.from_numpy(agent.read_hands())
    angles = matrix_to_euler_angles(quaternion_to_matrix(start[:, 3:]), "XYZ")
    for k in range(1, 13):
        by_pose.step(
            make_pose_action(start[:, :3] + torch.tensor([0, 0.015, 0]) * min(k, 8), angles)
        )
    joints = agent.read_joints().copy()
    by_pose.step({"control_mode": "pd_joint_pos", "action": joints})
    assert agent.control_mode == "pd_joint_pos"
    np.testing.assert_allclose(agent.read_joints(), joints, atol=0.02)


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
    assert settled.count_touching() == 0
    lying = settled.get_particles().astype(np.float64)
    # the middle of the cloth goes right through the palm
    pose = settled.agent.read_hands()[0]
    palm = pose[:3] + 0.8 * (wrist_to_grasp(pose[:3], pose[3:], "left") - pose[:3])
    nearest = np.argsort(np.linalg.norm(lying[:, :2] - lying[:, :2].mean(axis=0), axis=1))[:200]
    touched = lying.copy()
    touched[nearest] += palm - lying[nearest].mean(axis=0)
    put_particles(settled, touched)
    settled.cloth.step()
    assert settled.count_touching() > 0
    pulls = settled.measure_pulls()
    assert np.linalg.norm(pulls["left"]) > 0
    assert not pulls["right"].any()
    assert not settled.evaluate()["is_released"]
    check_evaluation(settled, "below the threshold")
    (released,) = (c for c in settled.judge().criteria if c.failure == "not released")
    assert not released.is_met
    put_particles(settled, lying)
    settled.cloth.step()
    assert settled.count_touching() == 0


def test_equal_seeds_give_equal_draws_and_particles_to_the_last_bit(env):
    runs, draws = [], []
    for seed in (7, 8, 7):
        env.reset(seed=seed)
        draws.append(dict(env.draws))
        runs.append(run(env, 2))
    assert draws[0] == draws[2] != draws[1]
    for a, b in zip(runs[0], runs[2], strict=True):
        np.testing.assert_array_equal(a, b)
    for draw in draws:
        assert TASK.start.x_range[0] <= draw["x"] <= TASK.start.x_range[1]
        assert TASK.start.y_range[0] <= draw["y"] <= TASK.start.y_range[1]
        assert draw["garment"].startswith("Tops_LongSleeve/")


def swing_arms(env, seed, frames, *, inwards):
    """Swing both arms with trembling joints; returns the joint positions in every frame.

    Inwards their hands meet, and fingers get between each other.
    """
    env.reset(seed=seed, options={"garment": GARMENT})
    start = env.agent.read_joints().copy()
    tremor = 0.3 * np.random.default_rng(1).uniform(-1, 1, start.size)
    states = []
    for frame in range(frames):
        action = start + inwards * tremor * np.sin(frame / 10)
        share = min(frame / 60, 1.0) * (1.1 if inwards else -0.5)
        for side, turn in (("left", -share), ("right", share)):
            action[joint_slice(side, "arm").start] += turn
        env.advance(action)
        states.append(env.agent.read_joints().copy())
    return np.array(states)


def test_arms_that_collide_do_so_alike_after_any_episode(env):
    first = swing_arms(env, 7, 100, inwards=True)
    swing_arms(env, 8, 30, inwards=False)  # in which nothing touches
    np.testing.assert_array_equal(swing_arms(env, 7, 100, inwards=True), first)


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
    with pytest.raises(RenderingUnavailableError, match="render_backend"):
        env.take_picture("garment_camera")
