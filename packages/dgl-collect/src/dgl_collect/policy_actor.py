"""A learned policy for each stage as an actor: it takes over at the grasp points and moves the hands in its own way."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from dgl_assets.robots import SIDES, Side
from dgl_collect.stage_work import StageWork
from dgl_tasks.holding import is_low
from dgl_tasks.messages import Part

CLOSED = 1.0
"""How far the targets of a hand's joints have to have gone for it to be closed, as a Euclidean
distance [rad]; 3.3 in demonstrations."""


class StagePolicy(Protocol):
    """Gives chunks of joint targets; `PolicyRunner` of `dgl_sadp` is one. Observations have the keys of episode files."""

    def reset(self, observation: Mapping[str, np.ndarray], *, seed: int | None = None) -> None:
        """Begin a stage with what stays the same in it: the clouds and the affordance."""
        ...

    def observe(self, observation: Mapping[str, np.ndarray]) -> None:
        """Take the observation that follows each executed target but the last of a chunk."""
        ...

    def act(self, observation: Mapping[str, np.ndarray]) -> np.ndarray:
        """Take the observation that follows the last target and return the next ones [rad], shape (n, D)."""
        ...


@dataclass(frozen=True, kw_only=True)
class Learned:
    """A policy of one stage."""

    policy: StagePolicy
    chunks: int
    """How many chunks of targets it executes."""

    def __post_init__(self) -> None:
        if self.chunks < 1:
            raise ValueError(f"chunks must be at least 1; got {self.chunks}")


@dataclass(frozen=True, kw_only=True)
class PolicyActor:
    """Lets policies carry out what stages record.

    Where the hands are sent to matched points first this is HALO. Where they are not, policies find
    their way from the parked arms, without affordance.

    Source:
        DexGarmentLab, section on HALO; ablation "w/o GAM".
    """

    policies: Mapping[str, Learned]
    """By the name of the stage."""
    is_sent: bool = True
    follows_steps: bool = False

    def act(self, work: StageWork) -> Part:
        """Observe, act and execute, chunk after chunk, and look after each whether the hands hold the garment."""
        learned = self.policies[work.stage.name]
        policy, begins = learned.policy, work.begins
        first = {
            "garment_point_cloud": begins.garment_point_cloud,
            "points_affordance_feature": begins.points_affordance_feature,
        }
        if begins.object_point_cloud is not None:
            first["object_point_cloud"] = begins.object_point_cloud
        keys = [work.hands.sensed.seed, *work.draw]
        policy.reset(first, seed=int(np.random.SeedSequence(keys).generate_state(1)[0]))
        watch = _Watch(work)
        seen = (yield from work.hands.observe()).as_arrays()
        for _ in range(learned.chunks):
            targets = policy.act(seen)
            for number, target in enumerate(targets, start=1):
                yield from work.hands.execute(np.asarray(target)[None], recorded="stage")
                watch.note(target)
                seen = (yield from work.hands.observe()).as_arrays()
                if number < len(targets):
                    policy.observe(seen)
            work.react(watch.find_empty())


class _Watch:
    """Which hands of a stage may have lost the garment.

    Of hands that have been down at the garment, and have come up. One look may be past cloth that
    the hand hides: two in turn have to say the same. A hand that its policy has told to let go is
    not looked at any more.
    """

    def __init__(self, work: StageWork) -> None:
        self._work = work
        self._were_down: set[Side] = set()
        self._empty: set[Side] = set()
        self._start = work.hands.sensed.joint_state.astype(float)
        self._now: dict[Side, float] = dict.fromkeys(SIDES, 0.0)
        self._most: dict[Side, float] = dict.fromkeys(SIDES, 0.0)
        self._note_heights()

    def note(self, target: np.ndarray) -> None:
        """Take note of joint targets that have been executed [rad], shape (D,)."""
        robot = self._work.hands.motion.robot
        for side in SIDES:
            part = robot.joint_slice(side, "hand")
            self._now[side] = float(np.linalg.norm(np.asarray(target)[part] - self._start[part]))
            self._most[side] = max(self._most[side], self._now[side])
        self._note_heights()

    def find_empty(self) -> set[Side]:
        """Look, and say which hands are empty for the second time in turn."""
        before = self._empty
        self._empty = (self._work.find_empty() & self._were_down) - self._find_opened()
        return before & self._empty

    def _note_heights(self) -> None:
        sensed = self._work.hands.sensed
        self._were_down.update(side for side in self._work.stage.hands if is_low(sensed, side))

    def _find_opened(self) -> set[Side]:
        """Say which hands have been told to close, and are on their way back by more than a half."""
        return {
            side
            for side in SIDES
            if self._most[side] > CLOSED and self._now[side] < 0.5 * self._most[side]
        }
