"""The Fold Tops scene as it is collected: both robots fold a top after the demonstration.

The robots' motion is planned and played once in the task's environment. What every rigid body
did in each frame is kept, so that the cloth can be simulated again by itself against the same
motion: with other substeps, on another device, or just to be timed.
"""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from dgl_physics import SolverConfig, SolverXPBD, State
from dgl_physics.sapien_bridge import SapienCloth, find_colliders

if TYPE_CHECKING:
    from dgl_tasks.env import GarmentEnv

__all__ = ["ClothReplay", "FoldRecord", "record_fold", "replay_cloth"]

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
    """True for particles that stick to a surface, shape (V,), bool."""
    poses: np.ndarray
    """Poses of the bodies, the world first, after each frame and before the first, xyz + wxyz,
    shape (T + 1, N, 7)."""
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
        from dgl_tasks.soft_body import add_soft_body

        task, garment = self.env.task, self.env.garment
        scene = self.env.scene.sub_scenes[0]
        cloth = SapienCloth(
            [scene],
            colliders=[find_colliders(scene)],
            friction=lambda body: _get_friction(body, task),
            config=config or self.config,
            device=device,
        )
        add_soft_body(
            cloth, garment, garment.vertices, task.material, task.stiffness, task.shrinkage
        )
        cloth.build()
        cloth.state.set_particles(self.positions[None], self.velocities[None], self.is_stuck[None])
        cloth.state.set_body_poses(self.poses[None, 0], is_jump=True)
        return cloth.solver, cloth.state

    def play(self, solver: SolverXPBD, state: State, frame: int) -> None:
        """Advance the cloth by the record's frame of this number."""
        state.set_body_poses(self.poses[None, frame + 1])
        solver.step(state)


def record_fold(*, seed: int, garment: str | None = GARMENT) -> FoldRecord:
    """Play the demonstration on a garment, placed by the seed.

    Args:
        seed: Of the episode.
        garment: Catalogue id; the demonstration's own by default, drawn by the seed when None.
    """
    from dgl_collect.actors import Expert
    from dgl_collect.setup import make_setup
    from dgl_tasks.driver import Driver
    from dgl_tasks.evaluation import plan_episode
    from dgl_tasks.messages import Command, Mark, StageBegins, StageEnds
    from dgl_tasks.sensing import Sensed

    poses: list[np.ndarray] = []
    seconds: list[float] = []
    first: dict[str, int] = {}
    stages: dict[str, tuple[int, int]] = {}

    class Recorder:
        """Recorder of the frames in which the hands of each stage close and have retreated."""

        def before_step(self, command: Command, look: Callable[..., Sensed]) -> None:
            if command.recorded == "stage":
                first.setdefault(now[-1], look().step)

        def note(self, mark: Mark, sensed: Sensed) -> None:
            if isinstance(mark, StageBegins):
                now.append(mark.name)
            elif isinstance(mark, StageEnds):
                stages[mark.name] = (first[mark.name], sensed.step)

    class TimedDriver(Driver):
        def step(self, command: Command) -> None:
            started = time.process_time()
            super().step(command)
            seconds.append(time.process_time() - started)
            poses.append(_read_poses(self.env.cloth.state))

    now: list[str] = []
    setup = make_setup(TASK)
    env = setup.env
    driver = TimedDriver(env, seed=seed, listener=Recorder())
    sensed = driver.reset(garment)
    positions = env.cloth.state.get_positions()[0]
    velocities = env.cloth.state.get_velocities()[0]
    is_stuck = env.cloth.state.get_is_stuck()[0]
    poses.append(_read_poses(env.cloth.state))
    runner = setup.make_runner(Expert(), rounds=1, tries=1)
    driver.drive(plan_episode(setup.motion, runner, sensed))
    return FoldRecord(
        env=env,
        config=env.cloth.config,
        positions=positions,
        velocities=velocities,
        is_stuck=is_stuck,
        poses=np.array(poses),
        actions=np.array(driver.commands),
        final=env.get_particles(),
        stages=stages,
        step_seconds=np.array(seconds),
        success_value=env.apply_rule().value,
    )


def _get_friction(body: Any, task: Any) -> float:
    import sapien

    is_robot = isinstance(body, sapien.physx.PhysxArticulationLinkComponent)
    return task.hand_friction.fingers if is_robot else task.ground_friction


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
    """Particles [m], shape (V, 3), before the first frame and at the end of each stage and of all,
    by frame."""
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
