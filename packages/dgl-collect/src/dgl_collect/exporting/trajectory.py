"""A trajectory: the frames of one exported episode, and its file."""

import io
import json
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from dgl_files.whole import write_bytes

__all__ = ["Trajectory", "read_trajectory", "write_trajectory"]

_CAMERA = "image/"


@dataclass(frozen=True, kw_only=True, eq=False)
class Trajectory:
    """Frames of one episode at 12 Hz; observations are taken before their action. World frame."""

    instruction: str
    """The task in words, for policies that read."""
    success: bool
    """The rule was met at the end."""
    seed: int
    """Seed of the episode."""
    garment: str
    """Id of its garment."""
    names: tuple[str, ...]
    """Names of the numbers of a state and an action."""
    state: np.ndarray
    """Measured joints in the form of an action, shape (T, A), float32."""
    action: np.ndarray
    """Action of the control mode, shape (T, A), float32."""
    ee_pose: np.ndarray
    """Left and right end effector, xyz [m] and wxyz, shape (T, 2, 7), float32."""
    place_names: tuple[str, ...] = ()
    """Names of the coordinates in `places`."""
    places: np.ndarray
    """Matched points of the garment at the start, and frames of the objects [m], shape (E,)."""
    cloud: np.ndarray | None = None
    """Environment clouds, shape (T, 2048, 6), float32."""
    images: Mapping[str, np.ndarray] = field(default_factory=dict)
    """Pictures by camera, shape (T, H, W, 3), uint8."""

    def __len__(self) -> int:
        """Count the frames."""
        return len(self.state)


def write_trajectory(path: Path, trajectory: Trajectory) -> None:
    """Write a trajectory to HDF5, whole or not at all."""
    content = io.BytesIO()
    with h5py.File(content, "w") as file:
        for item in fields(trajectory):
            value = getattr(trajectory, item.name)
            if isinstance(value, np.ndarray):
                file[item.name] = value
            elif item.name != "images" and value is not None:
                file.attrs[item.name] = json.dumps(value)
        for camera, frames in trajectory.images.items():
            file.create_dataset(
                _CAMERA + camera,
                data=frames,
                chunks=(1, *frames.shape[1:]),
                compression="gzip",
                compression_opts=1,
            )
    write_bytes(path, content.getvalue())


def read_trajectory(path: Path) -> Trajectory:
    """Read a trajectory that `write_trajectory` wrote."""
    with h5py.File(path) as file:
        values: dict = {name: json.loads(str(text)) for name, text in file.attrs.items()}
        arrays = {name: node[()] for name, node in file.items() if isinstance(node, h5py.Dataset)}
        images: Any = file.get(_CAMERA.rstrip("/"), {})
        found = {str(name): images[name][()] for name in images}
    values |= {name: tuple(values[name]) for name in ("names", "place_names")}
    return Trajectory(images=found, **values, **arrays)
