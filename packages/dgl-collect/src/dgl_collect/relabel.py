"""Relabelling: recorded episodes with the affordance of another matcher.

Motions stay as they were. A policy that will run behind the Garment Affordance Model learns from
the affordance of that model, and new weights of the model need no new demonstrations.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from dgl_assets.robots import SIDES
from dgl_collect.demonstration import load_demonstrated_garment, load_demonstration
from dgl_collect.episodes import Episode, StageRecord, read_episode, write_episode
from dgl_collect.errors import CorruptEpisodeError
from dgl_collect.names import Frames, name_scene
from dgl_collect.options import RunOptions
from dgl_collect.point_finder import PointFinder
from dgl_collect.steps import Stage
from dgl_gam import GarmentAffordanceModel, Matcher, compute_affordance
from dgl_tasks import TaskError, get_task
from dgl_tasks.coverage import sample_visible_surface
from dgl_tasks.objects import compute_frames

WITHIN = 0.15
"""Largest distance of a matched point from the recorded one [m]."""


class Relabeller:
    """Gives episodes of one task the affordance of a matcher that sees clouds alone."""

    def __init__(
        self,
        task: str,
        options: RunOptions | None = None,
        *,
        matcher: Matcher | None = None,
        weights: Path | None = None,
    ) -> None:
        """Load the demonstration of a task and the matcher of its points.

        Args:
            task: Environment id.
            options: `demonstration`, for one of one's own.
            matcher: Finds the demonstrated points; the Garment Affordance Model when None.
            weights: Its weights (.safetensors); those of `dgl_gam` when None.

        Raises:
            UnknownTaskError: If there is no such task.
            ValueError: If its demonstration has no points.
            GamError: If the weights cannot be loaded.
        """
        self.task = get_task(task)
        self._demonstration = load_demonstration(
            self.task, options.demonstration if options is not None else None
        )
        if not self._demonstration.points:
            raise ValueError(
                f"{task} has no points for a matcher: its episodes hold no affordance to replace"
            )
        garment = load_demonstrated_garment(self._demonstration.garment)
        surface = sample_visible_surface(garment.vertices, garment.faces)
        self._demo_cloud = surface.astype(np.float32)
        self._matcher = matcher or GarmentAffordanceModel.load(
            weights or garment.category, category=garment.category if weights else None
        )

    def relabel(self, episode: Episode) -> tuple[Episode, float]:
        """Give an episode the matcher's affordance.

        Args:
            episode: Of this task.

        Returns:
            The episode, and the largest distance of a matched point from the recorded one, to which
            the hand went [m].

        Raises:
            ValueError: If the episode is of another task, or has other stages.
            TaskError: If a point of a stage is not found near its first place.
        """
        stages = self._demonstration.learned_stages
        if episode.task != self.task.id:
            raise ValueError(f"the episode must be of {self.task.id}; got one of {episode.task}")
        names = tuple(stage.name for stage in stages)
        if episode.stage_names != names:
            raise ValueError(f"the episode must have the stages {names}; got {episode.stage_names}")
        finder = PointFinder(self._demonstration, self._demo_cloud)
        first = episode.stages[0]
        if stages[0] is self._demonstration.stages[0]:
            finder.look(first.garment_point_cloud, self._matcher)
        else:  # earlier stages are not recorded: how the garment lay before them was seen then
            finder.points = {name: np.array(p["xyz"]) for name, p in first.points.items()}
        frames = compute_frames(self.task, episode.randomisation)
        relabelled = [
            self._relabel_stage(finder, s, r, frames)
            for s, r in zip(stages, episode.stages, strict=True)
        ]
        return (
            replace(episode, stages=tuple(r for r, _ in relabelled), affordance_matcher="gam"),
            max(distance for _, distance in relabelled),
        )

    def _relabel_stage(
        self, finder: PointFinder, stage: Stage, record: StageRecord, frames: Frames
    ) -> tuple[StageRecord, float]:
        cloud = record.garment_point_cloud
        points = finder.find_stage_points(stage, cloud, self._matcher)
        names = {**self._demonstration.values, **name_scene(cloud, frames, points)}
        grasp, similarity = finder.find_grasps(stage, cloud, self._matcher, names)
        went = cloud[record.points_affordance_feature.argmax(axis=0)]  # (2, 3)
        distances = [np.linalg.norm(went[SIDES.index(s)] - point) for s, point in grasp.items()]
        affordance = compute_affordance(similarity)
        return replace(record, points_affordance_feature=affordance), float(max(distances))


@dataclass
class Relabelling:
    """Outcome for a folder of episodes; each file is in one of these."""

    written: list[Path] = field(default_factory=list)
    """Relabelled now."""
    kept: list[Path] = field(default_factory=list)
    """Relabelled before."""
    left_out: dict[Path, float] = field(default_factory=dict)
    """Distance of a matched point from the recorded one [m]; infinite where none was found."""
    refused: dict[Path, str] = field(default_factory=dict)
    """Fault of each refused file."""


def relabel_episodes(
    paths: Iterable[Path],
    out: Path,
    relabeller: Relabeller,
    *,
    within: float = WITHIN,
    on_file: Callable[[Path], None] | None = None,
) -> Relabelling:
    """Write relabelled copies of the episodes whose matched points are near the recorded ones.

    Other episodes would teach motions that do not follow from the match. Files that exist are whole
    and are kept, so an interrupted run continues.

    Args:
        paths: Episode files.
        out: Folder for the copies, which keep their names.
        relabeller: Of the episodes' task.
        within: Largest distance of a matched point from the recorded one [m].
        on_file: Called with each path before it is read.

    Raises:
        ValueError: If `within` is not positive, or `out` is the folder of an episode.
    """
    if not within > 0:
        raise ValueError(f"within must be positive; got {within}")
    result = Relabelling()
    for path in paths:
        if path.parent.resolve() == out.resolve():
            raise ValueError(f"out must not be the episodes' own folder; got {out}")
        if on_file is not None:
            on_file(path)
        target = out / path.name
        if target.exists():
            result.kept.append(target)
            continue
        try:
            episode, distance = relabeller.relabel(read_episode(path))
        except (ValueError, CorruptEpisodeError) as err:
            result.refused[path] = str(err)
        except TaskError:
            result.left_out[path] = float("inf")
        else:
            if distance > within:
                result.left_out[path] = distance
            else:
                result.written.append(write_episode(target, episode))
    return result
