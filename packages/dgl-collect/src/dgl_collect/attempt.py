"""Attempts at a task by its demonstration: the runner that the collection's workers build."""

import logging
import time
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from dgl_assets import load_garment
from dgl_assets.robots import DEFAULT_ROBOT
from dgl_assets.robots.importing import load_robot
from dgl_collect.demonstration import load_demonstration
from dgl_collect.episodes import write_episode
from dgl_collect.execution import Execution, Outcome, Recorded, Setup
from dgl_collect.matching import make_find_matcher
from dgl_collect.results import AttemptResult, Criterion
from dgl_collect.video import VideoWriter, save_png
from dgl_physics import PhysicsError
from dgl_tasks import TaskError, get_task
from dgl_tasks.coverage import sample_visible_surface
from dgl_tasks.motion import BimanualMotion
from dgl_tasks.perception import film
from dgl_tasks.robot import DEFAULT_ROBOT_DIRECTORY

logger = logging.getLogger(__name__)

OPTIONS = ("garment", "render_backend", "look", "matcher", "robot", "robots", "recorded")


def make_attempt_runner(task: str, options: Mapping[str, object]) -> "DemonstrationAttempts":
    """Build the attempts of a task; see `dgl_collect.attempts.AttemptFactory`.

    Args:
        task: Environment id.
        options: "garment": catalogue id to use in every attempt instead of drawing one;
            "render_backend": ManiSkill's, "gpu" where there is CUDA and "cpu" elsewhere by default;
            "look": "studio", the default, or "random": floors and fabrics of all kinds;
            "matcher": "exact", the default, knows the simulated garment, "gam" sees its cloud alone;
            "robot": name of arm and hand, such as "ur10e+allegro"; "robots": folder of imported
            robots, for names that are not built in; "recorded": "stages", the default, or "approaches".
    """
    unknown = set(options) - set(OPTIONS)
    if unknown:
        raise ValueError(f"options must be among {OPTIONS}; got {sorted(unknown)}")
    for name, value in options.items():
        if not isinstance(value, str):
            raise ValueError(f"option {name} must be a string; got {value!r}")
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
        recorded: Recorded = "stages",
    ) -> None:
        """Build the environment and load the demonstration."""
        self._garment, self._recorded = garment, recorded
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
        started = time.perf_counter()
        files = {"video": f"{episode_id}.mp4", "picture": f"{episode_id}.png"}
        with VideoWriter(out_dir / files["video"]) as video:
            execution = Execution(self._setup, seed, video=video, recorded=self._recorded)
            try:
                outcome = execution.execute(self._garment)
            except (TaskError, PhysicsError) as err:
                logger.info("attempt %d: %s", attempt_index, err)
                outcome = Outcome.from_error(err, film(self._setup.env))
                video.add(outcome.picture)
        save_png(out_dir / files["picture"], outcome.picture)
        if outcome.success:
            files["episode"] = f"{episode_id}.h5"
            write_episode(out_dir / files["episode"], execution.make_episode(outcome))
        return AttemptResult(
            index=attempt_index,
            seed=seed,
            success=outcome.success,
            value=outcome.verdict.value if outcome.verdict else None,
            reason=outcome.reason,
            detail=outcome.detail,
            criteria=_to_criteria(outcome),
            garment_id=self._setup.env.garment.name,
            seconds=time.perf_counter() - started,
            frames=sum(record.frame_count for record in execution.records.values()),
            stage_seconds=execution.stage_seconds,
            files=files,
            randomisation=dict(self._setup.env.draws),
            measurements=execution.driver.measurements,
        )


def make_setup(
    task: str,
    *,
    render_backend: str | None = None,
    look: str = "studio",
    matcher: str = "exact",
    robot: str = DEFAULT_ROBOT.name,
    robots: str | None = None,
) -> Setup:
    """Build the environment of a task, and what a demonstration of it needs.

    Args:
        task: Environment id.
        render_backend: ManiSkill's; "gpu" where there is CUDA and "cpu" elsewhere when None.
        look: "studio" or "random".
        matcher: Finds the demonstrated points; see `dgl_collect.matching.MatcherName`.
        robot: Name of arm and hand.
        robots: Folder of imported robots, for names that are not built in.
    """
    import gymnasium
    import torch

    demonstration = load_demonstration(task)
    demo_garment = load_garment(demonstration.garment)
    find_matcher = make_find_matcher(matcher, demo_garment)
    surface = sample_visible_surface(demo_garment.vertices, demo_garment.faces)
    model = load_robot(robot, robots)
    env = gymnasium.make(
        task,
        obs_mode="none",
        reward_mode="none",
        sim_backend="physx_cpu",
        render_backend=render_backend or ("gpu" if torch.cuda.is_available() else "cpu"),
        render_mode="rgb_array",
        look=look,
        robot=model,
    ).unwrapped
    return Setup(
        env=env,  # pyright: ignore[reportArgumentType]
        demonstration=demonstration,
        matcher=matcher,
        find_matcher=find_matcher,
        demo_cloud=surface.astype(np.float32),
        motion=BimanualMotion(get_task(task), DEFAULT_ROBOT_DIRECTORY, robot=model),
    )


def _to_criteria(outcome: Outcome) -> tuple[Criterion, ...]:
    if outcome.verdict is None:
        return ()
    return (
        Criterion(
            name=outcome.verdict.quantity,
            value=outcome.verdict.value,
            comparison=">=",
            threshold=outcome.verdict.threshold,
        ),
    )
