"""One attempt at a task: the expert's demonstration, retargeted, executed, recorded and judged."""

import logging
import time
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from dgl_assets import load_garment
from dgl_assets.robots import HAND_POSES, HOME_CONFIGURATION, SIDES, Side, joint_slice
from dgl_gam import Matcher, compute_affordance
from dgl_physics import PhysicsError
from dgl_tasks import TaskError, get_task
from dgl_tasks import perception as see
from dgl_tasks.grasps import wrist_to_grasp
from dgl_tasks.coverage import sample_visible_surface
from dgl_tasks.declaration import Stage
from dgl_tasks.motion import BimanualMotion
from dgl_tasks.rotations import matrix_from_quaternion
from dgl_tasks.robot import DEFAULT_ROBOT_DIRECTORY
from dgl_tasks.success import Verdict

from dgl_collect.demonstration import load_demonstration, retarget_waypoints
from dgl_collect.episodes import Episode, Points, StageRecord, write_episode
from dgl_collect.matching import ExactMatcher
from dgl_collect.recording import STEPS_PER_FRAME, Observation, StageRecorder, StageStart
from dgl_collect.results import AttemptResult, Criterion, package_versions
from dgl_collect.video import VideoWriter, save_png

logger = logging.getLogger(__name__)

APPROACH_HEIGHT = 0.2
"""Height above the grasp point from which a hand comes down [m]."""
WITHDRAWAL = 0.12
"""How far an opened hand draws back along its fingers, out of the cloth, before it rises [m]."""
CLEARANCE = 0.15
"""How far it then rises [m]."""
ARRIVAL_FRAMES = 10
"""Frames for the arm to arrive at the grasp points before the hand closes."""
FINAL_FRAMES = 30
"""Frames between the hands being out of the way and the verdict."""
HELD_DISTANCE = 0.12
"""A hand holds the garment while a raised particle is this near its grasp point [m]."""
HELD_HEIGHT = 0.05
"""What lies higher than this over the ground counts as raised [m]."""


def make_attempt_runner(task: str, options: Mapping[str, object]) -> "DemonstrationAttempt":
    """Build the attempts of a task; see `dgl_collect.attempts.AttemptFactory`.

    Args:
        task: Environment id.
        options: "garment": catalogue id to use in every attempt instead of drawing one.
    """
    unknown = set(options) - {"garment"}
    if unknown:
        raise ValueError(f"options must be among ['garment']; got {sorted(unknown)}")
    return DemonstrationAttempt(task, garment=options.get("garment"))


class DemonstrationAttempt:
    """Makes attempts in one environment, one after the other."""

    def __init__(self, task: str, *, garment: object = None) -> None:
        """Build the environment and load the demonstration."""
        import gymnasium

        self.task = get_task(task)
        self.demonstration = load_demonstration(task)
        self._demo_garment = load_garment(self.demonstration.garment)
        surface = sample_visible_surface(self._demo_garment.vertices, self._demo_garment.faces)
        self._demo_cloud = surface.astype(np.float32)
        self._garment = garment
        self.env = gymnasium.make(
            task,
            obs_mode="none",
            reward_mode="none",
            sim_backend="physx_cpu",
            render_backend="cpu",
            render_mode="rgb_array",
        ).unwrapped
        self._motion = BimanualMotion(self.task, DEFAULT_ROBOT_DIRECTORY)

    def close(self) -> None:
        """Release the environment."""
        self.env.close()

    def run(
        self, *, attempt_index: int, seed: int, out_dir: Path, episode_id: str
    ) -> AttemptResult:
        """Make one attempt; see `dgl_collect.attempts.AttemptRunner`."""
        started = time.perf_counter()
        attempt = _Attempt(self, seed)
        outcome = {
            "index": attempt_index,
            "seed": seed,
        }
        files = {}
        with VideoWriter(out_dir / f"{episode_id}.mp4") as video:
            attempt.video = video
            try:
                verdict, picture = attempt.execute(self._garment)
                failure = None
            except (TaskError, PhysicsError) as err:
                logger.info("attempt %d: %s", attempt_index, err)
                verdict, failure = None, err
                picture = see.film(self.env)
                attempt.film()
        files["video"] = f"{episode_id}.mp4"
        save_png(out_dir / f"{episode_id}.png", picture)
        files["picture"] = f"{episode_id}.png"
        success = verdict is not None and verdict.success
        if success and verdict is not None:
            episode = attempt.make_episode(seed, verdict)
            write_episode(out_dir / f"{episode_id}.h5", episode)
            files["episode"] = f"{episode_id}.h5"
        reason, detail = attempt.explain(verdict, failure)
        return AttemptResult(
            **outcome,
            success=success,
            value=verdict.value if verdict else None,
            reason=None if success else reason,
            detail="" if success else detail,
            criteria=_to_criteria(verdict),
            garment_id=self.env.garment.name,
            seconds=time.perf_counter() - started,
            frames=sum(record.frame_count for record in attempt.records),
            stage_seconds=attempt.stage_seconds,
            files=files,
            randomisation=dict(self.env.draws),
            measurements=attempt.measurements,
        )


class _Attempt:
    """State of the attempt that is being made."""

    def __init__(self, runner: DemonstrationAttempt, seed: int) -> None:
        self.env, self.task = runner.env, runner.task
        self.demonstration, self.motion = runner.demonstration, runner._motion
        self._demo_garment, self._demo_cloud = runner._demo_garment, runner._demo_cloud
        self.seed = seed
        self.video: VideoWriter | None = None
        self.records: list[StageRecord] = []
        self.stage_seconds: dict[str, float] = {}
        self.measurements: dict[str, float] = {}
        self.events: list[tuple[str, str]] = []
        self._step_count = 0
        self._cloud_seed = np.random.default_rng([seed, 1])

    # The course of an attempt ----------------------------------------------------------------

    def execute(self, garment: object) -> tuple[Verdict, np.ndarray]:
        """Run all stages and judge; returns the verdict and the judging camera's picture."""
        clock = time.perf_counter()
        options = {} if garment is None else {"garment": garment}
        self.env.reset(seed=self.seed, options=options)
        start = HOME_CONFIGURATION.copy()
        for side in SIDES:
            start[joint_slice(side, "hand")] = HAND_POSES["open"]
        self.motion.reset(start)
        self._send(self.motion.park())
        picture = see.take_picture(self.env, "garment_camera")
        cloud = see.get_garment_cloud(self.env, picture, seed=self._draw_seed())
        names = list(self.demonstration.points)
        found, _ = self._match(names, cloud)
        points = {n: cloud[i].astype(np.float64) for n, i in zip(names, found, strict=True)}
        self.stage_seconds["observe"] = time.perf_counter() - clock
        for stage in self.task.stages:
            clock = time.perf_counter()
            self._run_stage(stage, points)
            self.stage_seconds[stage.name] = time.perf_counter() - clock
        clock = time.perf_counter()
        self._send(self.motion.hold(FINAL_FRAMES))
        picture = see.take_picture(self.env, "garment_camera")
        marks = {name: points[name] for name in self.task.judging_points}
        verdict = self.task.success(see.get_garment_points(self.env, picture), marks)
        self.stage_seconds["judge"] = time.perf_counter() - clock
        return verdict, picture.rgb

    def _run_stage(self, stage: Stage, points: dict[str, np.ndarray]) -> None:
        demonstrated = self.demonstration.get_stage(stage.name)
        grasp = {
            side: np.array([*points[name][:2], stage.grasp_height])
            for side, name in stage.grasp.items()
        }
        names = [stage.grasp.get(side, next(iter(stage.grasp.values()))) for side in SIDES]
        picture = see.take_picture(self.env, "garment_camera")
        cloud = see.get_garment_cloud(self.env, picture, seed=self._draw_seed())
        _, similarity = self._match(names, cloud)
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
        self._send(self.motion.set_hands({s: demonstrated.grasp_pose for s in grasp}), recorder)
        for number, (targets, spacing) in enumerate(waypoints):
            self._send(self.motion.move(targets, orientations, spacing=spacing), recorder)
            self._note_grasp(stage, "missed grasp" if number == 0 else "slipped", number)
        self._send(self.motion.set_hands({s: demonstrated.release_pose for s in grasp}), recorder)
        self.records.append(recorder.finish())
        for leave in _leave(targets, orientations):
            self._send(self.motion.move(leave, orientations))
        self._send(self.motion.park())

    def _plan_hand(
        self, side: Side, orientation: np.ndarray, grasp: np.ndarray, waypoints: list
    ) -> None:
        orientations = {side: orientation}
        self.motion.reach({side: grasp + np.array([0, 0, APPROACH_HEIGHT])}, orientations)
        self.motion.move({side: grasp}, orientations)
        for targets, spacing in waypoints:
            self.motion.move({side: targets[side]}, orientations, spacing=spacing)
        for leave in _leave({side: waypoints[-1][0][side]}, orientations):
            self.motion.move(leave, orientations)

    # Acting and seeing -----------------------------------------------------------------------

    def _send(self, rows: np.ndarray, recorder: StageRecorder | None = None) -> None:
        for row in rows:
            target = row.astype(np.float32)
            if recorder is not None:
                recorder.before_step(target, self._observe)
            if self._step_count % STEPS_PER_FRAME == 0:
                self.film()
                self._measure()
            self.env.advance(target)
            self._step_count += 1

    def film(self) -> None:
        """Add a picture for people to the video."""
        if self.video is not None:
            self.video.add(see.film(self.env))

    def _observe(self) -> Observation:
        picture = see.take_picture(self.env, "environment_camera")
        return Observation(
            joint_state=self.env.agent.get_joint_state()[0].cpu().numpy().astype(np.float32),
            ee_pose=self.env.agent.get_ee_poses()[0].cpu().numpy().astype(np.float32),
            image=picture.rgb,
            env_point_cloud=see.get_environment_cloud(self.env, picture, seed=self._draw_seed()),
        )

    def _match(self, names: list[str], cloud: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        matcher: Matcher = ExactMatcher(
            self._demo_garment, self.env.garment, self.env.get_particles()
        )
        wanted = np.array([self.demonstration.points[name] for name in names])
        return matcher.match(self._demo_cloud, wanted, cloud)

    def _draw_seed(self) -> int:
        return int(self._cloud_seed.integers(2**31))

    def _describe(self, points: Mapping[str, np.ndarray]) -> Points:
        return {
            name: {
                "xyz": [float(v) for v in xyz],
                "uv": list(see.find_pixel(self.env, "environment_camera", xyz)),
            }
            for name, xyz in points.items()
        }

    # Judging ---------------------------------------------------------------------------------

    def _grasp_point(self, side: Side) -> np.ndarray:
        pose = self.env.agent.get_ee_poses()[0, SIDES.index(side)].cpu().numpy()
        return wrist_to_grasp(pose[:3], pose[3:], side)

    def _note_grasp(self, stage: Stage, reason: str, number: int) -> None:
        particles = self.env.get_particles()
        raised = particles[particles[:, 2] > HELD_HEIGHT]
        for side in stage.grasp:
            offset = raised - self._grasp_point(side)
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
            self.measurements[f"max_{name}"] = max(
                value, self.measurements.get(f"max_{name}", 0.0)
            )

    def explain(self, verdict: Verdict | None, failure: Exception | None) -> tuple[str, str]:
        """Say why the attempt failed: in words that can be counted, and with numbers."""
        if failure is not None:
            kind = type(failure).__name__.removesuffix("Error")
            words = "".join(f" {c.lower()}" if c.isupper() else c for c in kind).strip()
            return words, str(failure)
        if self.events:
            return self.events[0]
        if verdict is None:
            return "not judged", ""
        return "below the threshold", (
            f"{verdict.quantity}: {verdict.value:.3f}, needed {verdict.threshold:.2f}"
        )

    def make_episode(self, seed: int, verdict: Verdict) -> Episode:
        """Put the recorded stages together."""
        return Episode(
            task=self.task.id,
            seed=seed,
            garment_id=self.env.garment.name,
            success=verdict.success,
            success_value=verdict.value,
            stages=tuple(self.records),
            randomisation=dict(self.env.draws),
            measurements=dict(self.measurements),
            package_versions=package_versions(),
        )


def _leave(
    points: Mapping[Side, np.ndarray], orientations: Mapping[Side, np.ndarray]
) -> list[dict[Side, np.ndarray]]:
    """Grasp points of hands that leave the cloth: back along the fingers, then up."""
    back, up = {}, {}
    for side, q in orientations.items():
        fingers = matrix_from_quaternion(q)[:, 0]
        back[side] = points[side] - WITHDRAWAL * fingers + np.array([0, 0, WITHDRAWAL / 4])
        up[side] = back[side] + np.array([0, 0, CLEARANCE])
    return [back, up]


def _to_criteria(verdict: Verdict | None) -> tuple[Criterion, ...]:
    if verdict is None:
        return ()
    return (
        Criterion(
            name=verdict.quantity,
            value=verdict.value,
            comparison=">=",
            threshold=verdict.threshold,
        ),
    )
