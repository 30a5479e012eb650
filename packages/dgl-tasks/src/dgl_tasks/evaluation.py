"""One episode of a method, judged by the task's rule."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from dgl_tasks.driver import Driver, Listener
from dgl_tasks.env import GarmentEnv
from dgl_tasks.handling import Handling
from dgl_tasks.messages import Part
from dgl_tasks.motion import BimanualMotion
from dgl_tasks.policy import Method
from dgl_tasks.sensing import Sensed
from dgl_tasks.success import Verdict


@dataclass(frozen=True, kw_only=True, eq=False)
class EpisodeResult:
    """Outcome of an episode."""

    garment: str
    """Catalogue id, or the folder of an imported garment."""
    verdict: Verdict
    """The rule's result on ground truth at the end."""
    first_try: Verdict
    """Verdict before any retry; that of the end without a retry."""
    picture: np.ndarray
    """Picture at the end, shape (H, W, 3), uint8."""
    commands: np.ndarray
    """Joint targets of every control step of 1/60 s [rad], shape (S, D), float32."""
    measurements: Mapping[str, float]
    """Largest strain and penetration, and numbers of retries."""
    beliefs: Mapping[str, float]
    """The method's estimates, the last of each name."""
    draws: Mapping[str, object]
    """Every draw of the episode."""
    mishaps: tuple[tuple[str, str], ...] = ()
    """Mishaps on the way: reason and place."""

    @property
    def success(self) -> bool:
        """The task was done."""
        return self.verdict.success

    @property
    def reason(self) -> str | None:
        """Reason of a failure, in words that can be counted; a mishap precedes the verdict's."""
        if self.success or not self.mishaps:
            return self.verdict.reason
        return self.mishaps[0][0]

    @property
    def detail(self) -> str:
        """The reason with numbers; empty for a success."""
        if self.success:
            return ""
        parts = [where for _, where in self.mishaps[:1]]
        return "; ".join([*parts, self.verdict.describe_shortfalls()])


def plan_episode(motion: BimanualMotion, method: Method, sensed: Sensed) -> Part:
    """Plan a whole episode: arms park, the method acts, hands retreat, the garment comes to rest.

    Args:
        motion: Plans the arms.
        method: Acts in between.
        sensed: Snapshot after the reset.
    """
    hands = Handling(motion, sensed)
    yield from hands.park()
    yield from method.run(hands)
    if not hands.is_parked:
        yield from hands.retreat()
    yield from hands.settle()


def run_episode(
    env: GarmentEnv,
    motion: BimanualMotion,
    method: Method,
    *,
    seed: int,
    garment: str | None = None,
    film: Callable[[np.ndarray], None] | None = None,
    listener: Listener | None = None,
) -> EpisodeResult:
    """Run a method for one episode.

    The start depends on seed and garment alone, so that methods are compared on the same episodes.
    The verdict uses ground truth once the arms are parked; a garment in a hand is no success.

    Args:
        env: An environment that can render.
        motion: Plans its arms.
        method: One of `dgl_tasks.policy`, or your own.
        seed: Of the episode.
        garment: Catalogue id, or the folder of an imported garment; drawn from the seed when None.
        film: Receives pictures for people, shape (H, W, 3), uint8.
        listener: Receives commands and marks, such as a recorder.

    Raises:
        TaskError: If a goal is out of reach, or a camera sees no garment to be handled.
        PhysicsError: If the simulation fails.
        ValueError: If a policy gives no valid action.
    """
    driver = Driver(env, seed=seed, film=film, listener=listener)
    driver.drive(plan_episode(motion, method, driver.reset(garment)))
    verdict = env.judge()
    return EpisodeResult(
        garment=str(env.draws["garment"]),
        verdict=verdict,
        first_try=driver.first_try or verdict,
        picture=env.take_picture(env.task.picture_camera).rgb,
        commands=np.stack(driver.commands),
        measurements=dict(driver.measurements),
        beliefs=dict(driver.beliefs),
        draws=dict(env.draws),
        mishaps=tuple((reason, place) for _, reason, place in driver.mishaps),
    )
