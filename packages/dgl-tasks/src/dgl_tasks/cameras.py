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

from dgl_assets.robots import Robot, Side
from dgl_files.fields import adopt_fields
from dgl_physics.drawing.camera import Axes, PinholeCamera, Vector3
from dgl_tasks.rotations import to_quaternion, to_rotation

if TYPE_CHECKING:
    from mani_skill.sensors.camera import CameraConfig
    from mani_skill.utils.structs import Link

HORIZONTAL_FOV = 2 * np.arctan(20.955 / 2 / 50.0)
"""Field of view [rad], 23.7 degrees: aperture 20.955 at focal length 50 (original code)."""

Bound = Annotated[float, AllowInfNan(True)]
"""Side of a box that may be open."""

_TREE_HEIGHT = 5
"""Levels of the bucket tree for farthest points; the fastest for clouds of pictures."""
WRIST_CAMERAS: dict[str, Side] = {"left_wrist_camera": "left", "right_wrist_camera": "right"}
"""Cameras above the backs of the hands, which look at the grasp points; every robot has them."""
_WRIST_OFFSET = (-0.2, -0.16, 0.0)
"""Place of a wrist camera from the grasp point, in axes of `ee` [m]: behind, and above the back of
the hand. It looks at the grasp point."""
_WRIST_FOV = float(np.radians(80))
_WRIST_NEAR = 0.02
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


def place_wrist_camera(side: Side, pose: np.ndarray, robot: Robot) -> PinholeCamera:
    """Place a wrist camera.

    Args:
        side: "left" or "right".
        pose: Of its `ee`: xyz [m] and wxyz, shape (7,), world frame.
        robot: Whose hand it is.
    """
    position, axes = _mount_wrist_camera(side, robot)
    turn = to_rotation(pose[3:])
    x, y, z = (pose[:3] + turn.apply(position)).tolist()
    right, down, forward = (turn.as_matrix() @ axes).T.tolist()
    return PinholeCamera(
        position=(x, y, z),
        axes=(tuple(right), tuple(down), tuple(forward)),
        horizontal_fov=_WRIST_FOV,
        near=_WRIST_NEAR,
    )


def build_wrist_camera(name: str, robot: Robot, link: "Link") -> "CameraConfig":
    """Make ManiSkill's configuration of a wrist camera on its `ee` link."""
    import torch
    from mani_skill.sensors.camera import CameraConfig
    from mani_skill.utils.structs import Pose

    side = WRIST_CAMERAS[name]
    position, axes = _mount_wrist_camera(side, robot)
    still = place_wrist_camera(side, np.array([0.0, 0, 0, 1, 0, 0, 0]), robot)
    turn = Rotation.from_matrix(axes @ _OPENCV_TO_SAPIEN.T)
    return CameraConfig(
        uid=name,
        pose=Pose.create_from_pq(torch.from_numpy(position), torch.from_numpy(to_quaternion(turn))),
        width=still.width,
        height=still.height,
        fov=still.vertical_fov,
        near=still.near,
        far=still.far,
        mount=link,
        shader_pack="minimal",
    )


def _mount_wrist_camera(side: Side, robot: Robot) -> tuple[np.ndarray, np.ndarray]:
    """Give place [m] and right, down and forward as columns, in axes of `ee`."""
    forward = -np.array(_WRIST_OFFSET) / np.linalg.norm(_WRIST_OFFSET)
    right = np.array([0.0, 0.0, -1.0])
    axes = np.column_stack([right, np.cross(forward, right), forward])
    return robot.get_grasp_offset(side) + _WRIST_OFFSET, axes


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
