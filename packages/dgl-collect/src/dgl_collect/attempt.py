"""Attempts: one method in one environment, filmed, judged and recorded."""

import logging
from collections.abc import Mapping
from pathlib import Path
from typing import Literal

import numpy as np

from dgl_assets.garments.catalogue import Split
from dgl_collect.actors import Expert
from dgl_collect.attempt_jobs import AttemptRequest
from dgl_collect.episodes import FINAL_PARTICLES, Episode, write_episode
from dgl_collect.options import GarmentChoice, RecordOptions
from dgl_collect.recording import EpisodeRecorder
from dgl_collect.results import PLACEMENT_ERROR, AttemptResult, package_versions
from dgl_collect.setup import Setup, make_setup
from dgl_collect.skill import follow_recordings
from dgl_collect.video import VideoWriter, save_png
from dgl_physics import MeshError, PhysicsError
from dgl_tasks import TaskError
from dgl_tasks.declaration import Task
from dgl_tasks.evaluation import EpisodeResult, run_episode
from dgl_tasks.policy import Method
from dgl_tasks.task_garment import list_task_garments

logger = logging.getLogger(__name__)


def make_attempt_runner(task: str, options: RecordOptions) -> "Attempts":
    """Build the attempts of a collection; see `CollectConfig.attempt_factory`."""
    setup = make_setup(task, options)
    runner = setup.make_runner(Expert())
    if options.policy == "primitive":
        runner = setup.make_runner(
            Expert(follows_steps=False), demonstration=follow_recordings(setup.demonstration)
        )
    return Attempts(setup, runner, recorded=options.record)


class Attempts:
    """Makes attempts by one method in one environment; an attempt depends on its seed alone."""

    def __init__(
        self,
        setup: Setup,
        method: Method,
        *,
        recorded: Literal["stages", "approaches"] | None,
        garments: GarmentChoice | None = None,
    ) -> None:
        """Take over an environment and a method.

        Args:
            setup: Environment and demonstration.
            method: The method.
            recorded: Content of the episodes of successes; None for no episodes.
            garments: Split of the drawn garments; the environment draws when None.
        """
        self._setup, self._method = setup, method
        self._recorded = recorded
        self._garments: GarmentChoice | None = garments
        self.env = setup.env

    def close(self) -> None:
        """Release the environment."""
        self.env.close()

    def run(self, request: AttemptRequest, out_dir: Path) -> AttemptResult:
        """Make one attempt, with a film and a picture of its end, and the episode of a success."""
        env, stem = self.env, request.episode_id
        garment, drawn = self._choose_garment(request)
        recorder = None
        if self._recorded is not None:
            recorder = EpisodeRecorder(env, with_approach=self._recorded == "approaches")
        files = {"video": f"{stem}.mp4", "picture": f"{stem}.png"}
        ended, error = None, None
        with VideoWriter(out_dir / files["video"]) as video:
            try:
                ended = run_episode(
                    env,
                    self._setup.motion,
                    self._method,
                    seed=request.seed,
                    garment=garment,
                    film=video.add,
                    listener=recorder,
                )
            except MeshError:
                raise  # no episode has begun, so there is no picture
            except (TaskError, PhysicsError) as err:
                logger.info("attempt %d: %s", request.index, err)
                error = err
                video.add(env.film())
        save_png(out_dir / files["picture"], ended.picture if ended else env.film())
        if recorder is not None and ended is not None and ended.success:
            files["episode"] = f"{stem}.h5"
            episode = self._make_episode(request.seed, ended, recorder)
            write_episode(out_dir / files["episode"], episode)
        records = recorder.records.values() if recorder is not None else ()
        return describe_episode(
            ended or error,
            index=request.index,
            seed=request.seed,
            garment_id=str(env.draws["garment"]) if "garment" in env.draws else None,
            files=files,
            measurements=self._measure_placement(),
            randomisation={**env.draws, **drawn},
            frames=sum(record.frame_count for record in records),
            stage_seconds=recorder.seconds if recorder is not None else {},
        )

    def _measure_placement(self) -> dict[str, float]:
        """Measure how far the garment is from its place, where the task has one."""
        env = self.env
        error = env.task.success.measure_placement(env.get_particles(), env.get_frames())
        if error is None or not np.isfinite(error):  # not after a simulation that failed
            return {}
        return {PLACEMENT_ERROR: error}

    def _choose_garment(self, request: AttemptRequest) -> tuple[str | None, dict[str, str]]:
        """Return the garment, None for one that the environment draws, and the drawn split."""
        garment = self._setup.options.garment
        if self._garments is None:
            return garment, {}
        if garment is not None:
            return garment, {"split": "own"}
        split = choose_split(self._garments, request.index)
        return draw_garment(self.env.task, split, request.seed), {"split": split}

    def _make_episode(self, seed: int, result: EpisodeResult, recorder: EpisodeRecorder) -> Episode:
        """Build the episode of an attempt from its recorded stages."""
        setup = self._setup
        stages = setup.demonstration.learned_stages
        return Episode(
            task=self.env.task.id,
            seed=seed,
            garment_id=result.garment,
            robot=setup.motion.robot.name,
            matcher=setup.matcher,
            cloud=self.env.cloud,
            success=result.success,
            success_value=result.verdict.value,
            stages=tuple(recorder.records[stage.name] for stage in stages),
            randomisation=dict(result.draws),
            measurements=dict(result.measurements),
            package_versions=package_versions(),
            commands=result.commands,
            extra={FINAL_PARTICLES: self.env.get_particles().astype(np.float32)},
        )


def choose_split(choice: GarmentChoice, attempt_index: int) -> Split:
    """Choose the split of an attempt's garment; with "both", even attempts train, odd ones test."""
    if choice == "both":
        return "train" if attempt_index % 2 == 0 else "test"
    return choice


def draw_garment(task: Task, split: Split, seed: int) -> str:
    """Draw the garment of an attempt from a split of those of its task."""
    ids = list_task_garments(task, split)
    return ids[int(np.random.default_rng([seed, 3]).integers(len(ids)))]


def describe_episode(
    ended: EpisodeResult | Exception | None, *, measurements: Mapping[str, float], **common: object
) -> AttemptResult:
    """Make the result of an attempt, finished or ended by an error."""
    common["measurements"] = measurements
    if not isinstance(ended, EpisodeResult):
        kind = type(ended).__name__.removesuffix("Error")
        words = "".join(f" {c.lower()}" if c.isupper() else c for c in kind).strip()
        return AttemptResult(success=False, reason=words, detail=str(ended), **common)  # pyright: ignore[reportArgumentType]
    steps = float(len(ended.commands))
    common["measurements"] = {**ended.measurements, "steps": steps, **measurements}
    return AttemptResult(
        success=ended.success,
        first_try=ended.first_try.success,
        value=ended.verdict.value,
        reason=ended.reason,
        detail=ended.detail,
        criteria=ended.verdict.criteria,
        beliefs=ended.beliefs,
        **common,  # pyright: ignore[reportArgumentType]
    )
