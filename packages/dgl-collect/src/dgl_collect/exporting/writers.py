"""Writers of data sets, one for each format."""

import importlib.util
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from dgl_collect.errors import MissingPackageError
from dgl_collect.exporting.export import Source, Writer
from dgl_collect.exporting.trajectory import Trajectory
from dgl_tasks.observation import CONTROL_FREQUENCY, STEPS_PER_ACTION

__all__ = ["check_installed", "get_writer", "write_lerobot", "write_robomimic", "write_zarr"]

FPS = CONTROL_FREQUENCY // STEPS_PER_ACTION
"""Frames a second."""


def write_lerobot(folder: Path, trajectories: Iterator[Trajectory], source: Source) -> None:
    """Write a LeRobotDataset v3 with LeRobot's own writer."""
    from lerobot.datasets.lerobot_dataset import (  # pyright: ignore[reportMissingImports]
        LeRobotDataset,
    )

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
    """List the columns of a LeRobotDataset for trajectories like this one."""
    names = list(trajectory.names)
    features: dict[str, dict[str, object]] = {
        "observation.state": {"dtype": "float32", "shape": (len(names),), "names": names},
        "action": {"dtype": "float32", "shape": (len(names),), "names": names},
    }
    if len(trajectory.places):
        places = list(trajectory.place_names)
        features["observation.environment_state"] = {
            "dtype": "float32",
            "shape": (len(places),),
            "names": places,
        }
    if trajectory.cloud is not None:
        shape = trajectory.cloud.shape[1:]
        features["observation.workspace_cloud"] = {
            "dtype": "float32",
            "shape": shape,
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


def write_zarr(folder: Path, trajectories: Iterator[Trajectory], source: Source) -> None:
    """Write the replay buffer of Diffusion Policy and DP3, in zarr's format 2."""
    import zarr

    root = zarr.open_group(str(folder), mode="w")
    data: Any = root.create_group("data")
    meta: Any = root.create_group("meta")
    root.attrs.update({"task": source.task, "robot": source.robot, "fps": FPS})
    ends: list[int] = []
    for trajectory in trajectories:
        for name, values in _list_arrays(trajectory).items():
            if name not in data:
                chunk = max(1, min(len(values), 2**22 // max(values[:1].nbytes, 1)))
                data.create_dataset(
                    name,
                    shape=(0, *values.shape[1:]),
                    chunks=(chunk, *values.shape[1:]),
                    dtype=values.dtype,
                )
            data[name].append(values)
        ends.append((ends[-1] if ends else 0) + len(trajectory))
    meta.create_dataset("episode_ends", data=np.array(ends, dtype=np.int64))


def write_robomimic(path: Path, trajectories: Iterator[Trajectory], source: Source) -> None:
    """Write robomimic's HDF5 file."""
    with h5py.File(path, "w") as file:
        data, total = file.create_group("data"), 0
        for number, trajectory in enumerate(trajectories):
            demo = data.create_group(f"demo_{number}")
            demo.attrs["num_samples"] = len(trajectory)
            demo.attrs["success"] = trajectory.success
            arrays = _list_arrays(trajectory)
            demo["actions"] = arrays.pop("action")
            last = np.arange(len(trajectory)) == len(trajectory) - 1
            demo["dones"] = last.astype(np.int64)
            demo["rewards"] = (last & trajectory.success).astype(np.float64)
            demo["states"] = trajectory.state
            for name, values in arrays.items():
                demo.create_dataset(f"obs/{name}", data=values, compression="gzip")
                later = np.concatenate([values[1:], values[-1:]])
                demo.create_dataset(f"next_obs/{name}", data=later, compression="gzip")
            total += len(trajectory)
        data.attrs["total"] = total
        settings = {"control_mode": source.control_mode, "robot": source.robot}
        told = {"env_name": source.task, "type": 2, "env_kwargs": settings}  # 2: Gymnasium
        data.attrs["env_args"] = json.dumps(told)


def _list_arrays(trajectory: Trajectory) -> dict[str, np.ndarray]:
    """List the arrays of a trajectory with a row for each frame."""
    arrays = {
        "action": trajectory.action,
        "state": trajectory.state,
        "ee_pose": trajectory.ee_pose.reshape(len(trajectory), -1),
    }
    if len(trajectory.places):
        arrays["places"] = np.tile(trajectory.places, (len(trajectory), 1))
    if trajectory.cloud is not None:
        arrays["point_cloud"] = trajectory.cloud
    only = len(trajectory.images) == 1
    for camera, images in trajectory.images.items():
        arrays["img" if only else f"img_{camera}"] = images
    return arrays


_LIBRARIES = {"lerobot": ("lerobot", "lerobot_env_dexgarmentlab"), "zarr": ("zarr", "zarr<3")}
"""Module and requirement of the libraries that formats need."""


def get_writer(format_name: str) -> Writer:
    """Give the writer of a format: lerobot, zarr or robomimic."""
    return {"lerobot": write_lerobot, "zarr": write_zarr, "robomimic": write_robomimic}[format_name]


def check_installed(format_name: str) -> None:
    """Check that the library of a format is installed.

    Raises:
        MissingPackageError: If it is not.
    """
    for name, (module, requirement) in _LIBRARIES.items():
        if name == format_name and importlib.util.find_spec(module) is None:
            raise MissingPackageError(module, requirement)
