"""An actor with one learned policy for each stage."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from dgl_assets.robots import SIDES, Side
from dgl_collect.stage_work import StageWork
from dgl_tasks.holding import is_low
from dgl_tasks.messages import Part

CLOSED = 1.0
"""Change of the joint targets of a hand that counts as closing, a Euclidean distance [rad]. It is
3.3 in demonstrations."""


class StagePolicy(Protocol):
    """Gives chunks of joint targets, as `PolicyRunner` of `dgl_sadp` does.

    Observations have the keys of episode files.
    """

    def reset(self, observation: Mapping[str, np.ndarray], *, seed: int | None = None) -> None:
        """Begin a stage; the observation holds its constant part: clouds and affordance."""
        ...

    def observe(self, observation: Mapping[str, np.ndarray]) -> None:
        """Take the observation after each executed target but the last of a chunk."""
        ...

    def act(self, observation: Mapping[str, np.ndarray]) -> np.ndarray:
        """Take the observation after a chunk; return the next targets [rad], shape (n, D)."""
        ...


@dataclass(frozen=True, kw_only=True)
class Learned:
    """A policy of one stage."""

    policy: StagePolicy
    chunks: int
    """Number of chunks to execute."""

    def __post_init__(self) -> None:
        if self.chunks < 1:
            raise ValueError(f"chunks must be at least 1; got {self.chunks}")


@dataclass(frozen=True, kw_only=True)
class PolicyActor:
    """Carries out stages by learned policies.

    With `is_sent` the hands start at matched grasp points, which is HALO. Without it, policies
    start from the parked arms and see no affordance.

    Source:
        DexGarmentLab, section on HALO; ablation "w/o GAM".
    """

    policies: Mapping[str, Learned]
    """Policies by name of the stage."""
    is_sent: bool = True
    follows_steps: bool = False

    def act(self, work: StageWork) -> Part:
        """Observe, act and execute; check the hold after each chunk."""
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
    """Watches for hands that have lost the garment.

    Only hands that have been down at the garment and are up again are checked. The far side of a
    hand may hide cloth from the camera, so two checks in a row must agree. A hand that its policy
    has opened is not checked any more.
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
        """Note executed joint targets [rad], shape (D,)."""
        robot = self._work.hands.motion.robot
        for side in SIDES:
            part = robot.joint_slice(side, "hand")
            self._now[side] = float(np.linalg.norm(np.asarray(target)[part] - self._start[part]))
            self._most[side] = max(self._most[side], self._now[side])
        self._note_heights()

    def find_empty(self) -> set[Side]:
        """Find the hands that are empty in this check and in the one before."""
        before = self._empty
        self._empty = (self._work.find_empty() & self._were_down) - self._find_opened()
        return before & self._empty

    def _note_heights(self) -> None:
        sensed = self._work.hands.sensed
        self._were_down.update(side for side in self._work.stage.hands if is_low(sensed, side))

    def _find_opened(self) -> set[Side]:
        """Find the hands that have closed and are more than half open again."""
        return {
            side
            for side in SIDES
            if self._most[side] > CLOSED and self._now[side] < 0.5 * self._most[side]
        }
