"""Shots of an episode: particles, bodies and criteria of each frame, by replay, once."""

import hashlib
import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from safetensors import safe_open
from safetensors.numpy import save

from dgl_collect.errors import NotReplayableError
from dgl_files.whole import write_bytes
from dgl_tasks.driver import Driver
from dgl_tasks.messages import Command
from dgl_tasks.observation import STEPS_PER_ACTION

if TYPE_CHECKING:
    from dgl_collect.episodes import Episode
    from dgl_tasks.env import GarmentEnv

__all__ = ["Shots", "find_shots", "take_shots"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Shots:
    """Visible state of an episode, every fifth control step."""

    particles: np.ndarray
    """[m], shape (N, V, 3), float32, world frame."""
    poses: np.ndarray
    """Poses of the bodies, shape (N, B, 7), float32."""
    criteria: np.ndarray
    """Values of the rule's criteria, shape (N, C), float32."""
    names: tuple[str, ...]
    """Names of the criteria, with their thresholds."""


def take_shots(
    episode: "Episode", env: "GarmentEnv", on_step: Callable[[int], None] | None = None
) -> Shots:
    """Replay an episode, and keep what can be seen.

    Args:
        episode: The record.
        env: Environment of its task, robot, look and cloud; it is reset.
        on_step: Called with the number of control steps so far.

    Raises:
        NotReplayableError: If the episode does not hold its commands.
    """
    if episode.commands is None:
        raise NotReplayableError(
            "the episode must hold its commands; this one was recorded before they were kept: "
            "collect it again"
        )
    driver = Driver(env, seed=episode.seed)
    driver.reset(episode.garment_id)
    env.list_rigid_meshes()  # numbers the bodies
    seen: list[tuple[np.ndarray, np.ndarray, list[float]]] = []
    names: tuple[str, ...] = ()
    for step, row in enumerate([*episode.commands, None]):
        if step % STEPS_PER_ACTION == 0 or row is None:
            verdict = env.judge()
            names = tuple(f"{c.name} {c.comparison} {c.threshold:g}" for c in verdict.criteria)
            values = [float(c.value) for c in verdict.criteria]
            seen.append((env.get_particles(), env.get_body_poses(), values))
        if row is not None:
            driver.step(Command(row))
        if on_step is not None:
            on_step(step)
    particles, poses, criteria = (np.array(each, np.float32) for each in zip(*seen, strict=True))
    return Shots(particles=particles, poses=poses, criteria=criteria, names=names)


def find_shots(path: Path, folder: Path, take: Callable[[], Shots]) -> Shots:
    """Read the shots of an episode file from a cache, or take and keep them.

    Args:
        path: The episode file; its content is the key.
        folder: The cache.
        take: Takes the shots.
    """
    file = folder / f"{hashlib.sha256(path.read_bytes()).hexdigest()[:32]}.safetensors"
    if file.is_file():
        with safe_open(file, "numpy") as stored:
            arrays = {name: stored.get_tensor(name) for name in stored.keys()}  # noqa: SIM118
            names = tuple(json.loads(stored.metadata()["names"]))
        return Shots(names=names, **arrays)
    shots = take()
    arrays = {name: getattr(shots, name) for name in ("particles", "poses", "criteria")}
    folder.mkdir(parents=True, exist_ok=True)
    write_bytes(file, save(arrays, metadata={"names": json.dumps(shots.names)}))
    return shots
