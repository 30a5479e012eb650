"""HALO and its ablations in the laboratory: policies from their checkpoints, and the driver that they ask for."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from dexgarmentlab.evaluation.fingers import FingerCommands
from dgl_assets.robots import SIDES, Side
from dgl_collect.demonstration import retarget_waypoints
from dgl_collect.point_finder import HANDS_APART, PointFinder
from dgl_collect.rehearsal import rehearse_stage
from dgl_sadp import (
    HALO,
    HaloStage,
    Hold,
    PolicyConfig,
    PolicyRunner,
    StageError,
    load_policy,
    read_card,
)
from dgl_tasks import perception as see
from dgl_tasks.approach import find_reachable
from dgl_tasks.declaration import Stage, Task
from dgl_tasks.driver import Driver
from dgl_tasks.errors import PerceptionError, UnreachableError
from dgl_tasks.motion import BimanualMotion, Rehearsal

if TYPE_CHECKING:
    from dgl_collect.execution import Setup

__all__ = ["LEARNED", "HaloDriver", "HaloMethod", "Learned", "check_checkpoints", "count_chunks"]

POLICY_FILE = "policy.safetensors"


@dataclass(frozen=True, kw_only=True)
class Learned:
    """A learned method: which policies it takes, and whether they begin at the matched points."""

    policies: tuple[str, ...]
    """Methods of `dgl train` whose policies it takes."""
    use_gam: bool
    """Whether points are matched and the hands sent there; otherwise the policy finds its way from the parked arms."""


LEARNED: Mapping[str, Learned] = {
    "halo": Learned(policies=("sadp", "sadp-g"), use_gam=True),
    "sadp": Learned(policies=("sadp", "sadp-g"), use_gam=False),
    "gam-dp3": Learned(policies=("dp3",), use_gam=True),
    "dp3": Learned(policies=("dp3",), use_gam=False),
    "dp": Learned(policies=("dp",), use_gam=False),
}
"""HALO; without GAM; without SADP; and the baselines."""


class HaloDriver:
    """Gives HALO what it asks of an environment: `dgl_sadp.EnvironmentDriver`, by `dgl_tasks.driver.Driver`."""

    def __init__(
        self,
        driver: Driver,
        guide: "Guide | None" = None,
    ) -> None:
        """Take over an episode.

        Args:
            driver: After its start.
            guide: Says where the demonstration's points are: those of the task's rule, and of where the hands will have
                to go. None where nothing is matched: the hands are not brought anywhere then.
        """
        self._driver = driver
        self._guide = guide
        self._cloud = np.zeros((0, 3))
        self._stages = driver.env.task.stages
        self._stage = self._stages[0]
        self._begun: set[int] = set()
        self._were_down: set[Side] = set()
        self._empty: set[Side] = set()
        self._fingers: FingerCommands | None = None

    def begin_stage(self, stage: int) -> dict[str, np.ndarray]:
        """Look at the garment, and at the props where there are some; what has been let go is waited for, as in collection."""
        if stage in self._begun:
            self._driver.settle()
        self._begun.add(stage)
        self._stage = self._stages[stage - 1]
        self._were_down, self._empty, self._fingers = set(), set(), None
        driver = self._driver
        seen = {"garment_point_cloud": driver.see_garment()}
        self._cloud = seen["garment_point_cloud"]
        if stage == 1 and self._guide is not None:
            self._guide.look(self._cloud)
        if driver.env.props:
            picture = see.take_picture(driver.env, "environment_camera")
            seed = driver.cloud_seed
            seen["object_point_cloud"] = see.get_object_cloud(driver.env, picture, seed=seed)
        return seen

    def move_hands(self, left: np.ndarray | None, right: np.ndarray | None) -> None:
        """Go above the points, down to the height at which the stage grasps, and wait.

        The hands are turned as they were for the policy's data: so that all of the demonstrated stage is within reach, or
        as much of it as can be. The policy goes its own way. A hand whose point is out of reach takes hold of the garment
        as near to it as it can.

        Raises:
            StageError: If an arm can reach neither its point nor what is near it.
        """
        wanted: dict[Side, np.ndarray | None] = {"left": left, "right": right}
        points: dict[Side, np.ndarray] = {}
        rehearsals: list[Rehearsal] = []
        motion = self._driver.motion
        try:
            for side, point in wanted.items():
                if point is not None:
                    place = find_reachable(motion, self._stage, side, point, self._cloud)
                    points[side] = self._stage.place_grasp(side, place)
            if self._guide is not None:
                rehearsals = self._guide.plan(motion, self._stage, self._cloud, points)
            self._driver.approach(self._stage, points, rehearsals)
        except UnreachableError as err:
            raise StageError(str(err)) from err

    def observe(self) -> dict[str, np.ndarray]:
        """Look and feel."""
        self._were_down.update(s for s in self._stage.grasp if self._driver.is_low(s))
        seen = self._driver.observe().as_arrays()
        if self._fingers is None:
            self._fingers = FingerCommands(seen["joint_state"])
        return seen

    def execute(self, target: np.ndarray) -> dict[str, np.ndarray]:
        """Go to joint targets within five control steps."""
        self._driver.execute(np.asarray(target)[None])
        seen = self.observe()
        if self._fingers is not None:
            self._fingers.add(target)
        return seen

    def see_hold(self) -> Hold:
        """Look which hands that have been down at the garment, and have come up, hold nothing, as collection does.

        One look may be past cloth that the hand hides: the next one has to say the same. A hand that its policy has told to
        let go is not looked at any more.
        """
        try:
            points = self._driver.see_points()
        except PerceptionError:
            return "all"
        before = self._empty
        self._empty = self._were_down.intersection(self._driver.find_empty(self._stage, points))
        if self._fingers is not None:
            self._empty -= self._fingers.find_opened(self._stage.grasp)
        lost = before & self._empty
        if not lost:
            return "all"
        return "none" if len(lost) == len(self._stage.grasp) else "some"

    def end_stage(self, stage: int) -> None:
        """Open the working hands, leave the cloth and park."""
        declared = self._stages[stage - 1]
        sides: tuple[Side, ...] = tuple(s for s in SIDES if s in declared.grasp)
        if not self._driver.is_parked:
            self._driver.retreat(sides, declared.leave)

    def is_done(self) -> bool:
        """Wait for the garment to come to rest, and apply the task's rule to what the camera sees, as collection does."""
        self._driver.settle()
        return self._driver.judge(self._points).reason is None

    def is_nearly_done(self) -> bool:
        """Apply the rule of the task to what the camera sees, as collection does: `dgl_tasks.Task.nearly_done`."""
        return self._driver.is_nearly_done(self._points)

    @property
    def _points(self) -> Mapping[str, np.ndarray]:
        return {} if self._guide is None else self._guide.points


class Guide:
    """What the demonstration says about the garment of an episode."""

    def __init__(self, setup: "Setup") -> None:
        self._setup = setup
        self._finder = PointFinder(setup.env.task, setup.demonstration, setup.demo_cloud)

    @property
    def points(self) -> Mapping[str, np.ndarray]:
        """All its points, where they lay when the garment was last looked at as a whole [m], shape (3,), world frame."""
        return self._finder.points

    def look(self, cloud: np.ndarray) -> None:
        """Find the points in a cloud of the garment [m], shape (N, 3), world frame."""
        self._finder.look(cloud, self._setup.find_matcher(self._setup.env))

    def plan(
        self,
        motion: BimanualMotion,
        stage: Stage,
        cloud: np.ndarray,
        grasp: Mapping[Side, np.ndarray],
    ) -> list[Rehearsal]:
        """Give what rehearses a stage for a hand: all of it, and ever less of it, down to the approach.

        Args:
            motion: Plans.
            stage: The stage.
            cloud: What is seen of the garment now [m], shape (N, 3), world frame.
            grasp: Where each working hand grasps [m], shape (3,), world frame.
        """
        points = self.points
        if stage.looks_again:
            points = self._finder.find_points(cloud, self._setup.find_matcher(self._setup.env))
        demonstrated = self._setup.demonstration.get_stage(stage.name)
        waypoints = retarget_waypoints(demonstrated, points)

        def rehearse(side: Side, q: np.ndarray, *, count: int, leaves: bool = False) -> None:
            part = waypoints[:count]
            rehearse_stage(motion, stage, side, q, grasp[side], part, leaves=leaves)

        count = len(waypoints)
        beginnings = [partial(rehearse, count=number) for number in range(count, -1, -1)]
        return [partial(rehearse, count=count, leaves=True), *beginnings]


class _PresentMatcher:
    """Asks for the matcher of the garment as it lies now."""

    def __init__(self, setup: "Setup") -> None:
        self._setup = setup

    def match(
        self, source_cloud: np.ndarray, source_points: np.ndarray, target_cloud: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Match as `dgl_gam.Matcher`."""
        matcher = self._setup.find_matcher(self._setup.env)
        return matcher.match(source_cloud, source_points, target_cloud)


class HaloMethod:
    """A learned method as an `EpisodePolicy` of `dgl_tasks.policy`."""

    def __init__(
        self,
        name: str,
        setup: "Setup",
        checkpoints: Path,
        *,
        chunks: int | None = None,
        rounds: int | None = None,
        device: str = "cpu",
    ) -> None:
        """Load a policy for each stage.

        Args:
            name: One of `LEARNED`.
            setup: Environment, demonstration and matcher.
            checkpoints: Folder with `stage_<k>/policy.safetensors` for each stage.
            chunks: Predictions that each stage gets; as long as the longest recorded stage when None.
            rounds: How often the stages are gone through at most; as the task says when None.
            device: "cpu" or "cuda".

        Raises:
            ValueError: If a policy is of another method, stage or task.
            CheckpointError: If a policy is missing or damaged.
        """
        task = setup.env.task
        check_checkpoints(task, checkpoints, use_gam=LEARNED[name].use_gam)
        stages = []
        for number, stage in enumerate(task.stages, start=1):
            path = _locate(checkpoints, number)
            policy = load_policy(path, device=device)
            if policy.config.method not in LEARNED[name].policies:
                raise ValueError(
                    f"{path}: {name} takes a policy of {' or '.join(LEARNED[name].policies)}; "
                    f"got {policy.config.method}"
                )
            count = chunks or count_chunks(policy.config, read_card(path))
            points = {side: _find_source(setup, names) for side, names in stage.grasp.items()}
            stages.append(
                HaloStage(
                    policy=PolicyRunner(policy),
                    chunks=count,
                    source_cloud=setup.demo_cloud,
                    left=points.get("left"),
                    right=points.get("right"),
                    moved_at_most=stage.moved_at_most,
                )
            )
        self._setup = setup
        self.halo = HALO(
            _PresentMatcher(setup),
            stages,
            use_gam=LEARNED[name].use_gam,
            turns_over=task.turns_over,
            rounds=rounds or task.rounds,
            again_from=task.again_from + 1,
            apart=HANDS_APART,
        )

    def run(self, driver: Driver) -> None:
        """Carry out all stages, or end where one cannot be carried out, which is an event of the driver's."""
        is_asked = self.halo.rounds > 1 and self._setup.env.task.success.points
        guide = Guide(self._setup) if self.halo.use_gam or is_asked else None
        halo_driver = HaloDriver(driver, guide)
        try:
            records = self.halo.run(halo_driver, seed=driver.seed)
        except (StageError, PerceptionError) as err:
            is_unreachable = isinstance(err.__cause__, UnreachableError)
            driver.events.append(("unreachable" if is_unreachable else "perception", str(err)))
            return
        further = {
            "further_tries": sum(record.tries - 1 for record in records),
            "further_rounds": records[-1].round - 1,
        }
        driver.measurements |= {name: float(count) for name, count in further.items() if count}


def check_checkpoints(task: Task, checkpoints: Path, *, use_gam: bool) -> None:
    """Check, without loading weights, that there is a fitting policy for each stage.

    Args:
        task: What is to be done.
        checkpoints: Folder with `stage_<k>/policy.safetensors`.
        use_gam: Whether the hands are sent to matched points first; a policy has learned the way there only where they
            are not.

    Raises:
        ValueError: If a policy is missing, of another stage or task, or begins elsewhere.
        CheckpointError: If a file is damaged.
    """
    for number in range(1, len(task.stages) + 1):
        path = _locate(checkpoints, number)
        if not path.is_file():
            raise ValueError(f"--checkpoints must hold a policy for stage {number}; no {path}")
        card = read_card(path)
        if card.get("stage", number) != number:
            raise ValueError(f"{path}: it must be of stage {number}; got {card['stage']}")
        tasks = card.get("tasks", [task.id])
        if task.id not in tasks:
            raise ValueError(f"{path}: it must be of task {task.id}; got {', '.join(tasks)}")
        if card.get("training", {}).get("with_approach", False) is use_gam:
            wanted, got = ("--gam", "--no-gam") if use_gam else ("--no-gam", "--gam")
            raise ValueError(f"{path}: it must be trained with {wanted}; got one of {got}")


def count_chunks(config: PolicyConfig, card: Mapping[str, Any]) -> int:
    """Say how many predictions a stage gets: enough for the longest recording; a policy stays where it has ended.

    Args:
        config: The policy's.
        card: How it was trained.

    Raises:
        ValueError: If the card does not tell how long recordings were.
    """
    frames = card.get("longest")
    if not isinstance(frames, int):
        raise ValueError(f"the policy's card must tell the longest recording; got {frames}")
    return math.ceil(frames / config.action_steps)


def _find_source(setup: "Setup", names: str | tuple[str, ...]) -> np.ndarray:
    """Give the place that a hand grasps on the demonstration's garment [m], shape (3,): midway between several."""
    chosen = (names,) if isinstance(names, str) else names
    return np.mean([setup.demonstration.points[name] for name in chosen], axis=0)


def _locate(checkpoints: Path, number: int) -> Path:
    return checkpoints / f"stage_{number}" / POLICY_FILE
