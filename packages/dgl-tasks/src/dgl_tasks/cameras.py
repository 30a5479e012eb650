"""Placement of cameras, workspace, and sampling of point clouds.

A camera pose looks along its +X with +Z up, as SAPIEN's do. Importing this module does not import a
simulator; only `CameraPlacement.build` does.
"""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Annotated

import fpsample
import numpy as np
from pydantic import AllowInfNan
from scipy.spatial.transform import Rotation

from dgl_files.fields import adopt_fields
from dgl_physics.drawing.camera import Axes, PinholeCamera, Vector3
from dgl_tasks.rotations import to_quaternion

if TYPE_CHECKING:
    from mani_skill.sensors.camera import CameraConfig

HORIZONTAL_FOV = 2 * np.arctan(20.955 / 2 / 50.0)
"""Field of view [rad], 23.7 degrees: aperture 20.955 at focal length 50 (original code)."""

Bound = Annotated[float, AllowInfNan(True)]
"""Side of a box that may be open."""

_TREE_HEIGHT = 5
"""Levels of the bucket tree for farthest points; the fastest for clouds of pictures."""
_OPENCV_TO_SAPIEN = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])


@dataclass(frozen=True, kw_only=True)
class CameraPlacement(PinholeCamera):
    """A named camera."""

    name: str
    euler_deg: Vector3
    """Roll, pitch, yaw [degrees], R = Rz(yaw) Ry(pitch) Rx(roll); pitch 90 looks straight down."""
    axes: Axes = field(init=False, repr=False)
    horizontal_fov: float = float(HORIZONTAL_FOV)

    def __post_init__(self) -> None:
        adopt_fields(self)
        super().__post_init__()
        columns = (self._rotation.as_matrix() @ _OPENCV_TO_SAPIEN).T.tolist()
        object.__setattr__(self, "axes", tuple(tuple(column) for column in columns))

    @property
    def _rotation(self) -> Rotation:
        return Rotation.from_euler("xyz", self.euler_deg, degrees=True)

    @property
    def quaternion(self) -> np.ndarray:
        """Orientation wxyz, shape (4,): +X is the optical axis, +Z is up in the picture."""
        return to_quaternion(self._rotation)

    def build(self) -> "CameraConfig":
        """Make ManiSkill's configuration of this camera."""
        import torch
        from mani_skill.sensors.camera import CameraConfig
        from mani_skill.utils.structs import Pose

        return CameraConfig(
            uid=self.name,
            pose=Pose.create_from_pq(
                torch.tensor(self.position, dtype=torch.float32),
                torch.tensor(self.quaternion, dtype=torch.float32),
            ),
            width=self.width,
            height=self.height,
            fov=self.vertical_fov,
            near=self.near,
            far=self.far,
            shader_pack="minimal",  # the fastest
        )


def look_at(eye: Vector3, target: Vector3) -> Vector3:
    """Compute the roll, pitch, yaw [degrees] of a level camera at `eye` that looks at `target`."""
    x, y, z = np.subtract(target, eye)
    if np.hypot(x, y) < 1e-9:
        raise ValueError(f"target must not be straight above or below eye; got {eye}, {target}")
    return (
        0.0,
        float(np.degrees(np.arctan2(-z, np.hypot(x, y)))),
        float(np.degrees(np.arctan2(y, x))),
    )


@dataclass(frozen=True, kw_only=True)
class Workspace:
    """Box that environment clouds are cropped to."""

    low: tuple[Bound, Bound, Bound] = (-1.3, -0.4, 0.005)
    """Lower corner [m], world frame; its height removes the ground, but no garment on it."""
    high: tuple[Bound, Bound, Bound] = (1.3, 1.9, 1.8)
    """Upper corner [m], world frame."""

    def __post_init__(self) -> None:
        adopt_fields(self)
        if not all(a < b for a, b in zip(self.low, self.high, strict=True)):
            raise ValueError(f"low must be below high on every axis; got {self.low}, {self.high}")


def is_in_workspace(points: np.ndarray, workspace: Workspace) -> np.ndarray:
    """Find the points inside a box.

    Args:
        points: [m], shape (N, 3), world frame.
        workspace: The box; its faces belong to it.

    Returns:
        Shape (N,), bool. Points with NaN coordinates are outside.
    """
    points = np.asarray(points)
    if points.ndim != 2 or points.shape[1] != 3:
        raise ValueError(f"points must have shape (N, 3); got {points.shape}")
    inside = np.ones(len(points), dtype=bool)
    for axis in range(3):
        column = points[:, axis]
        inside &= (column >= workspace.low[axis]) & (column <= workspace.high[axis])
    return inside


def farthest_point_sample(points: np.ndarray, count: int, *, seed: int) -> np.ndarray:
    """Choose points that cover a cloud evenly: each next one is the farthest from those chosen.

    Args:
        points: Points [m], shape (N, 3), finite.
        count: How many to choose.
        seed: Chooses the first point; equal arguments give equal results.

    Returns:
        Indices into `points`, shape (count,), int64. When N < count every point appears and the
        rest are repeats drawn with `seed`. Points in the same place as another are chosen last.

    Raises:
        ValueError: If the cloud is empty, not finite or not of shape (N, 3).

    Source:
        Han et al. 2023, QuickFPS, by the library fpsample.
    """
    points = np.asarray(points)
    if points.ndim != 2 or points.shape[1] != 3 or len(points) == 0 or count < 1:
        raise ValueError(
            f"points must have shape (N, 3), N >= 1, and count be positive; "
            f"got {points.shape} and {count}"
        )
    if not np.isfinite(points).all():
        raise ValueError("points must be finite; drop the pixels where nothing was hit first")
    rng = np.random.default_rng(seed)
    if len(points) <= count:
        extra = rng.integers(len(points), size=count - len(points))
        return np.concatenate([np.arange(len(points)), extra])
    # Centred, so that float32 is precise.
    centred = np.ascontiguousarray(points - points.mean(axis=0), dtype=np.float32)
    chosen = fpsample.bucket_fps_kdline_sampling(
        centred,
        count,
        h=min(_TREE_HEIGHT, len(points).bit_length() - 1),
        start_idx=int(rng.integers(len(points))),
    )
    return chosen.astype(np.int64)
