"""One attempt at a task: the demonstration retargeted, executed, recorded and judged."""

import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from dgl_assets.robots import Side
from dgl_collect.demonstration import (
    Demonstration,
    RetargetedWaypoint,
    Stretch,
    retarget_waypoints,
)
from dgl_collect.episodes import FINAL_PARTICLES, Episode, Points, StageRecord
from dgl_collect.matching import FindMatcher
from dgl_collect.point_finder import PointFinder
from dgl_collect.recording import StageRecorder, StageStart
from dgl_collect.rehearsal import rehearse_stage
from dgl_collect.results import package_versions
from dgl_collect.video import VideoWriter
from dgl_gam import Matcher, compute_affordance
from dgl_tasks import perception as see
from dgl_tasks.declaration import Stage
from dgl_tasks.driver import Driver
from dgl_tasks.env import GarmentEnv
from dgl_tasks.errors import UnreachableError
from dgl_tasks.motion import BimanualMotion
from dgl_tasks.success import Verdict

Recorded = Literal["nothing", "stages", "approaches"]
"""What of an attempt is recorded: nothing; its stages; or these and the approaches before them."""
OnLoss = Literal["give up", "lay down", "ignore"]
"""What becomes of a stage in which a hand is seen to hold nothing: the hands let go and park at once; they go on, and lay
down what one of them still holds; or nobody looks."""
Hold = Literal["all", "some", "none"]
"""How many of the working hands held what the stage had to carry."""
TRIES = 3
"""How often a stage is begun at most: hands that are seen to have come up empty, or to have lost what hung on them, go
back. The first stage of a round that is not the last is begun once: the next round goes back."""
LEAST_RISE = 0.004
"""By how much each step of a stretch has to raise the sagging edge, or it is the last one [m]."""
SWING_FRAMES = 20
"""Frames for a lifted garment to swing to rest before it is stretched."""


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


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """How an attempt ended."""

    verdict: Verdict | None
    """What the rule said; None when it did not get that far."""
    picture: np.ndarray
    """What was judged, shape (H, W, 3), uint8."""
    reason: str | None = None
    """Why it failed, in words that can be counted; None for a success."""
    detail: str = ""
    """The same with numbers."""

    @property
    def success(self) -> bool:
        """Whether the task was done."""
        return self.reason is None

    @classmethod
    def from_error(cls, error: Exception, picture: np.ndarray) -> "Outcome":
        """Make the outcome of an attempt that an error ended."""
        kind = type(error).__name__.removesuffix("Error")
        words = "".join(f" {c.lower()}" if c.isupper() else c for c in kind).strip()
        return cls(verdict=None, picture=picture, reason=words, detail=str(error))


class _HoldLost(Exception):  # noqa: N818 - no error, a turn that an attempt takes
    """A hand was seen to hold nothing any more."""


class Execution:
    """The course of one attempt."""

    def __init__(
        self,
        setup: Setup,
        seed: int,
        *,
        video: VideoWriter | None = None,
        driver: Driver | None = None,
        recorded: Recorded = "stages",
    ) -> None:
        """Prepare the attempt of a seed.

        Args:
            setup: What all attempts share.
            seed: Of the attempt.
            video: An open film for people.
            driver: An episode that is driven already; `seed` and `video` are its own then.
            recorded: What is recorded; what the robot does is the same.
        """
        self.setup, self.seed = setup, seed
        self.env, self.motion = setup.env, setup.motion
        self.demonstration = setup.demonstration
        film = None if video is None else video.add
        self.driver = driver or Driver(setup.env, setup.motion, seed=seed, film=film)
        self.records: dict[str, StageRecord] = {}
        """How each stage was carried out the last time, by name."""
        self.stage_seconds: dict[str, float] = {}
        self.finder = PointFinder(setup.env.task, setup.demonstration, setup.demo_cloud)
        """Knows where the demonstration's points are."""
        self._recorded = recorded
        self._carried_out: set[str] = set()
        # of the try that ended last, until its stage counts
        self._newest: dict[str, StageRecord] = {}
        self._kept_events = 0  # of what comes before the stage that a further round begins with

    # The course of an attempt ----------------------------------------------------------------

    def execute(self, garment: str | None = None) -> Outcome:
        """Run all stages and judge.

        Args:
            garment: Catalogue id; drawn from the seed when None.

        Raises:
            TaskError: If a hand cannot go where it has to, or a camera sees no garment.
            PhysicsError: If the simulation fails.
        """
        clock = time.perf_counter()
        self.driver.start(garment)
        self.look()
        self._note_time("observe", clock)
        self.perform()
        clock = time.perf_counter()
        outcome = self._judge()
        self._note_time("judge", clock)
        return outcome

    def look(self) -> None:
        """Find the demonstration's points on the garment as it lies, and whether it lies on its face."""
        self.finder.look(self.driver.see_garment(), self._get_matcher())

    def perform(self) -> None:
        """Run all stages; some or all of them again while the task is seen not to be done, see `Task.rounds`."""
        task = self.env.task
        first = 0
        for number in range(1, task.rounds + 1):
            if self._go_through(first, is_last=number == task.rounds):
                return
            first = self._begin_again(first)

    def _go_through(self, first: int, *, is_last: bool) -> bool:
        """Run the stages from `first` on; false as soon as it is clear that a further round has to follow.

        What is out of reach now is left out while there are further rounds: the stages after it may bring the garment nearer.
        """
        clock = time.perf_counter()
        refused: list[UnreachableError] = []
        for number, stage in enumerate(self.env.task.stages):
            if number < first:
                continue
            if number == self.env.task.again_from:
                self._kept_events = len(self.driver.events)
            # what goes wrong before the stage that a round begins with, the next round would not mend
            is_final = is_last or number < self.env.task.again_from
            hold: Hold = "none"
            is_left_out = False
            try:
                hold = self._run_stage(stage, is_final=is_final)
            except UnreachableError as err:
                if is_final:
                    raise
                refused.append(err)
                is_left_out = True
            clock = self._note_time(stage.name, clock)
            if hold != "all":
                if not self.driver.is_parked:
                    self.driver.retreat(tuple(stage.grasp), stage.leave)
                self.driver.settle()
            if hold == "all" or (hold == "some" and self._is_nearly_done()):
                self._carried_out.add(stage.name)
                self.records |= self._newest
            elif not is_left_out:
                return False
        if len(refused) == len(self.env.task.stages) - first and first <= self.env.task.again_from:
            raise refused[0]  # and would be again: the next round begins with the same
        is_whole = len(self._carried_out) == len(self.env.task.stages)
        return is_last or (is_whole and self._is_done())

    def _is_done(self) -> bool:
        self.driver.settle()
        return self.driver.judge(self.finder.points).reason is None

    def _is_nearly_done(self) -> bool:
        return self.driver.is_nearly_done(self.finder.points)

    def _begin_again(self, began_with: int) -> int:
        """Forget what went wrong in what will be done again, and look how the garment lies now.

        Args:
            began_with: Number of the stage that the last round began with.

        Returns:
            Number of the stage that the next round begins with.
        """
        task = self.env.task
        del self.driver.events[self._kept_events :]
        self._count("further_rounds")
        kept = task.stages[task.again_from].name
        was_mended = began_with > task.again_from
        if not was_mended and kept in self._carried_out and self._is_nearly_done():
            return task.again_from + 1
        if task.again_from == 0:  # else how the garment lay at first says where it has to go
            clock = time.perf_counter()
            self.look()
            self._note_time("observe", clock)
        return task.again_from

    def _count(self, what: str) -> None:
        self.driver.measurements[what] = self.driver.measurements.get(what, 0.0) + 1.0

    def find_grasps(
        self, stage: Stage, cloud: np.ndarray
    ) -> tuple[dict[Side, np.ndarray], np.ndarray]:
        """Find a stage's grasp points in the garment's cloud.

        Args:
            stage: The stage.
            cloud: What is seen of the garment [m], shape (2048, 3), world frame.

        Returns:
            Where each working hand grasps [m], shape (3,), and the similarity of every point of the cloud to the
            places that the left and the right hand grasp, shape (2, 2048).

        Raises:
            PerceptionError: If nothing of the garment is near where a point was.
        """
        found, similarity = self.finder.find_grasps(stage, cloud, self._get_matcher())
        return {side: stage.place_grasp(side, p) for side, p in found.items()}, similarity

    def _get_matcher(self) -> Matcher:
        return self.setup.find_matcher(self.env)

    def _run_stage(self, stage: Stage, *, is_final: bool) -> Hold:
        """Carry out a stage, where a further try can mend it until the garment is held.

        Args:
            stage: The stage.
            is_final: Whether no further round can mend what goes wrong.

        Returns:
            How many hands held the garment to the end, as far as it was looked for: not all of them only in the stage
            that the next round begins with.
        """
        stages = self.env.task.stages
        if stage is stages[self.env.task.again_from] and not is_final:
            try:
                return self._try_stage(stage, on_loss="lay down")
            except _HoldLost:
                return "none"
        for _ in range(TRIES - 1):
            try:
                return self._try_stage(stage, on_loss="give up")
            except _HoldLost:
                self._give_up(stage)
            if stage is stages[0]:
                self.look()  # what has been let go lies in another way
        return self._try_stage(stage, on_loss="ignore")

    def _try_stage(self, stage: Stage, *, on_loss: OnLoss) -> Hold:
        """Carry out a stage; "some" if a hand was seen to lose its hold, which is looked for unless it is ignored.

        Raises:
            _HoldLost: If a hand was seen to lose its hold, and the stage is given up then.
        """
        demonstrated = self.demonstration.get_stage(stage.name)
        points = self.finder.points
        cloud_step = self.driver.step_count
        # seen again: the stages before may have dragged the garment along
        cloud = self.driver.see_garment()
        if stage.looks_again:
            points = self.finder.find_points(cloud, self._get_matcher())
        grasp, similarity = self.find_grasps(stage, cloud)
        waypoints = retarget_waypoints(demonstrated, points)
        recorder = None
        if self._recorded != "nothing":
            recorder = StageRecorder(
                StageStart(
                    name=stage.name,
                    garment_point_cloud=cloud,
                    points_affordance_feature=compute_affordance(similarity),
                    points=self._describe(points),
                    cloud_step=cloud_step,
                )
            )
        orientations = self.driver.approach(
            stage,
            grasp,
            [lambda side, q: rehearse_stage(self.motion, stage, side, q, grasp[side], waypoints)],
            recorder if self._recorded == "approaches" else None,
        )
        if recorder is not None:
            recorder.begin(self.driver.step_count)
        send, hands = self.driver.send, self.motion.set_hands
        send(hands(dict.fromkeys(grasp, demonstrated.grasp_pose)), recorder)
        is_held = True
        for number in range(len(waypoints)):
            waypoint = waypoints[number]
            rows = self.motion.move(waypoint.targets, orientations, spacing=waypoint.spacing)
            send(rows, recorder)
            is_held &= self._check_hold(stage, number, on_loss)
            self._note_grasp(stage, "missed grasp" if number == 0 else "slipped", number)
            # what has been lost cannot be stretched
            if waypoint.stretch is not None and not self.driver.events:
                seen = self.stretch(waypoint, waypoint.stretch, orientations, recorder)
                is_held &= self._check_hold(stage, number, on_loss)
                waypoints = retarget_waypoints(demonstrated, points, seen=seen)
                self._note_grasp(stage, "slipped", number)
        send(hands(dict.fromkeys(grasp, demonstrated.release_pose)), recorder)
        self._newest = {} if recorder is None else {stage.name: recorder.finish()}
        self.driver.leave(waypoints[-1].targets, orientations, stage.leave)
        return "all" if is_held else "some"

    def _check_hold(self, stage: Stage, number: int, on_loss: OnLoss) -> bool:
        """Whether no hand is seen to hold nothing at a waypoint; true where nobody looks.

        It is looked at after the first waypoint, and after each one of a garment that hangs from both hands.
        """
        hangs = self.demonstration.get_stage(stage.name).waypoints[0].stretch is not None
        if on_loss == "ignore" or not (number == 0 or hangs):
            return True
        empty = self.driver.find_empty(stage, self.driver.see_points())
        if empty and (on_loss == "give up" or len(empty) == len(stage.grasp)):
            raise _HoldLost  # also where nothing is left to lay down
        return not empty

    def _give_up(self, stage: Stage) -> None:
        self.driver.retreat(tuple(stage.grasp), stage.leave)
        self.driver.settle()
        self._count("further_tries")

    def stretch(
        self,
        waypoint: RetargetedWaypoint,
        stretch: Stretch,
        orientations: Mapping[Side, np.ndarray],
        recorder: StageRecorder | None,
    ) -> dict[str, float]:
        """Move the hands apart until the garment between them is taut; returns what is seen then."""
        send = self.driver.send
        targets = dict(waypoint.targets)
        outwards = targets["right"] - targets["left"]
        outwards /= np.linalg.norm(outwards)
        send(self.motion.hold(SWING_FRAMES), recorder)
        hanging = self.driver.see_hanging()
        for _ in range(round(stretch.at_most / stretch.step)):
            # an edge as low as the garment is long is none: it hangs from one hand
            if not stretch.sag < hanging.sag < hanging.length:
                break
            targets["left"] = targets["left"] - stretch.step * outwards
            targets["right"] = targets["right"] + stretch.step * outwards
            send(self.motion.move(targets, orientations, spacing=stretch.spacing), recorder)
            before, hanging = hanging, self.driver.see_hanging()
            if hanging.sag > before.sag - LEAST_RISE:
                break  # it slides out of a hand instead
        span = float(np.linalg.norm(targets["right"] - targets["left"]))
        return {"half_span": span / 2, "hanging": hanging.length}

    def _describe(self, points: Mapping[str, np.ndarray]) -> Points:
        return {
            name: {
                "xyz": [float(v) for v in xyz],
                "uv": list(see.find_pixel(self.env, "environment_camera", xyz)),
            }
            for name, xyz in points.items()
        }

    # Judging ---------------------------------------------------------------------------------

    def _judge(self) -> Outcome:
        self.driver.settle()
        judgement = self.driver.judge(self.finder.points)
        verdict, reason, detail = judgement.verdict, judgement.reason, ""
        if not verdict.success:
            shortfall = f"{verdict.quantity}: {verdict.value:.3f}, needed {verdict.threshold:.2f}"
            # the first thing that went wrong on the way says more than the result
            reason, detail = self.driver.events[0] if self.driver.events else (reason, "")
            detail = f"{detail}; {shortfall}" if detail else shortfall
        return Outcome(verdict=verdict, picture=judgement.picture, reason=reason, detail=detail)

    def _note_grasp(self, stage: Stage, reason: str, number: int) -> None:
        for side, nearest in self.driver.find_empty(stage, self.env.get_particles()).items():
            where = f"{stage.name}, waypoint {number}, {side} hand"
            far = f"{nearest:.2f} m" if np.isfinite(nearest) else "nothing raised"
            self.driver.events.append((reason, f"{where}: nearest raised cloth {far}"))

    def _note_time(self, name: str, since: float) -> float:
        now = time.perf_counter()
        self.stage_seconds[name] = self.stage_seconds.get(name, 0.0) + now - since
        return now

    def make_episode(self, outcome: Outcome) -> Episode:
        """Put the recorded stages of a judged attempt together."""
        if outcome.verdict is None:
            raise ValueError("only a judged attempt makes an episode; got one that an error ended")
        return Episode(
            task=self.env.task.id,
            seed=self.seed,
            garment_id=self.env.garment.name,
            robot=self.motion.robot.name,
            matcher=self.setup.matcher,
            success=outcome.success,
            success_value=outcome.verdict.value,
            stages=tuple(self.records[stage.name] for stage in self.env.task.stages),
            randomisation=dict(self.env.draws),
            measurements=dict(self.driver.measurements),
            package_versions=package_versions(),
            commands=np.stack(self.driver.commands),
            extra={FINAL_PARTICLES: self.env.get_particles().astype(np.float32)},
        )
