"""The shared parts of attempts: environment, demonstration, matcher, motion planner."""

import dataclasses
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np

from dgl_assets import AssetNotFoundError
from dgl_assets.garments.catalogue import check_id
from dgl_assets.robots.importing import load_robot
from dgl_collect.actors import Actor
from dgl_collect.demonstration import load_demonstrated_garment, load_demonstration
from dgl_collect.matching import FindMatcher, make_find_matcher
from dgl_collect.options import MatcherName, RecordOptions, RunOptions
from dgl_collect.skill import Skill, load_skill
from dgl_collect.stage_runner import TRIES, StageRunner
from dgl_collect.steps import Demonstration
from dgl_tasks import load_task
from dgl_tasks.coverage import sample_visible_surface
from dgl_tasks.declaration import Task
from dgl_tasks.env import GarmentEnv
from dgl_tasks.motion import BimanualMotion

O = TypeVar("O", bound=RunOptions)


@dataclass(frozen=True, kw_only=True)
class Setup:
    """Environment and demonstration of a worker, shared by all of its attempts."""

    options: RunOptions
    env: GarmentEnv
    demonstration: Demonstration
    matcher: MatcherName
    """Name of the matcher, for the record."""
    find_matcher: FindMatcher
    demo_cloud: np.ndarray
    """Visible points of the demonstration's garment lying flat [m], shape (N, 3)."""
    motion: BimanualMotion
    skill: Skill | None = None
    """Ways of the demonstration's steps that follow recordings."""

    def make_runner(
        self,
        actor: Actor,
        *,
        rounds: int | None = None,
        tries: int = TRIES,
        demonstration: Demonstration | None = None,
        skill: Skill | None = None,
    ) -> StageRunner:
        """Make the stage runner of an actor; given arguments replace those of the setup."""
        return StageRunner(
            demonstration=demonstration or self.demonstration,
            demo_cloud=self.demo_cloud,
            rule=self.env.task.success,
            get_matcher=lambda: self.find_matcher(self.env),
            actor=actor,
            skill=skill or self.skill,
            rounds=rounds or self.options.rounds,
            tries=tries,
        )


def make_env(task: Task, options: RunOptions) -> GarmentEnv:
    """Build the environment of a task for whole attempts."""
    import torch

    backend = "gpu" if torch.cuda.is_available() else "cpu"
    return GarmentEnv(
        task=task,
        obs_mode="none",
        reward_mode="none",
        sim_backend="physx_cpu",
        render_backend=options.render_backend or backend,
        render_mode="rgb_array",
        look=options.look,
        cloud=options.cloud,
        control_mode=options.control_mode,
        robot=load_robot(options.robot, options.robots),
    )


def make_setup(
    task: str | Task, options: RunOptions | None = None, *, env: GarmentEnv | None = None
) -> Setup:
    """Build the environment and the demonstration of a task.

    Args:
        task: Environment id, file or module of a task of your own, or a declaration.
        options: Options of the run; the defaults when None.
        env: The task's environment; built when None.
    """
    options = options or RunOptions()
    declared = task if isinstance(task, Task) else load_task(task)
    demonstration = load_demonstration(declared, options.demonstration)
    demo_garment = load_demonstrated_garment(demonstration.garment)
    matcher: MatcherName = options.matcher or "exact"
    find_matcher = make_find_matcher(matcher, demo_garment)
    surface = sample_visible_surface(demo_garment.vertices, demo_garment.faces)
    robot = load_robot(options.robot, options.robots)
    return Setup(
        options=options,
        env=env or make_env(declared, options),
        demonstration=demonstration,
        matcher=matcher,
        find_matcher=find_matcher,
        demo_cloud=surface.astype(np.float32),
        motion=BimanualMotion(declared, robot=robot),
        skill=_load_skill(declared, demonstration, options),
    )


def _load_skill(task: Task, demonstration: Demonstration, options: RunOptions) -> Skill | None:
    """Load the skill of an attempt that follows recordings."""
    is_wanted = isinstance(options, RecordOptions) and options.policy == "primitive"
    if not is_wanted and demonstration.recordings is None:
        return None
    return load_skill(task, demonstration, options)


def prepare_options(options: O, task: Task) -> tuple[O, tuple[str, ...]]:
    """Check the options of a run before it begins, and prepare a garment of your own.

    Args:
        options: The requested options.
        task: The task of the run.

    Returns:
        The options with absolute paths, the prepared garment's folder and its matcher; and notes on
        assumptions about the garment, for the user.

    Raises:
        ValueError: If a named file or folder is missing or does not fit.
        AssetError: If a garment or robot cannot be loaded.
        DemonstrationError: If the demonstration is damaged or does not fit the task.
    """
    from dgl_collect.own_garment import prepare_garment

    load_robot(options.robot, options.robots)
    _load_skill(task, load_demonstration(task, options.demonstration), options)
    values = {item.name: getattr(options, item.name) for item in dataclasses.fields(options)}
    # a resumed run may start in another folder
    changes: dict[str, object] = {
        name: path.absolute() for name, path in values.items() if isinstance(path, Path)
    }
    notes: tuple[str, ...] = ()
    if options.garment is not None and Path(options.garment).exists():
        if options.matcher == "exact":
            raise ValueError(
                "matcher exact knows the catalogue's garments alone; take gam for your own"
            )
        own = prepare_garment(Path(options.garment).absolute(), task)  # "." has no name
        changes |= {"garment": str(own.folder), "matcher": "gam"}
        notes = own.notes
    elif options.garment is not None:
        try:
            check_id(options.garment)
        except AssetNotFoundError as err:
            raise ValueError(
                "garment must be a mesh file, the folder of an imported garment or an id of the "
                f"catalogue; {options.garment} is not there ({err})"
            ) from err
        if options.garment.partition("/")[0] != task.category:
            raise ValueError(
                f"garment must be of category {task.category}, which {task.id} is about; "
                f"got {options.garment}"
            )
    return dataclasses.replace(options, **changes), notes  # pyright: ignore[reportArgumentType]
