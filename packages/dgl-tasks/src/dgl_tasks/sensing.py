"""Data that a robot senses between two control steps: joints, hands, objects and pictures."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from dgl_assets.robots import SIDES, Robot, Side
from dgl_physics.drawing.rasteriser import Picture
from dgl_tasks.cameras import Workspace
from dgl_tasks.clearance import Obstacle
from dgl_tasks.grasps import wrist_to_grasp
from dgl_tasks.hanging import Hanging, measure_hanging
from dgl_tasks.observation import Observation
from dgl_tasks.perception import (
    CloudKind,
    Segments,
    get_environment_cloud,
    get_garment_cloud,
    get_garment_points,
    get_object_cloud,
)

GARMENT_CAMERA, ENVIRONMENT_CAMERA = SENSOR_CAMERAS = ("garment_camera", "environment_camera")
"""The camera that looks down on the garment, and the one that policies see by."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Sensed:
    """A snapshot before one control step; `TakePictures` asks for one with pictures.

    Clouds are sampled from the pictures with the seed of episode and control step alone.
    """

    seed: int
    """Seed of the episode."""
    step: int
    """Control steps since the reset."""
    robot: Robot
    """Description of arms and hands."""
    joint_state: np.ndarray
    """Measured joint positions [rad], shape (D,), float32."""
    ee_pose: np.ndarray
    """Left and right end effector: xyz [m] and quaternion wxyz, shape (2, 7), world frame."""
    frames: Mapping[str, Mapping[str, np.ndarray]]
    """Known frames of the objects, by object and name [m], shape (3,), world frame."""
    pulls: Mapping[Side, np.ndarray] = field(default_factory=dict)
    """Force of the garment on each hand in the last step [N], shape (3,), world frame."""
    obstacles: Sequence[Obstacle] = ()
    """Objects to keep out of."""
    workspace: Workspace
    """Box that environment clouds are cropped to."""
    cloud: CloudKind = "segmented"
    """Kind of environment clouds."""
    pictures: Mapping[str, Picture] = field(default_factory=dict)
    """Pictures by camera, of the cameras that were asked for."""
    segments: Segments | None = None
    """Segmentation ids in the pictures; None without pictures."""

    def get_grasp_point(self, side: Side) -> np.ndarray:
        """Compute the grasp point of a hand [m], shape (3,), world frame."""
        pose = self.ee_pose[SIDES.index(side)]
        return wrist_to_grasp(pose[:3], pose[3:], side, robot=self.robot)

    def observe(self) -> Observation:
        """Give the observation of a policy; needs a picture of the environment camera."""
        picture, segments = self._get_picture(ENVIRONMENT_CAMERA)
        return Observation(
            joint_state=self.joint_state,
            ee_pose=self.ee_pose.astype(np.float32),
            image=picture.rgb,
            env_point_cloud=get_environment_cloud(
                picture, segments, self.workspace, kind=self.cloud, seed=self._cloud_seed
            ),
        )

    def see_garment(self) -> np.ndarray:
        """Sample the garment's cloud [m], shape (2048, 3), float32, from the garment camera.

        Raises:
            PerceptionError: If the garment is out of sight.
        """
        return get_garment_cloud(*self._get_picture(GARMENT_CAMERA), seed=self._cloud_seed)

    def see_points(self, camera: str = ENVIRONMENT_CAMERA) -> np.ndarray:
        """Give all points of the garment in a picture [m], shape (N, 3).

        Raises:
            PerceptionError: If the garment is out of sight.
        """
        return get_garment_points(*self._get_picture(camera))

    def see_mask(self) -> np.ndarray:
        """Mark the garment's pixels, of garment and environment camera, shape (2, H, W), bool."""
        found = [self._get_picture(camera) for camera in SENSOR_CAMERAS]
        return np.stack([picture.segments == ids.garment for picture, ids in found])

    def see_objects(self) -> np.ndarray:
        """Sample the objects' cloud [m], shape (2048, 3), float32, from the environment camera.

        Raises:
            PerceptionError: If all objects are out of sight.
        """
        return get_object_cloud(*self._get_picture(ENVIRONMENT_CAMERA), seed=self._cloud_seed)

    def see_hanging(self) -> Hanging:
        """Measure how the garment hangs between both hands, from the environment camera.

        Raises:
            PerceptionError: If the garment is out of sight.
        """
        left, right = self.get_grasp_point("left"), self.get_grasp_point("right")
        return measure_hanging(self.see_points(), left, right)

    def _get_picture(self, camera: str) -> tuple[Picture, Segments]:
        if camera not in self.pictures or self.segments is None:
            raise ValueError(
                f"the {camera} was not asked for a picture: yield from hands.look({camera!r}); "
                f"there are {sorted(self.pictures)}"
            )
        return self.pictures[camera], self.segments

    @property
    def _cloud_seed(self) -> int:
        rng = np.random.default_rng([self.seed, 1, self.step])
        return int(rng.integers(2**31))
