"""The Fold Tops scene as it is collected: both robots fold a top after the demonstration.

The robots' motion is planned and played once in the task's environment, without cameras. What every rigid body
did in each frame is kept, so that the cloth can be simulated again by itself against the same motion: with
other substeps, on another device, or just to be timed.
"""

import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from dgl_physics import SolverConfig, SolverXPBD, State
from dgl_physics.sapien_bridge import SapienCloth, find_colliders

if TYPE_CHECKING:
    from dgl_tasks.env import GarmentEnv

__all__ = ["ClothReplay", "FoldRecord", "make_fold_env", "record_fold", "replay_cloth"]

GARMENT = "Tops_LongSleeve/001294"
"""The garment that the demonstration was given on."""
TASK = "FoldTops-v1"


@dataclass(frozen=True, kw_only=True)
class FoldRecord:
    """A played demonstration."""

    env: "GarmentEnv"
    config: SolverConfig
    positions: np.ndarray
    """Particles before the first frame [m], shape (V, 3)."""
    velocities: np.ndarray
    """The same [m/s]."""
    is_stuck: np.ndarray
    """Which of them stick to a surface, shape (V,), bool."""
    poses: np.ndarray
    """Poses of the bodies, the world first, after each frame and before the first, xyz + wxyz, shape (T + 1, N, 7)."""
    actions: np.ndarray
    """Joint targets [rad], shape (T, 60)."""
    final: np.ndarray
    """Particles after the last frame [m], shape (V, 3)."""
    stages: Mapping[str, tuple[int, int]]
    """Frame at which the hands of a stage begin to close, and at which they have left the cloth."""
    step_seconds: np.ndarray
    """Processor time that each step of the environment took [s], shape (T,)."""
    success_value: float
    """Share of the visible area that lies where the task wants it."""

    @property
    def faces(self) -> np.ndarray:
        """Triangles of the garment, shape (F, 3)."""
        return self.env.garment.faces

    def build(
        self, config: SolverConfig | None = None, *, device: str = "cpu"
    ) -> tuple[SolverXPBD, State]:
        """Build the cloth alone, against the same colliders, at the record's start."""
        task, garment = self.env.task, self.env.garment
        scene = self.env.scene.sub_scenes[0]
        cloth = SapienCloth(
            [scene],
            colliders=[find_colliders(scene)],
            friction=lambda body: _get_friction(body, task),
            config=config or self.config,
            device=device,
        )
        cloth.add_garment(
            garment.vertices, garment.faces, rest=garment.rest_vertices, material=task.material
        )
        cloth.build()
        cloth.state.set_particles(self.positions[None], self.velocities[None], self.is_stuck[None])
        cloth.state.set_body_poses(self.poses[None, 0], is_jump=True)
        return cloth.solver, cloth.state

    def play(self, solver: SolverXPBD, state: State, frame: int) -> None:
        """Advance the cloth by the record's frame of this number."""
        state.set_body_poses(self.poses[None, frame + 1])
        solver.step(state)


def make_fold_env() -> "GarmentEnv":
    """Make the task's environment without anything that draws."""
    import gymnasium

    import dgl_tasks  # noqa: F401 - registers the environments

    env: Any = gymnasium.make(
        TASK,
        obs_mode="none",
        reward_mode="none",
        sim_backend="physx_cpu",
        render_backend="none",
    )
    return env.unwrapped


def record_fold(*, seed: int, garment: str | None = GARMENT) -> FoldRecord:
    """Play the demonstration on a garment, placed by the seed.

    Args:
        seed: Of the episode.
        garment: Catalogue id; the demonstration's own by default, drawn by the seed when None.
    """
    from dgl_assets.robots import HAND_POSES, HOME_CONFIGURATION, SIDES, joint_slice

    env = make_fold_env()
    env.reset(seed=seed, options={} if garment is None else {"garment": garment})
    player = _Player(env)
    start = HOME_CONFIGURATION.copy()
    for side in SIDES:
        start[joint_slice(side, "hand")] = HAND_POSES["open"]
    player.motion.reset(start)
    positions = env.cloth.state.get_positions()[0]
    velocities = env.cloth.state.get_velocities()[0]
    is_stuck = env.cloth.state.get_is_stuck()[0]
    player.poses.append(_read_poses(env.cloth.state))
    points = player.find_points()
    player.send(player.motion.park())
    for stage in env.task.stages:
        player.run_stage(stage, points)
    player.send(player.motion.hold(20))
    return FoldRecord(
        env=env,
        config=env.cloth.config,
        positions=positions,
        velocities=velocities,
        is_stuck=is_stuck,
        poses=np.array(player.poses),
        actions=np.array(player.actions),
        final=env.get_particles(),
        stages=player.stages,
        step_seconds=np.array(player.seconds),
        success_value=env.judge_visible_surface().value,
    )


class _Player:
    """Plans the stages with exact knowledge of the garment, and sends them to the environment."""

    def __init__(self, env: "GarmentEnv") -> None:
        from dgl_assets import load_garment
        from dgl_collect.demonstration import load_demonstration
        from dgl_tasks.motion import BimanualMotion
        from dgl_tasks.robot import DEFAULT_ROBOT_DIRECTORY

        self.env = env
        self.motion = BimanualMotion(env.task, DEFAULT_ROBOT_DIRECTORY)
        self.demonstration = load_demonstration(TASK)
        self.demo_garment = load_garment(self.demonstration.garment)
        self.poses: list[np.ndarray] = []
        self.actions: list[np.ndarray] = []
        self.seconds: list[float] = []
        self.stages: dict[str, tuple[int, int]] = {}

    def find_points(self) -> dict[str, np.ndarray]:
        """Find the demonstration's marked places on the garment as it lies [m]."""
        from dgl_collect.matching import ExactMatcher
        from dgl_tasks.coverage import sample_visible_surface

        particles = self.env.get_particles()
        cloud = sample_visible_surface(particles, self.env.garment.faces)
        matcher = ExactMatcher(self.demo_garment, self.env.garment, particles)
        names = list(self.demonstration.points)
        wanted = np.array([self.demonstration.points[name] for name in names])
        found, _ = matcher.match(cloud, wanted, cloud)
        return {n: cloud[i].astype(float) for n, i in zip(names, found, strict=True)}

    def send(self, rows: np.ndarray) -> None:
        """Play rows of joint targets."""
        for row in rows:
            started = time.process_time()
            self.env.advance(row.astype(np.float32))
            self.seconds.append(time.process_time() - started)
            self.actions.append(row.astype(np.float32))
            self.poses.append(_read_poses(self.env.cloth.state))

    def run_stage(self, stage: Any, points: dict[str, np.ndarray]) -> None:
        """Grasp, carry and let go as demonstrated."""
        from dgl_collect.demonstration import retarget_waypoints
        from dgl_tasks.approach import RELEASE_FRAMES, plan_leave

        motion = self.motion
        shown = self.demonstration.get_stage(stage.name)
        seen = self.find_points()  # the stages before may have dragged the garment along
        grasp = {
            s: stage.place_grasp(s, np.mean([seen[n] for n in stage.get_grasp_names(s)], axis=0))
            for s in stage.grasp
        }
        above = {s: p + np.array([0, 0, 0.15]) for s, p in grasp.items()}
        waypoints = retarget_waypoints(shown, points)

        def rehearse(side: Any, q: np.ndarray) -> None:
            motion.reach({side: above[side]}, {side: q})
            motion.move({side: grasp[side]}, {side: q})
            for w in waypoints:
                motion.move({side: w.targets[side]}, {side: q}, spacing=w.spacing)

        q = motion.choose_turns(stage.orientation, tuple(grasp), rehearse)
        self.send(motion.reach(above, q))
        self.send(motion.move(grasp, q))
        self.send(motion.hold(10))
        first = len(self.actions)
        self.send(motion.set_hands(dict.fromkeys(grasp, shown.grasp_pose)))
        for w in waypoints:
            self.send(motion.move(w.targets, q, spacing=w.spacing))
        self.send(motion.set_hands(dict.fromkeys(grasp, shown.release_pose)))
        self.send(motion.hold(RELEASE_FRAMES))
        for rows in plan_leave(motion, waypoints[-1].targets, q):
            self.send(rows)
        self.stages[stage.name] = (first, len(self.actions))
        self.send(motion.park())


def _get_friction(body: Any, task: Any) -> float:
    import sapien

    is_robot = isinstance(body, sapien.physx.PhysxArticulationLinkComponent)
    return task.hand_friction if is_robot else task.ground_friction


def _read_poses(state: State) -> np.ndarray:
    """Poses at the end of the last frame, xyz + wxyz, shape (N, 7)."""
    return state.body_end.numpy()[0][:, [0, 1, 2, 6, 3, 4, 5]].copy()


@dataclass(frozen=True, kw_only=True)
class ClothReplay:
    """The cloth of a record, simulated again by itself."""

    solver: SolverXPBD
    state: State
    frame_seconds: np.ndarray
    """Processor time of each frame [s], shape (T,); it does not count what CUDA does."""
    positions: Mapping[int, np.ndarray]
    """Particles [m], shape (V, 3), before the first frame and at the end of each stage and of all, by frame."""
    velocities: Mapping[int, np.ndarray]
    """The same [m/s]."""

    @property
    def final(self) -> np.ndarray:
        """Particles after the last frame [m], shape (V, 3)."""
        return self.positions[max(self.positions)]


def replay_cloth(
    record: FoldRecord, config: SolverConfig | None = None, *, device: str = "cpu"
) -> ClothReplay:
    """Simulate the cloth of a record again against the same motion of all bodies."""
    solver, state = record.build(config, device=device)
    kept = {0, len(record.actions), *(f for pair in record.stages.values() for f in pair)}
    positions, velocities = {}, {}
    seconds = np.zeros(len(record.actions))
    for frame in range(len(record.actions) + 1):
        if frame in kept:
            positions[frame] = state.get_positions()[0]
            velocities[frame] = state.get_velocities()[0]
        if frame < len(record.actions):
            started = time.process_time()
            record.play(solver, state, frame)
            seconds[frame] = time.process_time() - started
    return ClothReplay(
        solver=solver,
        state=state,
        frame_seconds=seconds,
        positions=positions,
        velocities=velocities,
    )
