"""Point clouds from pictures, in the world frame."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from dgl_files.fields import check_value
from dgl_physics.drawing.rasteriser import Picture
from dgl_tasks.cameras import (
    Workspace,
    farthest_point_sample,
    is_in_workspace,
)
from dgl_tasks.errors import PerceptionError

CLOUD_SIZE = 2048
"""Points of a cloud, after farthest-point sampling."""

CloudKind = Literal["segmented", "scene"]
"""Environment clouds: `segmented` has garment and objects alone; `scene` has all in the workspace,
which ends 5 mm above the ground, the robot included."""


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
    picture: Picture,
    segments: Segments,
    workspace: Workspace,
    *,
    kind: CloudKind = "segmented",
    seed: int,
) -> np.ndarray:
    """Sample the coloured cloud of the workspace, xyz [m] and rgb in [0, 1], shape (2048, 6).

    A segmented cloud leaves out the robot, whose joints are known: the robot would take four fifths
    of the points. The ground is left out by its height, except under a garment. The cloud of the
    scene is cropped to the workspace and nothing else.

    Args:
        picture: Of the environment camera.
        segments: Its segmentation ids.
        workspace: Box that the cloud is cropped to.
        kind: What the cloud shows.
        seed: Of the sampling.

    Raises:
        PerceptionError: If nothing that the cloud shows is in the picture.

    Source:
        Scene: DexGarmentLab's code, which drops points up to 5 mm high.
    """
    check_value("kind", kind, CloudKind)
    points = picture.points.reshape(-1, 3)
    if kind == "scene":
        index = np.flatnonzero(is_in_workspace(points, workspace))
    else:
        index = _find_segmented(points, picture.segments.reshape(-1), segments, workspace)
    if len(index) == 0:
        seen = "nothing but the robot" if kind == "segmented" else "nothing"
        raise PerceptionError(f"the camera sees {seen} inside the workspace")
    index = index[farthest_point_sample(points[index], CLOUD_SIZE, seed=seed)]
    rgb = picture.rgb.reshape(-1, 3)[index] / np.float32(255)
    return np.concatenate([points[index], rgb], axis=1).astype(np.float32)


def _find_segmented(
    points: np.ndarray, ids: np.ndarray, segments: Segments, workspace: Workspace
) -> np.ndarray:
    """Find garment and objects among points (N, 3) with segmentation ids (N,); gives indices."""
    is_garment = ids == segments.garment
    # most of a picture is ground
    index = np.flatnonzero((points[:, 2] >= workspace.low[2]) | is_garment)
    is_seen = ~np.isin(ids[index], segments.robot)
    is_seen &= is_in_workspace(points[index], workspace)
    with_ground = replace(workspace, low=(*workspace.low[:2], -np.inf))
    is_seen |= is_garment[index] & is_in_workspace(points[index], with_ground)
    return index[is_seen]


def _select(picture: Picture, ids: Sequence[int], name: str) -> np.ndarray:
    points = picture.points[np.isin(picture.segments, ids) & np.isfinite(picture.points[..., 2])]
    if len(points) == 0:
        raise PerceptionError(f"the camera sees nothing of {name}")
    return points
