"""Attempts at a task by its demonstration: the runner that the collection's workers build."""

import logging
import time
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from dgl_assets.robots import DEFAULT_ROBOT
from dgl_collect.actors import Expert
from dgl_collect.episodes import FINAL_PARTICLES, Episode, write_episode
from dgl_collect.recording import EpisodeRecorder
from dgl_collect.results import AttemptResult, package_versions
from dgl_collect.setup import Setup, make_setup
from dgl_collect.video import VideoWriter, save_png
from dgl_physics import MeshError, PhysicsError
from dgl_tasks import TaskError
from dgl_tasks.driver import Listener
from dgl_tasks.evaluation import EpisodeResult, run_episode
from dgl_tasks.perception import film
from dgl_tasks.policy import Method

logger = logging.getLogger(__name__)

OPTIONS = ("garment", "render_backend", "look", "matcher", "robot", "robots", "recorded", "rounds")


def make_attempt_runner(task: str, options: Mapping[str, object]) -> "DemonstrationAttempts":
    """Build the attempts of a task; see `dgl_collect.attempts.AttemptFactory`.

    Args:
        task: Environment id.
        options: "garment": catalogue id, or folder of an imported garment, to use in every attempt instead of drawing one;
            "render_backend": ManiSkill's, "gpu" where there is CUDA and "cpu" elsewhere by default;
            "look": "studio", the default, or "random": floors and fabrics of all kinds;
            "matcher": "exact", the default, knows the simulated garment, "gam" sees its cloud alone;
            "robot": name of arm and hand, such as "ur10e+allegro"; "robots": folder of imported
            robots, for names that are not built in; "recorded": "stages", the default, or "approaches";
            "rounds": how often the stages are gone through at most, as the demonstration says by default.
    """
    unknown = set(options) - set(OPTIONS)
    if unknown:
        raise ValueError(f"options must be among {OPTIONS}; got {sorted(unknown)}")
    for name, value in options.items():
        kind, word = (int, "an integer") if name == "rounds" else (str, "a string")
        if not isinstance(value, kind):
            raise ValueError(f"option {name} must be {word}; got {value!r}")
    if (recorded := options.get("recorded", "stages")) not in ("stages", "approaches"):
        raise ValueError(f"option recorded must be 'stages' or 'approaches'; got {recorded!r}")
    return DemonstrationAttempts(task, **options)  # pyright: ignore[reportArgumentType]


class DemonstrationAttempts:
    """Makes attempts in one environment, one after the other; an attempt depends on its seed alone."""

    def __init__(
        self,
        task: str,
        *,
        garment: str | None = None,
        render_backend: str | None = None,
        look: str = "studio",
        matcher: str = "exact",
        robot: str = DEFAULT_ROBOT.name,
        robots: str | None = None,
        recorded: str = "stages",
        rounds: int | None = None,
    ) -> None:
        """Build the environment and load the demonstration."""
        if rounds is not None and rounds < 1:
            raise ValueError(f"rounds must be at least 1; got {rounds}")
        self._rounds = rounds
        self._garment, self._with_approach = garment, recorded == "approaches"
        self._setup = make_setup(
            task,
            render_backend=render_backend,
            look=look,
            matcher=matcher,
            robot=robot,
            robots=robots,
        )
        self.env = self._setup.env

    def close(self) -> None:
        """Release the environment."""
        self.env.close()

    def run(
        self, *, attempt_index: int, seed: int, out_dir: Path, episode_id: str
    ) -> AttemptResult:
        """Make one attempt; see `dgl_collect.attempts.AttemptRunner`."""
        setup = self._setup
        recorder = EpisodeRecorder(setup.env, with_approach=self._with_approach)
        result, ended = film_attempt(
            setup,
            setup.make_runner(Expert(), rounds=self._rounds),
            index=attempt_index,
            seed=seed,
            garment=self._garment,
            out_dir=out_dir,
            episode_id=episode_id,
            listener=recorder,
        )
        files = dict(result.files)
        if ended is not None and ended.success:
            files["episode"] = f"{episode_id}.h5"
            write_episode(out_dir / files["episode"], self._make_episode(seed, ended, recorder))
        return replace(
            result,
            files=files,
            frames=sum(record.frame_count for record in recorder.records.values()),
            stage_seconds=recorder.seconds,
        )

    def _make_episode(self, seed: int, result: EpisodeResult, recorder: EpisodeRecorder) -> Episode:
        """Put the recorded stages of an attempt together."""
        setup = self._setup
        stages = setup.demonstration.learned_stages
        return Episode(
            task=setup.env.task.id,
            seed=seed,
            garment_id=result.garment,
            robot=setup.motion.robot.name,
            matcher=setup.matcher,
            success=result.success,
            success_value=result.verdict.value,
            stages=tuple(recorder.records[stage.name] for stage in stages),
            randomisation=dict(result.draws),
            measurements=dict(result.measurements),
            package_versions=package_versions(),
            commands=result.commands,
            extra={FINAL_PARTICLES: setup.env.get_particles().astype(np.float32)},
        )


def film_attempt(
    setup: Setup,
    method: Method,
    *,
    index: int,
    seed: int,
    garment: str | None,
    out_dir: Path,
    episode_id: str,
    listener: Listener | None = None,
) -> tuple[AttemptResult, EpisodeResult | None]:
    """Run a method for one episode, with a film and a picture of its end.

    Args:
        setup: The environment.
        method: Acts.
        index: Number of the attempt.
        seed: Of the episode.
        garment: Catalogue id; drawn from the seed when None.
        out_dir: Folder for the film and the picture.
        episode_id: Stem of their names.
        listener: As of `run_episode`.

    Returns:
        The attempt's result, and the episode's; None where an error has ended it, which is the attempt's reason.
    """
    started = time.perf_counter()
    env = setup.env
    files = {"video": f"{episode_id}.mp4", "picture": f"{episode_id}.png"}
    ended, error = None, None
    with VideoWriter(out_dir / files["video"]) as video:
        try:
            ended = run_episode(
                env,
                setup.motion,
                method,
                seed=seed,
                garment=garment,
                film=video.add,
                listener=listener,
            )
        except MeshError:
            raise  # no episode has begun, and there is nothing to be seen of it
        except (TaskError, PhysicsError) as err:
            logger.info("attempt %d: %s", index, err)
            error = err
            video.add(film(env))
    save_png(out_dir / files["picture"], ended.picture if ended else film(env))
    result = describe_episode(
        ended or error,
        index=index,
        seed=seed,
        garment_id=str(env.draws["garment"]) if "garment" in env.draws else None,
        seconds=time.perf_counter() - started,
        files=files,
        randomisation=dict(env.draws),
    )
    return result, ended


def describe_episode(ended: EpisodeResult | Exception | None, **common: object) -> AttemptResult:
    """Make the result of an attempt of an episode that came to its end, or that an error ended."""
    if not isinstance(ended, EpisodeResult):
        kind = type(ended).__name__.removesuffix("Error")
        words = "".join(f" {c.lower()}" if c.isupper() else c for c in kind).strip()
        return AttemptResult(success=False, reason=words, detail=str(ended), **common)  # pyright: ignore[reportArgumentType]
    return AttemptResult(
        success=ended.success,
        first_try=ended.first_try.success,
        value=ended.verdict.value,
        reason=ended.reason,
        detail=ended.detail,
        criteria=ended.verdict.criteria,
        beliefs=ended.beliefs,
        measurements={**ended.measurements, "steps": float(len(ended.commands))},
        **common,  # pyright: ignore[reportArgumentType]
    )
