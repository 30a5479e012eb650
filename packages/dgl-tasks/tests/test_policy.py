"""Who acts in an episode, and how an episode ends; with an environment that only looks like one."""

from types import SimpleNamespace

import numpy as np
import pytest

from dgl_assets.robots import DEFAULT_ROBOT
from dgl_tasks.driver import FINAL_FRAMES, PARKED_FRAMES
from dgl_tasks.evaluation import run_episode
from dgl_tasks.observation import Observation
from dgl_tasks.policy import EpisodePolicy, FromStart, Nothing, ObservingPolicy, Policy
from dgl_tasks.success import Verdict


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


class Stage:
    """A driver whose robot is where the last target says."""

    def __init__(self):
        self.executed = []

    def observe(self):
        at = self.executed[-1] if self.executed else 0.0
        ee_pose = np.zeros((2, 7), np.float32)
        return Observation(
            joint_state=np.full(60, at, np.float32),
            ee_pose=ee_pose,
            image=np.zeros((480, 640, 3), np.uint8),
            env_point_cloud=np.zeros((2048, 6), np.float32),
        )

    def see_garment(self):
        return np.zeros((2048, 3), np.float32)

    def execute(self, actions):
        self.executed += [float(row[0]) for row in actions]


def test_a_policy_is_shown_each_observation_once():
    driver, policy = Stage(), Watcher()
    FromStart(policy=policy, actions=6).run(driver)
    assert policy.reset_keys == {
        "joint_state", "ee_pose", "image", "env_point_cloud", "garment_point_cloud",
    }  # fmt: skip
    assert driver.executed == [1, 2, 3, 4, 5, 6]
    watched = ["act", "observe", "observe"] * 2
    assert policy.shown == list(zip(watched, [0, 1, 2, 3, 4, 5], strict=True))


def test_a_policy_without_observe_is_asked_between_its_chunks_only():
    driver, policy = Stage(), Counter()
    FromStart(policy=policy, actions=6).run(driver)
    assert policy.shown == [("act", 0), ("act", 3)]


def test_an_episode_ends_with_the_actions_or_when_the_policy_gives_none():
    driver = Stage()
    FromStart(policy=Counter(), actions=4).run(driver)
    assert driver.executed == [1, 2, 3, 4]
    driver = Stage()
    FromStart(policy=Counter(chunks=1), actions=100).run(driver)
    assert driver.executed == [1, 2, 3]
    with pytest.raises(ValueError, match="actions must be at least 1; got 0"):
        FromStart(policy=Counter(), actions=0)


def test_who_is_what():
    assert isinstance(Nothing(), EpisodePolicy)
    assert isinstance(FromStart(policy=Counter(), actions=1), EpisodePolicy)
    assert isinstance(Counter(), Policy)
    assert not isinstance(Counter(), ObservingPolicy)
    assert isinstance(Watcher(), ObservingPolicy)
    assert not isinstance(Nothing(), Policy)


class FakeEnv:
    """Has a robot and a verdict, and counts steps."""

    def __init__(self, is_released=True):
        robot = DEFAULT_ROBOT
        self.task = SimpleNamespace(success=lambda seen, before: self.verdict)
        self.verdict = Verdict(success=True, value=0.9, threshold=0.8, quantity="share")
        self.garment = SimpleNamespace(name="tops/1")
        self.before, self.draws = SimpleNamespace(flat_area=1.0), {"x": 0.1}
        self.cloth = SimpleNamespace(
            measure_strain=lambda: np.zeros(3),
            solver=SimpleNamespace(measure_penetration=lambda state: [0.001]),
            state=None,
        )
        self.sent, self.resets, self.is_released = [], [], is_released
        self.robot = robot

    def reset(self, *, seed, options):
        self.resets.append((seed, options))

    def advance(self, target):
        self.sent.append(target)

    def evaluate(self):
        return {"is_released": np.array(self.is_released), "is_still": np.array(True)}

    def is_still(self):
        return True


class FakeMotion:
    """Plans jumps."""

    def __init__(self):
        self.robot = DEFAULT_ROBOT
        self.target = np.zeros(60)

    def reset(self, joint_state):
        self.target = np.array(joint_state, dtype=float)

    def hold(self, frames):
        return np.tile(self.target, (frames, 1))

    def park(self):
        for side in ("left", "right"):
            self.target[self.robot.joint_slice(side, "arm")] = self.robot.arm.parked[side]
        return self.target[None].copy()


@pytest.fixture
def seen(monkeypatch):
    """Cameras that see one point."""
    picture = SimpleNamespace(rgb=np.zeros((4, 4, 3), np.uint8))
    monkeypatch.setattr("dgl_tasks.driver.see.take_picture", lambda env, camera: picture)
    monkeypatch.setattr("dgl_tasks.driver.see.get_garment_points", lambda *_: np.zeros((1, 3)))


def test_doing_nothing_is_judged_as_the_garment_fell(seen):
    env = FakeEnv()
    result = run_episode(env, FakeMotion(), Nothing(), seed=5, garment="tops/1")
    assert env.resets == [(5, {"garment": "tops/1"})]
    assert result.steps == len(env.sent) == 1 + PARKED_FRAMES + FINAL_FRAMES
    assert result.success
    assert result.reason is None
    assert result.draws == {"x": 0.1}


def test_hands_that_are_not_parked_are_drawn_back_before_the_verdict(seen, monkeypatch):
    retreats = []
    monkeypatch.setattr("dgl_tasks.driver.Driver.retreat", lambda self: retreats.append(True))

    class Reach:
        def run(self, driver):
            driver.execute(np.zeros((1, 60)))
            driver.events.append(("slipped", "left hand"))

    env = FakeEnv(is_released=False)
    result = run_episode(env, FakeMotion(), Reach(), seed=0)
    assert retreats == [True]
    assert not result.success  # the rule is met, but a hand still touches the garment
    assert result.judgement.reason == "not released"
    assert result.reason == "slipped"
    assert env.resets == [(0, {})]
