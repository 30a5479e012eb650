"""Writers of data sets."""

import importlib.util
import json
from collections.abc import Iterator, Mapping
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from dgl_collect.errors import MissingPackageError
from dgl_collect.exporting.export import Writer
from dgl_collect.exporting.origins import Origins
from dgl_collect.exporting.trajectory import Trajectory
from dgl_tasks.observation import CONTROL_FREQUENCY, STEPS_PER_ACTION

__all__ = ["FPS", "get_writer", "load_format", "write_robomimic", "write_zarr"]

GROUP = "dgl_collect.formats"
"""Entry points of formats that installed packages bring."""

FPS = CONTROL_FREQUENCY // STEPS_PER_ACTION
"""Frames a second."""


def write_zarr(folder: Path, trajectories: Iterator[Trajectory], source: Origins) -> None:
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


def write_robomimic(path: Path, trajectories: Iterator[Trajectory], source: Origins) -> None:
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


def get_writer(format_name: str) -> Writer:
    """Give the writer of a format: zarr, robomimic, or one that an installed package brings.

    Raises:
        MissingPackageError: If a package that the format needs is not installed.
    """
    if format_name == "zarr" and importlib.util.find_spec("zarr") is None:
        raise MissingPackageError("zarr", "dgl-collect[zarr]")
    if format_name in _WRITERS:
        return _WRITERS[format_name]
    return load_format(format_name).write


def load_format(name: str) -> Any:
    """Load the module of a format that an installed package brings, with `write` and `check`.

    Raises:
        MissingPackageError: If there is none.
    """
    found = [entry for entry in entry_points(group=GROUP) if entry.name == name]
    if not found:
        raise MissingPackageError(f"the format {name}", f"{name}_env_dexgarmentlab")
    return found[0].load()


_WRITERS: Mapping[str, Writer] = {"zarr": write_zarr, "robomimic": write_robomimic}
