"""Replay of an episode: its commands once more, compared with the record."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from dgl_collect.episodes import FINAL_PARTICLES, Episode, StageRecord
from dgl_collect.errors import NotReplayableError
from dgl_collect.options import RunOptions
from dgl_tasks import get_task
from dgl_tasks.messages import Command, Mark
from dgl_tasks.observation import STEPS_PER_ACTION
from dgl_tasks.sensing import SENSOR_CAMERAS

if TYPE_CHECKING:
    from dgl_tasks.env import GarmentEnv
    from dgl_tasks.sensing import Sensed

_UNITS = {
    "joint_state": "rad",
    "action": "rad",
    "ee_pose": "m",
    "env_point_cloud": "m",
    "garment_point_cloud": "m",
    "object_point_cloud": "m",
    FINAL_PARTICLES: "m",
}
_PICTURES = ("image", "env_point_cloud", "garment_point_cloud", "object_point_cloud")


@dataclass(frozen=True, kw_only=True)
class Difference:
    """Difference between a recorded array and the replay's."""

    name: str
    """Key of the array in the episode file."""
    count: int
    """Numbers compared."""
    largest: float
    """Largest absolute difference; infinite where the shapes differ."""
    unit: str
    """Its unit; poses and coloured clouds also hold numbers without a unit."""


@dataclass(frozen=True, kw_only=True)
class Replay:
    """Result of a replay."""

    task: str
    """Environment id."""
    seed: int
    """Seed of the episode."""
    garment_id: str
    """The garment."""
    steps: int
    """Control steps that were replayed."""
    differences: tuple[Difference, ...]
    """By array, in the order of the file."""
    changed_draws: Mapping[str, tuple[object, object]]
    """Draws that differ: name to recorded and replayed value."""
    recorded: tuple[bool, float]
    """Success and value of the rule, as recorded."""
    replayed: tuple[bool, float]
    """Success and value of the rule, of the replay."""

    def reproduces(self, tolerance: float = 0.0) -> bool:
        """Tell if the replay equals the record.

        Args:
            tolerance: Largest allowed difference of joints [rad], poses and particles [m], and of
                the rule's value. At 0, the default, pictures and clouds must be equal as well, bit
                for bit; above 0 they are not compared, since one pixel can change a cloud.

        Raises:
            ValueError: If the tolerance is negative or not finite.
        """
        if not (math.isfinite(tolerance) and tolerance >= 0):
            raise ValueError(f"tolerance must be at least 0; got {tolerance}")
        compared = [d for d in self.differences if tolerance == 0 or d.name not in _PICTURES]
        return (
            not self.changed_draws
            and self.recorded[0] == self.replayed[0]
            and abs(self.recorded[1] - self.replayed[1]) <= tolerance
            and all(d.largest <= tolerance for d in compared)
        )


def replay_episode(
    episode: Episode,
    *,
    options: RunOptions | None = None,
    film: Callable[[np.ndarray], None] | None = None,
    on_step: Callable[[int], None] | None = None,
) -> Replay:
    """Send the commands of an episode to a new environment of its seed and garment, and compare.

    Matcher and planner take no part: garment, robot, simulation, cameras and rule are tested. Every
    recorded array but the affordance is compared. On the recording machine, with the same packages,
    all are equal bit for bit. Elsewhere rounding differs, and cloth amplifies small differences.

    Args:
        episode: The record.
        options: `robots`, `render_backend` and `control_mode`; everything else is as the episode
            says.
        film: Receives pictures for people, shape (H, W, 3), uint8.
        on_step: Called after each control step with the number of steps so far.

    Raises:
        NotReplayableError: If the episode does not hold its commands.
        AssetError: If its robot or garment does not exist.
        PhysicsError: If the simulation fails.
    """
    from dgl_collect.setup import make_env

    _check_replayable(episode)
    options = replace(
        options or RunOptions(),
        garment=episode.garment_id,
        robot=episode.robot,
        look="random" if "floor" in episode.randomisation else "studio",
        cloud=episode.cloud,
    )
    env = make_env(get_task(episode.task), options)
    try:
        return replay_in(env, episode, film=film, on_step=on_step)
    finally:
        env.close()


def replay_in(
    env: "GarmentEnv",
    episode: Episode,
    *,
    film: Callable[[np.ndarray], None] | None = None,
    on_step: Callable[[int], None] | None = None,
) -> Replay:
    """Replay in an environment of the episode's task, robot, look, cloud; see `replay_episode`."""
    from dgl_tasks.driver import Driver

    commands = _check_replayable(episode)
    comparison = _Comparison(episode)
    driver = Driver(env, seed=episode.seed, film=film, listener=comparison)
    driver.reset(episode.garment_id)
    for number, row in enumerate(commands, start=1):
        driver.step(Command(row))
        if on_step is not None:
            on_step(number)
    comparison.compare_end(np.stack(driver.commands), env.get_particles())
    verdict = env.judge()
    recorded, draws = episode.randomisation, env.draws
    return Replay(
        task=episode.task,
        seed=episode.seed,
        garment_id=episode.garment_id,
        steps=len(commands),
        differences=tuple(comparison.differences.values()),
        changed_draws={
            name: (recorded.get(name), draws.get(name))
            for name in {**recorded, **draws}
            if recorded.get(name) != draws.get(name)
        },
        recorded=(episode.success, episode.success_value),
        replayed=(verdict.success, verdict.value),
    )


class _Comparison:
    """Looks where the recorder looked, and keeps the largest differences."""

    def __init__(self, episode: Episode) -> None:
        self._episode = episode
        self.differences: dict[str, Difference] = {}
        self._frames: dict[int, tuple[StageRecord, int]] = {}
        self._clouds: dict[int, StageRecord] = {}
        for stage in episode.stages:
            assert stage.first_step is not None
            assert stage.cloud_step is not None
            self._clouds[stage.cloud_step] = stage
            for k in range(stage.frame_count):
                self._frames[stage.first_step + k * STEPS_PER_ACTION] = (stage, k)

    def before_step(self, command: Command, look: Callable[..., "Sensed"]) -> None:
        del command
        step = look().step
        if step not in self._clouds and step not in self._frames:
            return
        sensed = look(*SENSOR_CAMERAS)
        if step in self._clouds:
            stage = self._clouds[step]
            self._compare("garment_point_cloud", stage.garment_point_cloud, sensed.see_garment())
            if stage.object_point_cloud is not None:
                self._compare("object_point_cloud", stage.object_point_cloud, sensed.see_objects())
        if step in self._frames:
            stage, k = self._frames[step]
            seen = sensed.observe()
            for name in ("joint_state", "ee_pose", "image", "env_point_cloud"):
                self._compare(name, getattr(stage, name)[k], getattr(seen, name))

    def note(self, mark: Mark, sensed: "Sensed") -> None:
        """Nothing is marked in a replay."""

    def compare_end(self, commands: np.ndarray, particles: np.ndarray) -> None:
        """Compare recorded actions with the commands, and the final particles."""
        for step, (stage, k) in self._frames.items():
            held = commands[step : step + STEPS_PER_ACTION]
            row = held[-1]
            if k == stage.frame_count - 1:  # it may have ended before its fifth step
                row = held[np.abs(held - stage.action[k]).max(axis=1).argmin()]
            self._compare("action", stage.action[k], row)
        recorded = self._episode.extra[FINAL_PARTICLES]
        self._compare(FINAL_PARTICLES, recorded, particles.astype(np.float32))

    def _compare(self, name: str, recorded: np.ndarray, replayed: np.ndarray) -> None:
        largest = math.inf
        if recorded.shape == replayed.shape:
            largest = float(np.abs(recorded.astype(float) - replayed.astype(float)).max())
        before = self.differences.get(name)
        self.differences[name] = Difference(
            name=name,
            count=recorded.size + (before.count if before else 0),
            largest=max(largest, before.largest if before else 0.0),
            unit=_UNITS.get(name, "levels"),
        )


def _check_replayable(episode: Episode) -> np.ndarray:
    commands = episode.commands
    if commands is None:
        raise NotReplayableError(
            "the episode must hold its commands; this one was recorded before they were kept: "
            "collect it again"
        )
    if FINAL_PARTICLES not in episode.extra:
        raise NotReplayableError(f"the episode must hold extra/{FINAL_PARTICLES}; it does not")
    for stage in episode.stages:
        if stage.first_step is None or stage.cloud_step is None:
            raise NotReplayableError(f"stage {stage.name!r} must say when it was seen; it does not")
        last = stage.first_step + (stage.frame_count - 1) * STEPS_PER_ACTION
        if last >= len(commands):
            raise NotReplayableError(
                f"commands must reach step {last} of stage {stage.name!r}; got {len(commands)}"
            )
    return commands
