"""Frames of recorded episodes: whole episodes by replay, or their stages as recorded."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from annotated_types import Ge

from dgl_collect.episodes import Episode
from dgl_collect.errors import NotReplayableError
from dgl_collect.exporting.trajectory import Trajectory
from dgl_collect.names import Frames
from dgl_collect.options import JointControlMode, MatcherName
from dgl_collect.point_finder import PointFinder
from dgl_files.fields import STRICT, check_fields
from dgl_tasks.hand_span import HandPoseActions
from dgl_tasks.messages import Command
from dgl_tasks.objects import compute_frames
from dgl_tasks.observation import STEPS_PER_ACTION
from dgl_tasks.sensing import ENVIRONMENT_CAMERA, GARMENT_CAMERA

if TYPE_CHECKING:
    from dgl_collect.setup import Setup
    from dgl_tasks.driver import Driver
    from dgl_tasks.handling import Handling

__all__ = ["ExportOptions", "Starter", "Trajectory", "list_places", "make_frames"]

CameraName = Literal[
    "environment_camera",
    "video_camera",
    "garment_camera",
    "left_wrist_camera",
    "right_wrist_camera",
]
"""Cameras of every task."""
_Pixels = Annotated[int, Ge(16)]


@dataclass(frozen=True, kw_only=True)
class ExportOptions:
    """Content of exported frames.

    Raises:
        ValueError: If a field is of another type or out of range.
    """

    __pydantic_config__ = STRICT

    content: Literal["whole", "stages"] = "whole"
    """whole: each episode from the parked arms to its verdict, approaches and retreats included, by
    replay; stages: each recorded stage as an episode of its own, as recorded."""
    control_mode: JointControlMode = "pd_joint_pos"
    """Form of states and actions: a number for each joint, or 22, joints of the arms and weights of
    hand poses."""
    cameras: tuple[CameraName, ...] = ("environment_camera",)
    """Cameras: `environment_camera` ahead, `video_camera` near, `garment_camera` above, and those
    behind the hands."""
    size: tuple[_Pixels, _Pixels] = (320, 240)
    """Width and height of the pictures [pixels]."""
    cloud: bool = False
    """Add the environment's point cloud to each frame."""
    matcher: MatcherName = "gam"
    """Finds the demonstration's points, whose places at the start are part of each frame."""
    robots: Path | None = None
    """Folder of imported robots, for episodes of a robot that is not built in."""

    def __post_init__(self) -> None:
        check_fields(self)
        if len(set(self.cameras)) < len(self.cameras):
            raise ValueError(f"cameras must differ; got {', '.join(self.cameras)}")
        if self.content == "stages" and set(self.cameras) - {ENVIRONMENT_CAMERA}:
            raise ValueError(
                f"stages hold pictures of the {ENVIRONMENT_CAMERA} alone; got "
                f"{', '.join(self.cameras)}: take whole episodes"
            )


def list_places(
    points: dict[str, np.ndarray], frames: Frames
) -> tuple[tuple[str, ...], np.ndarray]:
    """List the coordinates of points and frames in a fixed order: their names, and values [m]."""
    places = {
        **points,
        **{f"{item}.{name}": p for item, named in frames.items() for name, p in named.items()},
    }
    names = tuple(f"{name}.{axis}" for name in places for axis in "xyz")
    values = np.concatenate([np.zeros(0), *places.values()]).astype(np.float32)
    return names, values


class Starter:
    """Begins episodes as policies of other projects meet them: arms parked, garment looked at."""

    def __init__(self, setup: "Setup") -> None:
        """Take over environment, demonstration and matcher."""
        self._setup = setup

    def begin(self, driver: "Driver", garment: str | None) -> "Handling":
        """Reset the environment and park the arms.

        Args:
            driver: Of the episode.
            garment: Its id; drawn from the seed when None.

        Returns:
            The hands.
        """
        from dgl_tasks.handling import Handling

        hands = Handling(self._setup.motion, driver.reset(garment))
        driver.drive(hands.park())
        return hands

    def find_places(self, driver: "Driver") -> tuple[tuple[str, ...], np.ndarray]:
        """Find the demonstration's points on the garment, and the frames of the objects.

        Returns:
            Names of the coordinates, and their values [m], shape (E,).

        Raises:
            PerceptionError: If the garment is out of sight.
        """
        setup, sensed = self._setup, driver.sense(GARMENT_CAMERA)
        finder = PointFinder(setup.demonstration, setup.demo_cloud)
        if setup.demonstration.points:
            finder.look(sensed.see_garment(), setup.find_matcher(setup.env))
        return list_places(finder.points, sensed.frames)


def make_frames(
    episode: Episode, options: ExportOptions, setup: "Setup"
) -> Iterator[tuple[str, Trajectory]]:
    """Make the frames of an episode.

    Args:
        episode: The record.
        options: Content of the frames.
        setup: Environment of the episode's task, robot, look and cloud.

    Yields:
        A name, empty for a whole episode and that of the stage otherwise; and the frames.

    Raises:
        NotReplayableError: If a whole episode does not hold its commands, its arms park on another
            way, or its replay ends with another verdict.
    """
    if options.content == "stages":
        for stage in episode.stages:
            points = {name: np.array(p["xyz"]) for name, p in stage.points.items() if "xyz" in p}
            frames = compute_frames(setup.env.task, episode.randomisation)
            place_names, places = list_places(points, frames)
            yield (
                stage.name,
                Trajectory(
                    instruction=f"{setup.env.task.description} Stage: {stage.name}.",
                    success=episode.success,
                    names=_get_names(setup, options),
                    state=_express(stage.joint_state, setup, options),
                    action=_express(stage.action, setup, options),
                    ee_pose=stage.ee_pose,
                    place_names=place_names,
                    places=places,
                    cloud=stage.env_point_cloud if options.cloud else None,
                    images={
                        name: np.stack([_resize(image, options.size) for image in stage.image])
                        for name in options.cameras
                    },
                ),
            )
        return
    yield "", _replay(episode, options, setup)


def _replay(episode: Episode, options: ExportOptions, setup: "Setup") -> Trajectory:
    from dgl_tasks.driver import Driver

    env, commands = setup.env, episode.commands
    if commands is None:
        raise NotReplayableError(
            "the episode must hold its commands; this one was recorded before they were kept: "
            "collect it again, or export its stages"
        )
    driver = Driver(env, seed=episode.seed)
    starter = Starter(setup)
    starter.begin(driver, episode.garment_id)
    parked = len(driver.commands)
    if not np.allclose(np.stack(driver.commands), commands[:parked], atol=1e-3):
        raise NotReplayableError("the episode's arms park on another way than today's")
    place_names, places = starter.find_places(driver)
    seen = {name: [] for name in ("state", "action", "ee_pose", "cloud", *options.cameras)}
    for step in range(parked, len(commands) - STEPS_PER_ACTION + 1, STEPS_PER_ACTION):
        block = commands[step : step + STEPS_PER_ACTION]
        wanted = {*options.cameras, *([ENVIRONMENT_CAMERA] if options.cloud else [])}
        sensed = driver.sense(*sorted(wanted))
        seen["state"].append(sensed.joint_state)
        seen["ee_pose"].append(sensed.ee_pose)
        seen["action"].append(block[-1])
        if options.cloud:
            seen["cloud"].append(sensed.observe().env_point_cloud)
        for name in options.cameras:
            seen[name].append(_resize(sensed.pictures[name].rgb, options.size))
        for row in block:
            driver.step(Command(row))
    for row in commands[len(driver.commands) :]:
        driver.step(Command(row))
    verdict = env.judge()
    if verdict.success != episode.success:
        raise NotReplayableError(
            f"the replay ends with {verdict.value:.4f}, the record with "
            f"{episode.success_value:.4f}: another verdict"
        )
    return Trajectory(
        instruction=env.task.description,
        success=verdict.success,
        names=_get_names(setup, options),
        state=_express(np.stack(seen["state"]), setup, options),
        action=_express(np.stack(seen["action"]), setup, options),
        ee_pose=np.stack(seen["ee_pose"]).astype(np.float32),
        place_names=place_names,
        places=places,
        cloud=np.stack(seen["cloud"]) if options.cloud else None,
        images={name: np.stack(seen[name]) for name in options.cameras},
    )


def _get_names(setup: "Setup", options: ExportOptions) -> tuple[str, ...]:
    robot = setup.motion.robot
    if options.control_mode == "pd_hand_poses":
        return HandPoseActions(robot).names
    return robot.joint_names


def _express(joints: np.ndarray, setup: "Setup", options: ExportOptions) -> np.ndarray:
    """Bring joints, shape (T, D), into the form of the control mode, float32."""
    if options.control_mode == "pd_hand_poses":
        joints = HandPoseActions(setup.motion.robot).from_joints(joints)
    return joints.astype(np.float32)


def _resize(image: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Shrink a picture, shape (H, W, 3), by averaging."""
    if image.shape[1::-1] == size:
        return image
    from PIL import Image

    return np.asarray(Image.fromarray(image).resize(size, Image.Resampling.BOX))
