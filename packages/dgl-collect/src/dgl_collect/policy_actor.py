"""An actor of learned policies."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from dgl_collect.hold_watch import HoldWatch
from dgl_collect.stage_work import StageWork
from dgl_tasks.messages import Part


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
        watch = HoldWatch(work.hands, work.stage.hands)
        seen = (yield from work.hands.observe()).as_arrays()
        for _ in range(learned.chunks):
            targets = policy.act(seen)
            for number, target in enumerate(targets, start=1):
                yield from work.hands.execute(np.asarray(target)[None], recorded="stage")
                watch.note(target)
                seen = (yield from work.hands.observe()).as_arrays()
                if number < len(targets):
                    policy.observe(seen)
            work.react(watch.confirm(work.find_empty()))
