"""The evaluation loop: one episode of a policy, judged by the task's own rule."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from dgl_tasks.driver import Driver, Judgement
from dgl_tasks.env import GarmentEnv
from dgl_tasks.motion import BimanualMotion
from dgl_tasks.policy import EpisodePolicy


@dataclass(frozen=True, kw_only=True)
class EpisodeResult:
    """How an episode ended."""

    garment: str
    """Catalogue id."""
    judgement: Judgement
    """Verdict, and whether the garment lies still and is let go."""
    steps: int
    """Control steps of 1/60 s, those that are scripted included."""
    measurements: Mapping[str, float]
    """Largest strain and penetration."""
    draws: Mapping[str, object]
    """Every draw of the episode."""
    events: tuple[tuple[str, str], ...] = ()
    """What the method saw going wrong on the way: a reason that can be counted, and where."""

    @property
    def success(self) -> bool:
        """Whether the task was done."""
        return self.judgement.reason is None

    @property
    def reason(self) -> str | None:
        """Why it was not, in words that can be counted: the first event, if there is one."""
        if self.success or not self.events:
            return self.judgement.reason
        return self.events[0][0]


def run_episode(
    env: GarmentEnv,
    motion: BimanualMotion,
    policy: EpisodePolicy,
    *,
    seed: int,
    garment: str | None = None,
    film: Callable[[np.ndarray], None] | None = None,
) -> EpisodeResult:
    """Run a policy for one episode.

    The start depends on seed and garment alone, so that methods are compared on the same episodes.
    The places that the rule names are the true ones, whatever the method believes; the arms are
    parked when the garment is judged, and what a hand still holds is no success.

    Args:
        env: An environment that can render.
        motion: Plans its arms.
        policy: Acts; see `dgl_tasks.policy`.
        seed: Of the episode.
        garment: Catalogue id; drawn from the seed when None.
        film: Receives pictures for people, shape (H, W, 3), uint8.

    Raises:
        TaskError: If a hand cannot go where the policy sends it, or a camera sees no garment to be handled.
        PhysicsError: If the simulation fails.
        ValueError: If the policy gives something that is no action.
    """
    driver = Driver(env, motion, seed=seed, film=film)
    driver.start(garment)
    policy.run(driver)
    if not driver.is_parked:
        driver.retreat()
    driver.settle()
    return EpisodeResult(
        garment=env.garment.name,
        judgement=driver.judge(),
        steps=driver.step_count,
        measurements=dict(driver.measurements),
        draws=dict(env.draws),
        events=tuple(driver.events),
    )
