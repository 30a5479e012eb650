"""Data sets of LeRobot: written with its own writer, and checked in the evaluated environment."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from lerobot.datasets.lerobot_dataset import LeRobotDataset

from dgl_collect.exporting.origins import Origins, read_origins
from dgl_collect.exporting.trajectory import Trajectory
from dgl_collect.exporting.writers import FPS
from lerobot_env_dexgarmentlab.config import DexGarmentLabEnv

__all__ = ["CheckedEpisode", "check", "write"]


def write(folder: Path, trajectories: Iterator[Trajectory], source: Origins) -> None:
    """Write a LeRobotDataset v3.

    Args:
        folder: Must not exist.
        trajectories: The episodes.
        source: Their origin.
    """
    dataset: Any = None
    for trajectory in trajectories:
        if dataset is None:
            dataset = LeRobotDataset.create(
                repo_id=f"dexgarmentlab/{source.task}",
                fps=FPS,
                features=list_features(trajectory),
                root=folder,
                robot_type=source.robot,
                use_videos=True,
            )
        for k in range(len(trajectory)):
            dataset.add_frame(_get_frame(trajectory, k))
        dataset.save_episode()
    dataset.finalize()


def list_features(trajectory: Trajectory) -> dict[str, dict[str, object]]:
    """List the columns of a data set for trajectories like this one."""
    names, places = list(trajectory.names), list(trajectory.place_names)
    vectors = {"observation.state": names, "action": names}
    if places:
        vectors["observation.environment_state"] = places
    features: dict[str, dict[str, object]] = {
        key: {"dtype": "float32", "shape": (len(each),), "names": each}
        for key, each in vectors.items()
    }
    if trajectory.cloud is not None:
        features["observation.workspace_cloud"] = {
            "dtype": "float32",
            "shape": trajectory.cloud.shape[1:],
            "names": None,
        }
    for camera, images in trajectory.images.items():
        features[f"observation.images.{camera}"] = {
            "dtype": "video",
            "shape": images.shape[1:],
            "names": ["height", "width", "channels"],
        }
    return features


def _get_frame(trajectory: Trajectory, k: int) -> dict[str, object]:
    frame: dict[str, object] = {
        "observation.state": trajectory.state[k],
        "action": trajectory.action[k],
        "task": trajectory.instruction,
    }
    if len(trajectory.places):
        frame["observation.environment_state"] = trajectory.places
    if trajectory.cloud is not None:
        frame["observation.workspace_cloud"] = trajectory.cloud[k]
    for camera, images in trajectory.images.items():
        frame[f"observation.images.{camera}"] = images[k]
    return frame


@dataclass(frozen=True, kw_only=True)
class CheckedEpisode:
    """Verdicts of an episode."""

    index: int
    """Number in the data set."""
    recorded: bool
    """Success of the record."""
    reached: bool
    """Success in the evaluated environment."""
    actions: int
    """Actions that were sent."""


def check(
    folder: Path, *, episodes: int | None = None, on_episode: Callable[[], None] | None = None
) -> list[CheckedEpisode]:
    """Send the actions of a data set through the environment that `lerobot-eval` evaluates in.

    After its last action, an episode goes on as one of a policy that has nothing more to do.

    Args:
        folder: A data set of `write`, of episodes instead of stages.
        episodes: The first so many; all when None.
        on_episode: Called after each.

    Raises:
        ValueError: If the folder holds no data set of ours, or one of stages.
    """
    origins: Origins = read_origins(folder)
    if origins.content == "stages":
        raise ValueError(
            f"{folder} must hold episodes, whole or grasped; it holds {origins.content}"
        )
    dataset = LeRobotDataset(repo_id=f"dexgarmentlab/{origins.task}", root=folder)
    rows: Any = dataset.hf_dataset.select_columns(["episode_index", "action"]).with_format("numpy")
    numbers, actions = np.asarray(rows["episode_index"]), np.asarray(rows["action"])
    config = DexGarmentLabEnv(
        task=origins.task,
        control_mode=origins.control_mode,
        look=origins.look,
        matcher=origins.matcher,
        start="grasped" if origins.content == "grasped" else "parked",
        cameras="",
        episode_length=max(np.bincount(numbers)) + 1,
    )
    (vector,) = config.create_envs(1)["dexgarmentlab"].values()
    found = []
    for index, origin in enumerate(origins.episodes[:episodes]):
        vector.reset(seed=[origin.seed], options={"garment": origin.garment})
        reached, is_over, count = False, False, 0
        sent = actions[numbers == index]
        while not reached and not is_over:
            action = sent[min(count, len(sent) - 1)]  # the last one until the episode's length
            *_, ended, cut, _ = vector.step(action[None])
            reached, is_over = bool(ended[0]), bool(cut[0])
            count += 1
        found.append(
            CheckedEpisode(index=index, recorded=origin.success, reached=reached, actions=count)
        )
        if on_episode is not None:
            on_episode()
    vector.close()
    return found
