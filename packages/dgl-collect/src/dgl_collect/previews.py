"""First and last pictures of an episode, and its small arrays, read quickly."""

from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np

from dgl_collect.episodes import Points, opened_episode, read_stage_names, take
from dgl_files.fields import check_value, decode_json


@dataclass(frozen=True, kw_only=True, eq=False)
class StagePreview:
    """The small part of a stage; see `StageRecord` for units and frames."""

    name: str
    first_image: np.ndarray
    """Image of the first frame, shape (480, 640, 3), uint8."""
    last_image: np.ndarray
    """Image of the last frame, shape (480, 640, 3), uint8."""
    ee_pose: np.ndarray
    """End-effector poses of all T frames, shape (T, 2, 7)."""
    garment_point_cloud: np.ndarray
    """The garment when the stage begins [m], shape (2048, 3)."""
    points_affordance_feature: np.ndarray
    """Affordance for the left and the right hand, shape (2048, 2)."""
    points: Points
    """The points found on the garment."""


def read_previews(path: Path | str) -> tuple[StagePreview, ...]:
    """Read the small part of every stage, some fifteen times faster than the whole episode.

    Args:
        path: An episode file. Only what is read is checked; `read_episode` checks everything.

    Raises:
        FileNotFoundError, FileUnavailableError, CorruptEpisodeError: As `read_episode`.
    """
    with opened_episode(path) as file:
        count = len(read_stage_names(file))
        return tuple(_read_preview(take(file, f"stage_{k + 1}", h5py.Group)) for k in range(count))


def _read_preview(group: h5py.Group) -> StagePreview:
    def read(name: str, which: object = ()) -> np.ndarray:
        return take(group, name, h5py.Dataset)[which]

    points = decode_json(str(group.attrs["points"]))
    check_value("points", points, Points)
    return StagePreview(
        name=str(group.attrs["name"]),
        first_image=read("image", 0),
        last_image=read("image", -1),
        ee_pose=read("ee_pose"),
        garment_point_cloud=read("garment_point_cloud"),
        points_affordance_feature=read("points_affordance_feature"),
        points=points,
    )
