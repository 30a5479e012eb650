"""Scenes on which the solver is timed: a fold, a crumpled dress, and a dress hung over a bar."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from dgl_assets import load_garment
from dgl_bench.physics.fold_replay import FoldRecord
from dgl_physics import ClothMaterial, ModelBuilder, Shape, SolverConfig, SolverXPBD, State
from dgl_physics.scene import Scene

__all__ = ["SpeedScene", "make_drop", "make_fold", "make_hanging"]

DRESS = "Dress_LongSleeve/000030"
"""7,744 particles."""
DROP_HEIGHT, DROP_TILT = 0.1, np.radians(80)
"""Of the lowest point above the ground [m], and of the dress from lying flat [rad]: it ends
crumpled."""
FALL_FRAMES, HEAP_FRAMES = 60, 120
PAD = Shape(kind="box", size=(0.03, 0.01, 0.03), friction=3.0)
"""Half of a hand, with the friction of the robots' hands."""
PADS = (("left", -1), ("left", 1), ("right", -1), ("right", 1))
"""Side of each pad, and on which side of the cloth it is."""
BAR_RADIUS, BAR_HEIGHT = 0.02, 1.3
"""Of the bar [m]."""
BAR_DISTANCE = 0.06
"""From the bar's axis to the dress, as it is taken [m]."""
RISE = 0.3
"""From there up to the shoulders [m]."""
CLOSE_FRAMES, CARRY_FRAMES, HANG_FRAMES = 10, 80, 120
CARRY = np.array([0.0, -0.35, -0.35])
"""Way of the hands that carry the shoulders, over the bar and down [m]."""


@dataclass(frozen=True, kw_only=True)
class SpeedScene:
    """A scene that can be built and played several times."""

    name: str
    note: str
    """Timed motion."""
    build: Callable[[SolverConfig], tuple[SolverXPBD, State]]
    """Build it with the solver's settings."""
    play: Callable[[SolverXPBD, State, int], None]
    """Advance it by the frame of a number."""
    frames: int
    """Number of frames."""
    first_timed: int = 0
    """Number of the first frame that counts."""
    config: SolverConfig = field(default_factory=SolverConfig)
    """Settings of the solver."""


def make_fold(record: FoldRecord) -> SpeedScene:
    """Take the cloth of a fold against the robots' motion."""
    return SpeedScene(
        name="Fold Tops, awake frame",
        note=f"{len(record.final)} particles, both robots",
        build=record.build,
        play=record.play,
        frames=len(record.actions),
        config=record.config,
    )


def make_drop() -> SpeedScene:
    """Drop a dress, nearly upright, that never sleeps, and time it crumpled."""
    garment, material = load_garment(DRESS), ClothMaterial()
    c, s = np.cos(DROP_TILT), np.sin(DROP_TILT)
    start = garment.vertices @ np.array([[1, 0, 0], [0, c, -s], [0, s, c]]).T
    start[:, 2] += DROP_HEIGHT - start[:, 2].min()

    def build(config: SolverConfig) -> tuple[SolverXPBD, State]:
        builder = ModelBuilder()
        builder.add_garment(start, garment.faces, rest=garment.rest_vertices, material=material)
        builder.add_ground(0.5)
        scene = Scene(builder, config)
        return scene.solver, scene.state

    return SpeedScene(
        name="crumpled drop, frame",
        note=f"{len(start)} particles, {HEAP_FRAMES} frames after {FALL_FRAMES} of the fall, kept "
        "awake",
        build=build,
        play=lambda solver, state, frame: solver.step(state),
        frames=FALL_FRAMES + HEAP_FRAMES,
        first_timed=FALL_FRAMES,
        config=SolverConfig(sleep_distance=0.0),
    )


def make_hanging() -> SpeedScene:
    """Carry a dress by its shoulders over a bar; time it as it hangs from the hands and the bar."""
    garment, material = load_garment(DRESS), ClothMaterial()
    start = garment.vertices[:, [0, 2, 1]] * [1.0, -1.0, 1.0]  # upright, its front to -y
    grips = {s: start[garment.landmarks[f"{s}_shoulder"]] * [1, 0, 1] for s in ("left", "right")}
    lift = np.array([0.0, BAR_DISTANCE, BAR_HEIGHT + RISE - grips["left"][2]])
    closed = material.thickness / 2 + material.rest_offset + PAD.size[1] - 0.001

    def place(frame: int) -> np.ndarray:
        """Poses of the world and the pads at the end of a frame, xyz + wxyz, shape (1, 5, 7)."""
        gap = closed + 0.01 * max(0.0, 1 - frame / CLOSE_FRAMES)
        share = np.clip((frame - CLOSE_FRAMES) / CARRY_FRAMES, 0.0, 1.0)
        centres = [grips[s] + lift + share * CARRY + [0.0, sign * gap, 0.0] for s, sign in PADS]
        poses = np.zeros((1, 1 + len(PADS), 7), dtype=np.float32)
        poses[..., 3] = 1.0
        poses[0, 1:, :3] = centres
        return poses

    def build(config: SolverConfig) -> tuple[SolverXPBD, State]:
        builder = ModelBuilder()
        builder.add_garment(
            start + lift, garment.faces, rest=garment.rest_vertices, material=material
        )
        builder.add_ground(0.5)
        axis = [0.0, 0.0, BAR_HEIGHT, np.sqrt(0.5), 0.0, np.sqrt(0.5), 0.0]  # along x
        bar = Shape(kind="capsule", size=(BAR_RADIUS, 1.0, 0.0), pose=np.array(axis))
        builder.add_shape(bar)
        for number in range(len(PADS)):
            builder.add_shape(PAD, body=builder.add_body(f"pad {number}"))
        scene = Scene(builder, config)
        scene.state.set_body_poses(place(0), is_jump=True)
        return scene.solver, scene.state

    def play(solver: SolverXPBD, state: State, frame: int) -> None:
        # nothing falls before the hands have closed
        if frame in (0, CLOSE_FRAMES):
            state.set_gravity_scale(float(frame > 0))
        state.set_body_poses(place(frame + 1))
        solver.step(state)

    return SpeedScene(
        name="dress from two hands over a bar, frame",
        note=f"{len(start)} particles, {HANG_FRAMES} frames after it was carried there, kept awake",
        build=build,
        play=play,
        frames=CLOSE_FRAMES + CARRY_FRAMES + HANG_FRAMES,
        first_timed=CLOSE_FRAMES + CARRY_FRAMES,
        config=SolverConfig(sleep_distance=0.0),
    )
