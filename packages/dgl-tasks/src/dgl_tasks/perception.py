"""Point clouds from pictures, in the world frame."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dgl_physics.drawing.rasteriser import Picture
from dgl_tasks.cameras import (
    Workspace,
    farthest_point_sample,
    is_in_workspace,
)
from dgl_tasks.errors import PerceptionError

CLOUD_SIZE = 2048
"""Points of a cloud, after farthest-point sampling."""


@dataclass(frozen=True, kw_only=True)
class Segments:
    """Segmentation ids of what pictures show."""

    garment: int
    robot: tuple[int, ...]
    """Ids of the robot's links."""
    objects: Mapping[str, int]
    """Ids of the objects, by name."""


def get_garment_points(picture: Picture, segments: Segments) -> np.ndarray:
    """Return all points of the garment in a picture [m], shape (N, 3).

    Raises:
        PerceptionError: If the garment is not in the picture.
    """
    return _select(picture, [segments.garment], "the garment")


def get_garment_cloud(picture: Picture, segments: Segments, *, seed: int) -> np.ndarray:
    """Sample the garment's cloud [m], shape (2048, 3), float32; see `get_garment_points`."""
    points = get_garment_points(picture, segments)
    return points[farthest_point_sample(points, CLOUD_SIZE, seed=seed)].astype(np.float32)


def get_object_cloud(picture: Picture, segments: Segments, *, seed: int) -> np.ndarray:
    """Sample the cloud of the scene's objects [m], shape (2048, 3), float32.

    Raises:
        PerceptionError: If none of them is in the picture.
    """
    objects = segments.objects
    points = _select(picture, list(objects.values()), ", ".join(objects) or "objects")
    return points[farthest_point_sample(points, CLOUD_SIZE, seed=seed)].astype(np.float32)


def get_environment_cloud(
    picture: Picture, segments: Segments, workspace: Workspace, *, seed: int
) -> np.ndarray:
    """Sample the coloured cloud of garment and objects, xyz and rgb in [0, 1], shape (2048, 6).

    It is cropped to the workspace and leaves out the robot, whose joints are known: the robot would
    take four fifths of the points. The ground is left out by its height, except under a garment.

    Raises:
        PerceptionError: If there is nothing but robot and ground inside the workspace.
    """
    points = picture.points.reshape(-1, 3)
    ids = picture.segments.reshape(-1)
    is_garment = ids == segments.garment
    # most of a picture is ground
    index = np.flatnonzero((points[:, 2] >= workspace.low[2]) | is_garment)
    is_seen = ~np.isin(ids[index], segments.robot)
    is_seen &= is_in_workspace(points[index], workspace)
    with_ground = replace(workspace, low=(*workspace.low[:2], -np.inf))
    is_seen |= is_garment[index] & is_in_workspace(points[index], with_ground)
    index = index[is_seen]
    if len(index) == 0:
        raise PerceptionError("the camera sees nothing but the robot inside the workspace")
    index = index[farthest_point_sample(points[index], CLOUD_SIZE, seed=seed)]
    rgb = picture.rgb.reshape(-1, 3)[index] / np.float32(255)
    return np.concatenate([points[index], rgb], axis=1).astype(np.float32)


def _select(picture: Picture, ids: Sequence[int], name: str) -> np.ndarray:
    points = picture.points[np.isin(picture.segments, ids) & np.isfinite(picture.points[..., 2])]
    if len(points) == 0:
        raise PerceptionError(f"the camera sees nothing of {name}")
    return points
