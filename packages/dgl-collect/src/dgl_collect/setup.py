"""What attempts at a task share: the environment, the demonstration, and who finds its points."""

from dataclasses import dataclass

import numpy as np

from dgl_assets.robots import DEFAULT_ROBOT, Robot
from dgl_assets.robots.importing import load_robot
from dgl_collect.actors import Actor
from dgl_collect.demonstration import (
    check_demonstration,
    load_demonstrated_garment,
    load_demonstration,
)
from dgl_collect.matching import FindMatcher, make_find_matcher
from dgl_collect.stage_runner import TRIES, StageRunner
from dgl_collect.steps import Demonstration
from dgl_tasks import get_task
from dgl_tasks.coverage import sample_visible_surface
from dgl_tasks.declaration import Task
from dgl_tasks.env import GarmentEnv
from dgl_tasks.motion import BimanualMotion
from dgl_tasks.robot import DEFAULT_ROBOT_DIRECTORY


@dataclass(frozen=True, kw_only=True)
class Setup:
    """What all attempts of a worker share."""

    env: GarmentEnv
    demonstration: Demonstration
    matcher: str
    """Its name, for the record."""
    find_matcher: FindMatcher
    demo_cloud: np.ndarray
    """Visible points of the demonstration's garment lying flat [m], shape (N, 3)."""
    motion: BimanualMotion

    def make_runner(
        self,
        actor: Actor,
        *,
        rounds: int | None = None,
        tries: int = TRIES,
        demonstration: Demonstration | None = None,
    ) -> StageRunner:
        """Make what lets an actor carry out the task; see `StageRunner`."""
        return StageRunner(
            demonstration=demonstration or self.demonstration,
            demo_cloud=self.demo_cloud,
            rule=self.env.task.success,
            get_matcher=lambda: self.find_matcher(self.env),
            actor=actor,
            rounds=rounds,
            tries=tries,
        )


def make_env(
    task: str | Task, *, robot: Robot, look: str, render_backend: str | None = None
) -> GarmentEnv:
    """Build the environment of a task for whole episodes; arguments as of `make_setup`."""
    import torch

    return GarmentEnv(
        task=task,
        obs_mode="none",
        reward_mode="none",
        sim_backend="physx_cpu",
        render_backend=render_backend or ("gpu" if torch.cuda.is_available() else "cpu"),
        render_mode="rgb_array",
        look=look,
        robot=robot,
    )


def make_setup(
    task: str | Task,
    *,
    demonstration: Demonstration | None = None,
    render_backend: str | None = None,
    look: str = "studio",
    matcher: str = "exact",
    robot: str = DEFAULT_ROBOT.name,
    robots: str | None = None,
) -> Setup:
    """Build the environment of a task, and what a demonstration of it needs.

    Args:
        task: Environment id, or a declaration of one's own.
        demonstration: Of that task; the packaged one when None.
        render_backend: ManiSkill's; "gpu" where there is CUDA and "cpu" elsewhere when None.
        look: "studio" or "random".
        matcher: Finds the demonstrated points; see `dgl_collect.matching.MatcherName`.
        robot: Name of arm and hand.
        robots: Folder of imported robots, for names that are not built in.
    """
    declared = task if isinstance(task, Task) else get_task(task)
    if demonstration is None:
        demonstration = load_demonstration(declared.id)
    else:
        check_demonstration(demonstration, declared, source="demonstration")
    demo_garment = load_demonstrated_garment(demonstration.garment)
    find_matcher = make_find_matcher(matcher, demo_garment)
    surface = sample_visible_surface(demo_garment.vertices, demo_garment.faces)
    model = load_robot(robot, robots)
    env = make_env(declared, robot=model, look=look, render_backend=render_backend)
    return Setup(
        env=env,
        demonstration=demonstration,
        matcher=matcher,
        find_matcher=find_matcher,
        demo_cloud=surface.astype(np.float32),
        motion=BimanualMotion(declared, DEFAULT_ROBOT_DIRECTORY, robot=model),
    )
