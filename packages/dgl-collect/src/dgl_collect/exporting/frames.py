"""Frames of recorded episodes: whole episodes by replay, or their stages as recorded."""

from collections.abc import Iterator
from contextlib import suppress
from typing import TYPE_CHECKING

import numpy as np

from dgl_assets.robots import SIDES, Robot
from dgl_collect.demonstration import load_demonstration
from dgl_collect.episodes import Episode
from dgl_collect.errors import NotReplayableError
from dgl_collect.exporting.trajectory import Trajectory
from dgl_collect.names import Frames
from dgl_collect.options import ExportOptions, JointControlMode
from dgl_collect.point_finder import PointFinder
from dgl_collect.stage_work import StageWork
from dgl_tasks import TaskError
from dgl_tasks.declaration import Task
from dgl_tasks.hand_span import HandPoseActions
from dgl_tasks.messages import Command, Part
from dgl_tasks.objects import compute_frames
from dgl_tasks.observation import STEPS_PER_ACTION
from dgl_tasks.sensing import ENVIRONMENT_CAMERA, GARMENT_CAMERA

if TYPE_CHECKING:
    from dgl_collect.setup import Setup
    from dgl_tasks.driver import Driver
    from dgl_tasks.handling import Handling

__all__ = [
    "Starter",
    "express_joints",
    "find_work",
    "list_place_names",
    "list_places",
    "make_frames",
    "resize",
]

SMALLEST_MOVE = 1e-6
"""Change of a joint's target in a control step from which it moves [rad]."""
PARKED_WITHIN = 0.01
"""Distance in joint space within which arms are parked [rad]."""
STRAIGHT = 0.9999
"""Least cosine between parts of a straight way in joint space."""


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


def list_place_names(task: Task) -> tuple[str, ...]:
    """List the names of a task's places, as `list_places` orders them."""
    draws = {f"{item.name}_{axis}": 0.0 for item in task.objects for axis in ("x", "y", "yaw")}
    points = dict.fromkeys(load_demonstration(task).points, np.zeros(3))
    return list_places(points, compute_frames(task, draws))[0]


class _ArrivedError(Exception):
    """The hands are at the grasp points."""


class _Waiting:
    """An actor that ends the attempt where it would begin."""

    is_sent, follows_steps = True, False

    def act(self, work: StageWork) -> Part:
        del work
        raise _ArrivedError


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

    def approach(self, driver: "Driver", hands: "Handling") -> None:
        """Bring the hands to the grasp points of the first recorded stage, as in collection.

        Scripted stages before it are carried out. Where that fails, the arms stay as they are.
        """
        runner = self._setup.make_runner(_Waiting(), rounds=1)
        with suppress(_ArrivedError, TaskError):
            driver.drive(runner.run(hands))

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
        robot, mode = setup.motion.robot, options.control_mode
        for stage in episode.stages:
            points = {name: np.array(p["xyz"]) for name, p in stage.points.items() if "xyz" in p}
            frames = compute_frames(setup.env.task, episode.randomisation)
            place_names, places = list_places(points, frames)
            yield (
                stage.name,
                Trajectory(
                    instruction=f"{setup.env.task.description} Stage: {stage.name}.",
                    success=episode.success,
                    seed=episode.seed,
                    garment=episode.garment_id,
                    names=_get_names(setup, options),
                    state=express_joints(stage.joint_state, robot, mode),
                    action=express_joints(stage.action, robot, mode),
                    ee_pose=stage.ee_pose,
                    place_names=place_names,
                    places=places,
                    cloud=stage.env_point_cloud if options.cloud else None,
                    images={
                        name: np.stack([resize(image, options.size) for image in stage.image])
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
    first = len(driver.commands)
    if not np.allclose(np.stack(driver.commands), commands[:first], atol=1e-3):
        raise NotReplayableError("the episode's arms park on another way than today's")
    place_names, places = starter.find_places(driver)
    if options.content == "grasped":
        if not episode.stages or episode.stages[0].first_step is None:
            raise NotReplayableError("the episode does not tell when its first stage began")
        for row in commands[first : episode.stages[0].first_step]:
            driver.step(Command(row))
        first = episode.stages[0].first_step
    begin, end = find_work(commands[first:], setup.motion.robot)
    begin = 0 if options.content == "grasped" else begin
    for row in commands[first : first + begin]:
        driver.step(Command(row))
    seen = {name: [] for name in ("state", "action", "ee_pose", "cloud", *options.cameras)}
    for step in range(first + begin, first + end - STEPS_PER_ACTION + 1, STEPS_PER_ACTION):
        block = commands[step : step + STEPS_PER_ACTION]
        wanted = {*options.cameras, *([ENVIRONMENT_CAMERA] if options.cloud else [])}
        sensed = driver.sense(*sorted(wanted))
        seen["state"].append(sensed.joint_state)
        seen["ee_pose"].append(sensed.ee_pose)
        seen["action"].append(block[-1])
        if options.cloud:
            seen["cloud"].append(sensed.observe().env_point_cloud)
        for name in options.cameras:
            seen[name].append(resize(sensed.pictures[name].rgb, options.size))
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
        seed=episode.seed,
        garment=episode.garment_id,
        names=_get_names(setup, options),
        state=express_joints(np.stack(seen["state"]), setup.motion.robot, options.control_mode),
        action=express_joints(np.stack(seen["action"]), setup.motion.robot, options.control_mode),
        ee_pose=np.stack(seen["ee_pose"]).astype(np.float32),
        place_names=place_names,
        places=places,
        cloud=np.stack(seen["cloud"]) if options.cloud else None,
        images={name: np.stack(seen[name]) for name in options.cameras},
    )


def find_work(commands: np.ndarray, robot: Robot) -> tuple[int, int]:
    """Find the commands between the first movement and the way back to the parked arms.

    At rest, a policy that sees the arms parked could not tell the beginning from the end, and would
    stay there.

    Args:
        commands: Joint targets of control steps [rad], shape (N, D).
        robot: Whose they are.

    Returns:
        First number and end, whole actions apart from the first command; all if the arms do nothing
        else.
    """
    moves = np.abs(np.diff(commands, axis=0)).max(axis=1, initial=0.0) > SMALLEST_MOVE
    begin = int(moves.argmax()) // STEPS_PER_ACTION * STEPS_PER_ACTION
    slices = [robot.joint_slice(side, "arm") for side in SIDES]
    parked = np.concatenate([robot.arm.parked[side] for side in SIDES])
    away = np.concatenate([commands[:, part] for part in slices], axis=1) - parked
    distance = np.linalg.norm(away, axis=1)
    if distance[-1] > PARKED_WITHIN or (distance <= PARKED_WITHIN).all():
        return begin, len(commands)
    end = int(np.flatnonzero(distance > PARKED_WITHIN)[-1])
    # arms park on a straight line in joint space
    line = away[end] / distance[end]
    is_straight = (away @ line >= STRAIGHT * distance)[:-1] & (np.diff(distance) <= 0)
    while end > 0 and is_straight[end - 1]:
        end -= 1
    end = -(-end // STEPS_PER_ACTION) * STEPS_PER_ACTION
    return (begin, end) if end > begin else (begin, len(commands))


def _get_names(setup: "Setup", options: ExportOptions) -> tuple[str, ...]:
    robot = setup.motion.robot
    if options.control_mode == "pd_hand_poses":
        return HandPoseActions(robot).names
    return robot.joint_names


def express_joints(joints: np.ndarray, robot: Robot, mode: JointControlMode) -> np.ndarray:
    """Bring joints, shape (..., D), into the form of a control mode, float32."""
    if mode == "pd_hand_poses":
        joints = HandPoseActions(robot).from_joints(joints)
    return joints.astype(np.float32)


def resize(image: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Shrink a picture, shape (H, W, 3), by averaging."""
    if image.shape[1::-1] == size:
        return image
    from PIL import Image

    return np.asarray(Image.fromarray(image).resize(size, Image.Resampling.BOX))
