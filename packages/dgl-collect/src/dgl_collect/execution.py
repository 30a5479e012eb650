"""One attempt at a task: the demonstration retargeted, executed, recorded and judged."""

import time
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from dgl_assets.robots import SIDES, Side
from dgl_collect.demonstration import Demonstration, RetargetedWaypoint, retarget_waypoints
from dgl_collect.episodes import Episode, Points, StageRecord
from dgl_collect.matching import FindMatcher
from dgl_collect.recording import STEPS_PER_FRAME, Observation, StageRecorder, StageStart
from dgl_collect.results import package_versions
from dgl_collect.video import VideoWriter
from dgl_gam import compute_affordance
from dgl_tasks import perception as see
from dgl_tasks.declaration import Stage
from dgl_tasks.env import GarmentEnv
from dgl_tasks.errors import UnreachableError
from dgl_tasks.grasps import point_along_fingers, roll_thumb_down, wrist_to_grasp
from dgl_tasks.motion import BimanualMotion
from dgl_tasks.success import Before, Verdict

APPROACH_HEIGHT = 0.15
"""Height above the grasp point from which a hand comes down [m]."""
ROLL = np.radians(60)
"""How far an opened hand rolls for its thumb to point down, out of the cloth [rad]."""
ROLL_LIFT = 0.04
"""How far it rises while it rolls [m]."""
ROLL_FRAMES = 15
"""Frames for the cloth to slide off the thumb."""
DRAW_BACKS = (0.04, 0.02, 0.0)
"""How far it then draws back, level [m]: the first of these that the arm can reach."""
CLEARANCE = 0.15
"""How far it then rises [m]."""
LEAVE_SPACING = 0.005
"""Distance between samples of its way [m]; 0.005 is 0.3 m/s."""
RELEASE_FRAMES = 15
"""Frames for the cloth to fall from an opened hand before it leaves."""
ARRIVAL_FRAMES = 10
"""Frames for the arm to arrive at the grasp points before the hand closes."""
FINAL_FRAMES = 50
"""Frames between the hands being out of the way and the verdict."""
HELD_DISTANCE = 0.12
"""A hand holds the garment while a raised particle is this near its grasp point [m]."""
HELD_HEIGHT = 0.05
"""What lies higher than this over the ground counts as raised [m]."""


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


class Execution:
    """The course of one attempt."""

    def __init__(self, setup: Setup, seed: int, *, video: VideoWriter | None = None) -> None:
        """Prepare the attempt of a seed; `video` is an open film for people."""
        self.setup, self.seed, self.video = setup, seed, video
        self.env, self.motion = setup.env, setup.motion
        self.demonstration = setup.demonstration
        self.records: list[StageRecord] = []
        self.stage_seconds: dict[str, float] = {}
        self.measurements: dict[str, float] = {}
        self.events: list[tuple[str, str]] = []
        self._step_count = 0
        self._cloud_seeds = np.random.default_rng([seed, 1])

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
        self.env.reset(seed=self.seed, options={} if garment is None else {"garment": garment})
        self.motion.reset(self.motion.robot.compute_start("open"))
        self._send(self.motion.park())
        points = self._find_points(self._see_garment())
        clock = self._note_time("observe", clock)
        for stage in self.env.task.stages:
            self._run_stage(stage, points)
            clock = self._note_time(stage.name, clock)
        self._send(self.motion.hold(FINAL_FRAMES))
        outcome = self._judge(points)
        self._note_time("judge", clock)
        return outcome

    def _run_stage(self, stage: Stage, points: dict[str, np.ndarray]) -> None:
        demonstrated = self.demonstration.get_stage(stage.name)
        names = [stage.grasp.get(side, next(iter(stage.grasp.values()))) for side in SIDES]
        cloud = self._see_garment()
        if stage.looks_again:
            points = self._find_points(cloud)
        # seen again: the stages before may have dragged the garment along
        found, similarity = self._match(names, cloud)
        grasp = {
            side: np.array([*cloud[index][:2], stage.grasp_height], dtype=float)
            for side, index in zip(SIDES, found, strict=True)
            if side in stage.grasp
        }
        waypoints = retarget_waypoints(demonstrated, points)
        orientations = self.motion.choose_turns(
            stage.orientation,
            tuple(grasp),
            lambda side, q: self._plan_hand(side, q, grasp[side], waypoints),
        )
        above = {s: p + np.array([0, 0, APPROACH_HEIGHT]) for s, p in grasp.items()}
        self._send(self.motion.reach(above, orientations))
        self._send(self.motion.move(grasp, orientations))
        self._send(self.motion.hold(ARRIVAL_FRAMES))
        recorder = StageRecorder(
            StageStart(
                name=stage.name,
                garment_point_cloud=cloud,
                points_affordance_feature=compute_affordance(similarity),
                points=self._describe(points),
            )
        )
        self._send(self.motion.set_hands(dict.fromkeys(grasp, demonstrated.grasp_pose)), recorder)
        for number, waypoint in enumerate(waypoints):
            rows = self.motion.move(waypoint.targets, orientations, spacing=waypoint.spacing)
            self._send(rows, recorder)
            self._note_grasp(stage, "missed grasp" if number == 0 else "slipped", number)
        self._send(self.motion.set_hands(dict.fromkeys(grasp, demonstrated.release_pose)), recorder)
        self.records.append(recorder.finish())
        self._send(self.motion.hold(RELEASE_FRAMES))
        for rows in plan_leave(self.motion, waypoints[-1].targets, orientations):
            self._send(rows)
        self._send(self.motion.park())

    def _plan_hand(
        self,
        side: Side,
        orientation: np.ndarray,
        grasp: np.ndarray,
        waypoints: list[RetargetedWaypoint],
    ) -> None:
        """Plan one hand's whole stage; raises where it cannot go."""
        orientations = {side: orientation}
        self.motion.reach({side: grasp + np.array([0, 0, APPROACH_HEIGHT])}, orientations)
        self.motion.move({side: grasp}, orientations)
        for waypoint in waypoints:
            target = {side: waypoint.targets[side]}
            self.motion.move(target, orientations, spacing=waypoint.spacing)
        plan_leave(self.motion, {side: waypoints[-1].targets[side]}, orientations)

    # Acting and seeing -----------------------------------------------------------------------

    def _send(self, rows: np.ndarray, recorder: StageRecorder | None = None) -> None:
        for row in rows:
            target = row.astype(np.float32)
            if recorder is not None:
                recorder.before_step(target, self._observe)
            if self._step_count % STEPS_PER_FRAME == 0:
                if self.video is not None:
                    self.video.add(see.film(self.env))
                self._measure()
            self.env.advance(target)
            self._step_count += 1

    def _observe(self) -> Observation:
        picture = see.take_picture(self.env, "environment_camera")
        return Observation(
            joint_state=self.env.agent.get_joint_state()[0].cpu().numpy().astype(np.float32),
            ee_pose=self.env.agent.get_ee_poses()[0].cpu().numpy().astype(np.float32),
            image=picture.rgb,
            env_point_cloud=see.get_environment_cloud(self.env, picture, seed=self._draw_seed()),
        )

    def _see_garment(self) -> np.ndarray:
        picture = see.take_picture(self.env, "garment_camera")
        return see.get_garment_cloud(self.env, picture, seed=self._draw_seed())

    def _find_points(self, cloud: np.ndarray) -> dict[str, np.ndarray]:
        """Find all points of the demonstration in a cloud [m], shape (3,), world frame."""
        names = list(self.demonstration.points)
        found, _ = self._match(names, cloud)
        return {n: cloud[i].astype(np.float64) for n, i in zip(names, found, strict=True)}

    def _match(self, names: list[str], cloud: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        matcher = self.setup.find_matcher(self.env)
        wanted = np.array([self.demonstration.points[name] for name in names])
        return matcher.match(self.setup.demo_cloud, wanted, cloud)

    def _draw_seed(self) -> int:
        return int(self._cloud_seeds.integers(2**31))

    def _describe(self, points: Mapping[str, np.ndarray]) -> Points:
        return {
            name: {
                "xyz": [float(v) for v in xyz],
                "uv": list(see.find_pixel(self.env, "environment_camera", xyz)),
            }
            for name, xyz in points.items()
        }

    # Judging ---------------------------------------------------------------------------------

    def _judge(self, points: Mapping[str, np.ndarray]) -> Outcome:
        picture = see.take_picture(self.env, "garment_camera")
        seen = see.get_garment_points(self.env, picture)
        rule = self.env.task.success
        # The flat garment is known of every garment that is to be flung; the points are what was seen.
        before = Before(
            points={name: points[name] for name in rule.points},
            flat_area=self.env.before.flat_area,
        )
        verdict = rule(seen, before)
        state = self.env.evaluate()
        reason, detail = None, ""
        if not verdict.success:
            shortfall = f"{verdict.quantity}: {verdict.value:.3f}, needed {verdict.threshold:.2f}"
            # the first thing that went wrong on the way says more than the result
            reason, detail = self.events[0] if self.events else ("below the threshold", "")
            detail = f"{detail}; {shortfall}" if detail else shortfall
        elif not state["is_released"].item():
            reason = "not released"
        elif not state["is_still"].item():
            reason = "still moving"
        return Outcome(verdict=verdict, picture=picture.rgb, reason=reason, detail=detail)

    def _grasp_point(self, side: Side) -> np.ndarray:
        pose = self.env.agent.get_ee_poses()[0, SIDES.index(side)].cpu().numpy()
        return wrist_to_grasp(pose[:3], pose[3:], side, robot=self.motion.robot)

    def _note_grasp(self, stage: Stage, reason: str, number: int) -> None:
        particles = self.env.get_particles()
        raised = particles[particles[:, 2] > HELD_HEIGHT]
        for side in stage.grasp:
            point = self._grasp_point(side)
            if point[2] < HELD_HEIGHT + HELD_DISTANCE / 2:
                continue  # so low that what it holds need not be raised
            offset = raised - point
            nearest = float(np.linalg.norm(offset, axis=1).min()) if len(raised) else np.inf
            if nearest > HELD_DISTANCE:
                where = f"{stage.name}, waypoint {number}, {side} hand"
                far = f"{nearest:.2f} m" if np.isfinite(nearest) else "nothing raised"
                self.events.append((reason, f"{where}: nearest raised cloth {far}"))

    def _measure(self) -> None:
        cloth = self.env.cloth
        strain = cloth.measure_strain()
        values = {
            "strain_mean": float(strain.mean()),
            "strain_p999": float(np.quantile(strain, 0.999)),
            "penetration_m": float(cloth.solver.measure_penetration(cloth.state)[0]),
        }
        for name, value in values.items():
            self.measurements[f"max_{name}"] = max(value, self.measurements.get(f"max_{name}", 0.0))

    def _note_time(self, name: str, since: float) -> float:
        now = time.perf_counter()
        self.stage_seconds[name] = now - since
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
            stages=tuple(self.records),
            randomisation=dict(self.env.draws),
            measurements=dict(self.measurements),
            package_versions=package_versions(),
        )


def plan_leave(
    motion: BimanualMotion,
    points: Mapping[Side, np.ndarray],
    orientations: Mapping[Side, np.ndarray],
) -> list[np.ndarray]:
    """Plan how opened hands leave the cloth, from where `motion` is.

    The palm looks down, so of an opened hand the thumb is under the cloth and would hook it. So the
    hand rolls until cloth slides off the thumb, draws back along its fingers from under what hangs over
    them, and then goes straight up.

    Args:
        motion: Plans the arms.
        points: Grasp point of each hand [m], shape (3,), world frame.
        orientations: Of `ee` of each hand that leaves, wxyz, shape (4,).

    Returns:
        Joint targets of each part, shape (N, 60) [rad].

    Raises:
        UnreachableError: If a hand cannot even go straight up.
    """
    rolled = {side: roll_thumb_down(q, ROLL, side) for side, q in orientations.items()}
    ways: dict[Side, tuple[np.ndarray, ...]] = {}
    for side in orientations:
        for length in DRAW_BACKS:
            out = points[side] + np.array([0, 0, ROLL_LIFT])
            back = out - length * point_along_fingers(rolled[side])
            ways[side] = (out, back, back + np.array([0, 0, CLEARANCE]))
            with motion.rehearsal():
                try:
                    for target in ways[side]:
                        motion.move({side: target}, {side: rolled[side]}, spacing=LEAVE_SPACING)
                except UnreachableError:
                    if length == DRAW_BACKS[-1]:
                        raise
                else:
                    break
    parts = []
    for k in range(3):
        targets = {side: way[k] for side, way in ways.items()}
        parts.append(motion.move(targets, rolled, spacing=LEAVE_SPACING))
        if k == 0:
            parts.append(motion.hold(ROLL_FRAMES))
    return parts
