"""Primitives from episodes, and as the skill of a demonstration."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.spatial.transform import Rotation

from dgl_assets import AssetError
from dgl_assets.robots import SIDES
from dgl_assets.robots.importing import load_robot
from dgl_collect.actors import Expert
from dgl_collect.demonstration import load_demonstration
from dgl_collect.episodes import find_episodes, opened_episode, read_stage_names, take
from dgl_collect.errors import CollectionError, DemonstrationError
from dgl_collect.names import list_anchors, name_scene
from dgl_collect.remote import ServedSkill
from dgl_collect.skill import follow_recordings
from dgl_files.fields import decode_json
from dgl_sadp.errors import PrimitiveError, SadpError
from dgl_sadp.primitive import Primitive, Recording, Way, fit_primitive
from dgl_sadp.primitive_file import (
    PRIMITIVES_FILE,
    TaskPrimitives,
    find_primitives,
    load_primitives,
)
from dgl_tasks.grasps import wrist_to_grasp
from dgl_tasks.hand_span import HandSpan
from dgl_tasks.motion import BimanualMotion
from dgl_tasks.objects import compute_frames
from dgl_tasks.observation import CONTROL_FREQUENCY

if TYPE_CHECKING:
    from dgl_assets.robots import Side
    from dgl_collect.options import EvaluationOptions, RunOptions
    from dgl_collect.setup import Setup
    from dgl_collect.steps import Demonstration, Stage
    from dgl_tasks.declaration import Task
    from dgl_tasks.policy import Method

__all__ = ["PrimitiveMethod", "PrimitiveSkill", "learn_primitives", "load_skill", "read_recordings"]

RESTING = 0.05
"""Largest distance that a hand which grasps nothing may move in a recording [m]."""


@dataclass(frozen=True, kw_only=True)
class PrimitiveSkill:
    """Primitives as the skill of a demonstration; implements `dgl_collect.skill.Skill`."""

    primitives: TaskPrimitives
    is_blind: bool = False
    """The mean ways of the recordings, whatever the anchors are."""

    def plan(
        self, stage: str, starts: "Mapping[Side, np.ndarray]", anchors: Mapping[str, np.ndarray]
    ) -> Way:
        """Plan a stage, one sample a control step.

        Raises:
            DemonstrationError: If there is no such primitive, or it does not fit.
        """
        primitive = self.primitives.stages.get(stage)
        if primitive is None:
            raise DemonstrationError(
                f"the primitives must have stage {stage!r}; got {sorted(self.primitives.stages)}"
            )
        try:
            return primitive.plan(
                {str(side): start for side, start in starts.items()},
                anchors,
                frames_per_second=CONTROL_FREQUENCY,
                is_blind=self.is_blind,
            )
        except PrimitiveError as err:
            raise DemonstrationError(f"stage {stage!r}: {err}") from err


@dataclass(frozen=True, kw_only=True)
class PrimitiveMethod:
    """Primitives as a method; implements `dgl_collect.evaluation.methods.LearnedMethod`."""

    is_blind: bool = False

    def check(self, task: "Task", options: "EvaluationOptions") -> None:
        """Check that there are primitives of the task's stages.

        Raises:
            ValueError: If they are of another task, or lack a stage.
            CheckpointError: If the file is missing or damaged.
        """
        self._load(task, options)

    def make(self, setup: "Setup", options: "EvaluationOptions") -> "Method":
        """Make the method; raises as `check` does."""
        return setup.make_runner(
            Expert(follows_steps=False),
            demonstration=follow_recordings(setup.demonstration),
            skill=self.load(setup.env.task, options),
        )

    def prepare_served(
        self, task: "Task", options: "EvaluationOptions"
    ) -> Callable[[], ServedSkill]:
        """Load the skill for a policy server; raises as `check` does."""
        skill = self.load(task, options)
        return lambda: ServedSkill(skill=skill, task=task.id)

    def load(self, task: "Task", options: "EvaluationOptions") -> PrimitiveSkill:
        """Load the skill; raises as `check` does."""
        return PrimitiveSkill(primitives=self._load(task, options), is_blind=self.is_blind)

    def _load(self, task: "Task", options: "EvaluationOptions") -> TaskPrimitives:
        demonstration = load_demonstration(task, options.demonstration)
        path = options.checkpoints or find_primitives(task.id)
        return _load_fitting(path, task, demonstration)


def load_skill(
    task: "Task", demonstration: "Demonstration", options: "RunOptions"
) -> PrimitiveSkill:
    """Load a file of primitives, or learn a folder of episodes; see `dgl_collect.skill.load_skill`.

    Without recordings, it is what comes with `dgl_sadp`.

    Raises:
        DemonstrationError: If there is no such file or folder, or it does not fit.
    """
    named = demonstration.recordings
    try:
        path = find_primitives(task.id) if named is None else Path(named)
        if path.is_dir() and not (path / PRIMITIVES_FILE).is_file():
            paths = find_episodes(path)
            primitives = learn_primitives(task, demonstration, paths, robots=options.robots)
        else:
            primitives = _load_fitting(path, task, demonstration)
    except (SadpError, CollectionError, ValueError) as err:
        raise DemonstrationError(f"recordings: {err}" if named else str(err)) from err
    return PrimitiveSkill(primitives=primitives)


def _load_fitting(path: Path, task: "Task", demonstration: "Demonstration") -> TaskPrimitives:
    """Load primitives that have a demonstration's stages."""
    path = path / PRIMITIVES_FILE if path.is_dir() else path
    primitives = load_primitives(path)
    if primitives.task != task.id:
        raise ValueError(f"{path}: it must be of task {task.id}; got {primitives.task}")
    wanted = {stage.name: sorted(stage.hands) for stage in demonstration.learned_stages}
    found = {name: sorted(each.hands) for name, each in primitives.stages.items()}
    if wanted != found:
        raise ValueError(f"{path}: it must have the stages {wanted}; got {found}")
    return primitives


def learn_primitives(
    task: "Task", demonstration: "Demonstration", paths: Sequence[Path], *, robots: Path | None
) -> TaskPrimitives:
    """Learn the primitives of a task from episodes.

    Args:
        task: Its declaration.
        demonstration: Its stages, of which the recordings are.
        paths: Episode files.
        robots: Folder of imported robots.

    Raises:
        PrimitiveError: If the recordings of a stage are too few or do not fit, or two are the same.
        CorruptEpisodeError: If a file is damaged, of another task or stages, or of a failure.
    """
    recordings = [read_recordings(task, demonstration, path, robots=robots) for path in paths]
    _check_copies(paths, recordings)
    stages: dict[str, Primitive] = {}
    for stage in demonstration.learned_stages:
        try:
            stages[stage.name] = fit_primitive([each[stage.name] for each in recordings])
        except PrimitiveError as err:
            raise PrimitiveError(f"stage {stage.name!r}: {err}") from err
    card: dict[str, Any] = {
        "episodes": [path.name for path in paths],
        "error_cm": {name: round(100 * each.error, 2) for name, each in stages.items()},
    }
    return TaskPrimitives(task=task.id, stages=stages, card=card)


def _check_copies(paths: Sequence[Path], recordings: Sequence[Mapping[str, Recording]]) -> None:
    """Refuse an episode that is there twice: it would pass as one left out."""
    seen: dict[bytes, Path] = {}
    for path, stages in zip(paths, recordings, strict=True):
        ways = [way for each in stages.values() for way in each.points.values()]
        key = b"".join(way.tobytes() for way in ways)
        if key in seen:
            raise PrimitiveError(f"{path} must be another episode than {seen[key]}; it is a copy")
        seen[key] = path


def read_recordings(
    task: "Task", demonstration: "Demonstration", path: Path, *, robots: Path | None = None
) -> dict[str, Recording]:
    """Read the stages of an episode, which may be of any robot, by name.

    Args:
        task: Declaration of its task.
        demonstration: The stages that it must have.
        path: Episode file.
        robots: Folder of imported robots.

    Raises:
        CorruptEpisodeError: If the file is damaged, of another task or stages, of a failure, or of
            a robot that is not there.
    """
    import h5py

    stages = demonstration.learned_stages
    with opened_episode(path) as file:
        names = read_stage_names(file)
        if file.attrs["task"] != task.id or names != [stage.name for stage in stages]:
            raise ValueError(
                f"it must be of {task.id} with stages {[stage.name for stage in stages]}; "
                f"got {file.attrs['task']} with {names}"
            )
        if not file.attrs["success"]:
            raise ValueError("it must be of a success; it is of a failure")
        try:
            robot = load_robot(str(file.attrs["robot"]), robots)
        except AssetError as err:
            raise ValueError(f"robot: {err}") from err  # with the name of the file
        frames = compute_frames(task, decode_json(str(file.attrs["randomisation"])))
        motion = BimanualMotion(task, robot=robot)
        recordings = {}
        for number, stage in enumerate(stages, start=1):
            group = take(file, f"stage_{number}", h5py.Group)
            points = decode_json(str(group.attrs["points"]))
            places = {name: np.array(point["xyz"]) for name, point in points.items()}
            cloud = take(group, "garment_point_cloud", h5py.Dataset)[()]
            first = int(group.attrs.get("approach_frames", 0))
            begin = take(group, "joint_state", h5py.Dataset)[first : first + 1]
            targets = take(group, "action", h5py.Dataset)[first:]
            if not all(np.isfinite(each).all() for each in (cloud, begin, targets)):
                raise ValueError(f"stage_{number} must hold finite numbers; got some that are not")
            recordings[stage.name] = _make_recording(
                motion,
                stage,
                np.concatenate([begin, targets]).astype(float),
                list_anchors(name_scene(cloud, frames, places)),
            )
    return recordings


def _make_recording(
    motion: BimanualMotion, stage: "Stage", joints: np.ndarray, anchors: dict[str, np.ndarray]
) -> Recording:
    """Make a recording of joint positions [rad], shape (T, D)."""
    span, robot = HandSpan(motion.robot), motion.robot
    poses: dict[Side, list[np.ndarray]] = {side: [] for side in SIDES}
    for row in joints:
        motion.reset(row)
        for side, pose in motion.compute_poses().items():
            poses[side].append(pose)
    points, turns, hands = {}, {}, {}
    for side, way in poses.items():
        moved = float(np.linalg.norm(np.stack(way)[:, :3] - way[0][:3], axis=1).max())
        if side not in stage.hands:
            if moved > RESTING:
                raise ValueError(
                    f"stage {stage.name!r}: the {side} hand must rest, which grasps nothing; "
                    f"it moves by {moved:.2f} m"
                )
            continue
        points[side] = np.stack([wrist_to_grasp(p[:3], p[3:], side, robot=robot) for p in way])
        rotations = Rotation.from_quat(np.stack(way)[:, 3:], scalar_first=True)
        turns[side] = (rotations[0].inv() * rotations).as_rotvec()
        hands[side] = span.to_coordinates(joints[:, robot.joint_slice(side, "hand")])
    return Recording(anchors=anchors, points=points, turns=turns, hands=hands)
