"""What a robot senses between two control steps: its joints, and what cameras see."""

from typing import TYPE_CHECKING

import numpy as np

from dgl_assets.robots import SIDES, Side
from dgl_physics.drawing.rasteriser import Picture
from dgl_tasks import perception as see
from dgl_tasks.grasps import wrist_to_grasp
from dgl_tasks.hanging import Hanging, measure_hanging
from dgl_tasks.observation import Observation

if TYPE_CHECKING:
    from dgl_tasks.env import GarmentEnv


class Sensed:
    """What is sensed before the next control step; pictures are taken when they are asked for.

    What is seen depends on the seed and the control step alone, not on what was looked at before.
    """

    def __init__(self, env: "GarmentEnv", *, seed: int, step: int) -> None:
        """Look at an environment as it is until its next control step.

        Args:
            env: The environment.
            seed: Of the episode.
            step: Control steps since the reset.
        """
        self._env = env
        self.seed = seed
        """Of the episode, for whoever draws something."""
        self.step = step
        """Control steps since the reset."""

    @property
    def has_objects(self) -> bool:
        """Whether there is something in the scene besides robots and garment."""
        return bool(self._env.objects)

    @property
    def joint_state(self) -> np.ndarray:
        """Measured joint positions [rad], shape (D,), float32."""
        state = self._env.agent.get_joint_state()[0]  # pyright: ignore[reportAttributeAccessIssue]
        return state.cpu().numpy().astype(np.float32)

    @property
    def ee_pose(self) -> np.ndarray:
        """Left and right end effector: xyz [m] and wxyz, shape (2, 7), world frame."""
        poses = self._env.agent.get_ee_poses()[0]  # pyright: ignore[reportAttributeAccessIssue]
        return poses.cpu().numpy()

    def get_grasp_point(self, side: Side) -> np.ndarray:
        """Tell where the grasp point of a hand is [m], shape (3,), world frame."""
        pose = self.ee_pose[SIDES.index(side)]
        robot = self._env.agent.model  # pyright: ignore[reportAttributeAccessIssue]
        return wrist_to_grasp(pose[:3], pose[3:], side, robot=robot)

    def get_frames(self) -> dict[str, dict[str, np.ndarray]]:
        """Tell where the named places of the objects are, which the robot is told [m], shape (3,), world frame."""
        return self._env.get_frames()

    def observe(self) -> Observation:
        """Look with the environment camera and feel the joints."""
        picture = self.take_picture("environment_camera")
        return Observation(
            joint_state=self.joint_state,
            ee_pose=self.ee_pose.astype(np.float32),
            image=picture.rgb,
            env_point_cloud=see.get_environment_cloud(self._env, picture, seed=self._cloud_seed),
        )

    def see_garment(self) -> np.ndarray:
        """Look at the garment from above: its cloud [m], shape (2048, 3), float32.

        Raises:
            PerceptionError: If the camera sees nothing of it.
        """
        picture = self.take_picture("garment_camera")
        return see.get_garment_cloud(self._env, picture, seed=self._cloud_seed)

    def see_points(self, camera: str = "environment_camera") -> np.ndarray:
        """Look at the garment: all points that a camera sees of it [m], shape (N, 3).

        Raises:
            PerceptionError: If the camera sees nothing of it.
        """
        return see.get_garment_points(self._env, self.take_picture(camera))

    def see_mask(self) -> np.ndarray:
        """Tell which pixels of the garment and the environment camera show the garment, shape (2, H, W), bool."""
        segments = [
            self.take_picture(camera).segments
            for camera in ("garment_camera", "environment_camera")
        ]
        return np.stack(segments) == self._env.garment_segment

    def see_objects(self) -> np.ndarray:
        """Look at the objects of the scene: their cloud [m], shape (2048, 3), float32.

        Raises:
            PerceptionError: If the camera sees nothing of them.
        """
        picture = self.take_picture("environment_camera")
        return see.get_object_cloud(self._env, picture, seed=self._cloud_seed)

    def see_hanging(self) -> Hanging:
        """Look at the garment that hangs between both hands, from the front.

        Raises:
            PerceptionError: If the camera sees nothing of it.
        """
        left, right = self.get_grasp_point("left"), self.get_grasp_point("right")
        return measure_hanging(self.see_points(), left, right)

    def take_picture(self, camera: str) -> Picture:
        """Take a picture with one of the task's cameras."""
        return see.take_picture(self._env, camera)

    @property
    def _cloud_seed(self) -> int:
        rng = np.random.default_rng([self.seed, 1, self.step])
        return int(rng.integers(2**31))
