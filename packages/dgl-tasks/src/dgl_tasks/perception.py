"""What the cameras see, as arrays: pictures and point clouds in the world frame."""

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from dgl_physics.drawing.rasteriser import Picture
from dgl_tasks.cameras import farthest_point_sample, is_in_workspace
from dgl_tasks.errors import PerceptionError

if TYPE_CHECKING:
    from dgl_tasks.env import GarmentEnv

CLOUD_SIZE = 2048
"""Points of a cloud, after farthest-point sampling."""


def take_picture(env: "GarmentEnv", camera: str) -> Picture:
    """Draw what one camera of the task sees.

    Raises:
        ValueError: If the task has no such camera.
    """
    cameras = env.task.cameras
    if camera not in cameras:
        raise ValueError(f"camera must be one of {sorted(cameras)}; got {camera!r}")
    return env.get_painter().draw_picture(cameras[camera])


def film(env: "GarmentEnv") -> np.ndarray:
    """Draw what the camera for people sees, shape (H, W, 3), uint8."""
    return env.get_painter().draw(env.task.cameras["video_camera"])


def get_garment_points(env: "GarmentEnv", picture: Picture) -> np.ndarray:
    """Return all points of the garment in a picture [m], shape (N, 3).

    Raises:
        PerceptionError: If the garment is not in the picture.
    """
    mask = (picture.segments == env.garment_segment) & np.isfinite(picture.points[..., 2])
    points = picture.points[mask]
    if len(points) == 0:
        raise PerceptionError("the camera sees nothing of the garment")
    return points


def get_garment_cloud(env: "GarmentEnv", picture: Picture, *, seed: int) -> np.ndarray:
    """Sample the garment's cloud, shape (2048, 3), float32."""
    points = get_garment_points(env, picture)
    return points[farthest_point_sample(points, CLOUD_SIZE, seed=seed)].astype(np.float32)


def get_object_cloud(
    env: "GarmentEnv", picture: Picture, *, seed: int, names: Sequence[str] | None = None
) -> np.ndarray:
    """Sample the cloud of the scene's objects, shape (2048, 3), float32.

    Args:
        env: The environment.
        picture: What a camera sees.
        seed: Of the sampling.
        names: Only these objects; all of the task when None.

    Raises:
        ValueError: If there is no such object.
        PerceptionError: If none of them is in the picture.
    """
    wanted = list(env.objects) if names is None else list(names)
    unknown = sorted(set(wanted) - set(env.objects))
    if unknown or not wanted:
        raise ValueError(f"names must be some of {sorted(env.objects)}; got {unknown or wanted}")
    segments = [env.objects[name].segment for name in wanted]
    mask = np.isin(picture.segments, segments) & np.isfinite(picture.points[..., 2])
    points = picture.points[mask]
    if len(points) == 0:
        raise PerceptionError(f"the camera sees nothing of {', '.join(wanted)}")
    return points[farthest_point_sample(points, CLOUD_SIZE, seed=seed)].astype(np.float32)


def get_environment_cloud(env: "GarmentEnv", picture: Picture, *, seed: int) -> np.ndarray:
    """Sample the coloured cloud of what the robot works on, xyz and rgb in [0, 1], shape (2048, 6).

    It is cropped to the workspace. The robot is left out, whose joints are known: of points spread evenly over all that is
    seen it would have four fifths, and a policy that looks at some of them would see hardly anything of the cloth. So is
    the ground, by its height, but not a garment that lies flat on it.

    Raises:
        PerceptionError: If there is nothing but robot and ground inside the workspace.
    """
    points = picture.points.reshape(-1, 3)
    segments = picture.segments.reshape(-1)
    workspace = env.task.workspace
    is_garment = segments == env.garment_segment
    # most of a picture is ground
    index = np.flatnonzero((points[:, 2] >= workspace.low[2]) | is_garment)
    is_seen = ~np.isin(segments[index], env.robot_segments)
    is_seen &= is_in_workspace(points[index], workspace)
    with_ground = replace(workspace, low=(*workspace.low[:2], -np.inf))
    is_seen |= is_garment[index] & is_in_workspace(points[index], with_ground)
    index = index[is_seen]
    if len(index) == 0:
        raise PerceptionError("the camera sees nothing but the robot inside the workspace")
    index = index[farthest_point_sample(points[index], CLOUD_SIZE, seed=seed)]
    rgb = picture.rgb.reshape(-1, 3)[index] / np.float32(255)
    return np.concatenate([points[index], rgb], axis=1).astype(np.float32)


def find_pixel(env: "GarmentEnv", camera: str, point: np.ndarray) -> tuple[float, float]:
    """Project a world point [m], shape (3,), to (column, row) of a camera's picture."""
    placement = env.task.cameras[camera]
    to_camera = np.linalg.inv(placement.transform_camera_to_world)
    x, y, z = to_camera[:3, :3] @ np.asarray(point, dtype=float) + to_camera[:3, 3]
    u, v, w = placement.intrinsics @ np.array([x, y, z])
    return float(u / w), float(v / w)
