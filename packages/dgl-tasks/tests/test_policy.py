"""Policies and methods in an episode, with arms that reach every target at once."""

import numpy as np
import pytest

from dgl_assets.robots import DEFAULT_ROBOT, HAND_POSES
from dgl_tasks.errors import PolicyError
from dgl_tasks.hand_span import HandPoseActions
from dgl_tasks.observation import STEPS_PER_ACTION
from dgl_tasks.policy import FromStart, Method, Nothing, ObservingPolicy, Policy


class Counter:
    """Gives chunks of three targets, numbered through all joints, and notes what it is shown."""

    def __init__(self, chunks=99):
        self.shown, self.reset_keys, self.left = [], None, chunks

    def reset(self, observation):
        self.reset_keys = set(observation)

    def act(self, observation):
        self.shown.append(("act", float(observation["joint_state"][0])))
        self.left -= 1
        if self.left < 0:
            return np.zeros((0, 60))
        first = 3 * len([kind for kind, _ in self.shown if kind == "act"]) - 2
        return np.tile(np.arange(first, first + 3, dtype=float)[:, None], (1, 60))


class Watcher(Counter):
    def observe(self, observation):
        self.shown.append(("observe", float(observation["joint_state"][0])))


@pytest.fixture
def world(jumping_world):
    """The first joint is at 0, so that it tells which action has been reached."""
    jumping_world.target = np.zeros(60)
    jumping_world.motion.reset(np.zeros(60))
    return jumping_world


def run(world, policy, actions):
    """The actions that have been reached, by their numbers."""
    commands = world.play(FromStart(policy=policy, actions=actions).run(world.hands))
    assert not any(command.is_passage or command.recorded for command in commands)
    return [float(command.target[0]) for command in commands[STEPS_PER_ACTION - 1 :: 5]]


def test_a_policy_is_shown_each_observation_once(world):
    policy = Watcher()
    assert run(world, policy, 6) == [1, 2, 3, 4, 5, 6]
    assert policy.reset_keys == {
        "joint_state", "ee_pose", "image", "env_point_cloud", "garment_point_cloud",
    }  # fmt: skip
    watched = ["act", "observe", "observe"] * 2
    assert policy.shown == list(zip(watched, [0, 1, 2, 3, 4, 5], strict=True))


def test_a_policy_without_observe_is_asked_between_its_chunks_only(world):
    policy = Counter()
    assert run(world, policy, 6) == [1, 2, 3, 4, 5, 6]
    assert policy.shown == [("act", 0), ("act", 3)]


def test_an_episode_ends_with_the_actions_or_when_the_policy_gives_none(world):
    assert run(world, Counter(), 4) == [1, 2, 3, 4]
    world.target = np.zeros(60)
    world.motion.reset(np.zeros(60))
    assert run(world, Counter(chunks=1), 100) == [1, 2, 3]
    with pytest.raises(ValueError, match="actions must be at least 1; got 0"):
        FromStart(policy=Counter(), actions=0)


def test_what_is_no_action_is_refused(world):
    class Wrong(Counter):
        def act(self, observation):
            return np.zeros((1, 59))

    with pytest.raises(PolicyError, match=r"actions must have shape \(N, 60\); got \(1, 59\)"):
        run(world, Wrong(), 1)


def test_actions_of_hand_poses_become_the_joint_targets_that_they_stand_for(world):
    class Grasp(Counter):
        def act(self, observation):
            action = np.zeros((1, 22))
            action[:, HandPoseActions(DEFAULT_ROBOT).names.index("left_hand_close")] = 1.0
            return action

    def play(policy):
        acting = FromStart(policy=policy, actions=1, control_mode="pd_hand_poses")
        return world.play(acting.run(world.hands))[-1].target

    hands = {side: DEFAULT_ROBOT.joint_slice(side, "hand") for side in ("left", "right")}
    reached = play(Grasp())
    np.testing.assert_allclose(reached[hands["left"]], HAND_POSES["close"], atol=1e-6)
    np.testing.assert_allclose(reached[hands["right"]], HAND_POSES["open"], atol=1e-6)
    with pytest.raises(PolicyError, match=r"actions must have shape \(N, 22\); got \(1, 60\)"):
        play(Counter())


def test_nothing_gives_no_command(world):
    assert world.play(Nothing().run(world.hands)) == []


def test_who_is_what():
    assert isinstance(Nothing(), Method)
    assert isinstance(FromStart(policy=Counter(), actions=1), Method)
    assert isinstance(Counter(), Policy)
    assert not isinstance(Counter(), ObservingPolicy)
    assert not isinstance(Counter(), Method)
    assert isinstance(Watcher(), ObservingPolicy)
    assert not isinstance(Nothing(), Policy)
