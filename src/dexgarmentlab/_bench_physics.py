"""Measurements of the cloth simulation: speed, and the errors that it is bought with."""

import logging
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import warp as wp

from dgl_physics import (
    ClothMaterial,
    ModelBuilder,
    PhysicsError,
    Shape,
    SolverConfig,
    SolverXPBD,
    State,
)

__all__ = ["Row", "count_rows", "measure"]

EDGE = 0.0125  # m
BATCHES = (1, 2, 4, 8)


@dataclass(frozen=True, kw_only=True)
class Row:
    """One measured number."""

    name: str
    value: float | None
    """None when the simulation failed."""
    unit: str
    bar: str = ""
    """What the value should be, such as "<= 10"; empty when nothing is asked of it."""

    @property
    def ok(self) -> bool | None:
        """Whether the value is as it should be; None when nothing is asked of it."""
        if not self.bar:
            return None
        relation, bound = self.bar.split()
        if self.value is None:
            return False
        return self.value <= float(bound) if relation == "<=" else self.value >= float(bound)

    def to_dict(self) -> dict[str, object]:
        """Return the row as `name, value, unit, bar, ok`."""
        return {
            "name": self.name,
            "value": self.value,
            "unit": self.unit,
            "bar": self.bar or None,
            "ok": self.ok,
        }


def count_rows() -> int:
    """Return the number of rows that `measure` yields on this machine."""
    return 5 + 2 + 1 + len(BATCHES) * len(_list_devices())


def measure(*, effort: float = 1.0) -> Iterator[Row]:
    """Measure, one row after the other.

    Args:
        effort: Factor on the number of timed frames.

    Yields:
        The rows. Speeds are of one process, without compilation and the first frames.
    """
    frames = max(2, round(60 * effort))
    yield from _measure_speed(frames)
    yield from _measure_panel()
    yield _measure_pinch()
    for device in _list_devices():
        for count in BATCHES:
            solver, state = _build_pile(count, device=device)
            seconds = _time_frames(solver, state, max(2, frames // 2), warm_up=5)
            name = f"two layers at rest, {count} environment(s), {device}"
            yield Row(name=name, value=count / seconds, unit="env-frames/s")


def _list_devices() -> list[str]:
    wp.config.log_level = logging.WARNING  # Warp greets on standard output, where the rows go
    return ["cpu", *(str(device) for device in wp.get_cuda_devices())]


def _make_sheet(columns: int, rows: int) -> tuple[np.ndarray, np.ndarray]:
    """Make a flat sheet of equilateral triangles: vertices [m], (V, 3), centred, faces (F, 3)."""
    r, c = np.divmod(np.arange(rows * columns), columns)
    xy = np.column_stack([(c + 0.5 * (r % 2)) * EDGE, r * EDGE * np.sqrt(0.75)])
    a = np.flatnonzero((r < rows - 1) & (c < columns - 1))
    b, d, e = a + 1, a + columns, a + columns + 1
    even = (r[a] % 2 == 0)[:, None]
    first = np.where(even, np.column_stack([a, b, d]), np.column_stack([a, b, e]))
    second = np.where(even, np.column_stack([b, e, d]), np.column_stack([a, e, d]))
    vertices = np.column_stack([xy - xy.mean(axis=0), np.zeros(len(xy))])
    return vertices, np.concatenate([first, second])


def _build_pile(
    env_count: int = 1, *, is_upright: bool = False, device: str = "cpu"
) -> tuple[SolverXPBD, State]:
    """Two layers of 2205 particles on the ground, lying or standing on their edge."""
    vertices, faces = _make_sheet(45, 49)
    if is_upright:
        vertices = vertices[:, [0, 2, 1]]
        vertices[:, 1] = 0.01 * np.sin(30 * vertices[:, 2])  # so that it folds
    vertices[:, 2] += 0.004 - vertices[:, 2].min()
    gap = [0, ClothMaterial().thickness, 0] if is_upright else [0, 0, ClothMaterial().thickness]
    builder = ModelBuilder(env_count)
    builder.add_garment(vertices, faces)
    builder.add_garment(vertices + gap, faces)
    builder.add_ground()
    model = builder.build(device)
    return SolverXPBD(model), model.make_state()


def _time_frames(solver: SolverXPBD, state: State, frames: int, *, warm_up: int) -> float:
    """Median duration of a frame [s], which other load on the machine disturbs little."""
    for _ in range(warm_up):
        solver.step(state)
    durations = []
    for _ in range(frames):
        wp.synchronize()
        start = time.perf_counter()
        solver.step(state)
        wp.synchronize()
        durations.append(time.perf_counter() - start)
    return float(np.median(durations))


def _measure_speed(frames: int) -> Iterator[Row]:
    solver, state = _build_pile()
    seconds = _time_frames(solver, state, frames, warm_up=10)
    yield Row(
        name="frame, two layers at rest, 4410 particles",
        value=1e3 * seconds,
        unit="ms",
        bar="<= 10",
    )
    model = solver.model
    per_second = solver.config.substeps / seconds
    yield Row(
        name="particle-substeps, the same",
        value=model.particles_per_env * per_second,
        unit="1/s",
    )
    yield Row(
        name="projections of constraints, the same",
        value=model.colour_start[-1] * per_second,
        unit="1/s",
    )
    solver, state = _build_pile(is_upright=True)
    seconds = _time_frames(solver, state, frames, warm_up=10)
    yield Row(name="frame, the same falling in a heap", value=1e3 * seconds, unit="ms", bar="<= 20")
    seconds = _time_frames(solver, state, frames, warm_up=0)
    yield Row(name="frame, the same in a heap", value=1e3 * seconds, unit="ms", bar="<= 20")


def _measure_panel() -> Iterator[Row]:
    """Strain of 0.6 m x 0.7 m of one layer, hung by two corners for four seconds."""
    vertices, faces = _make_sheet(48, 66)
    vertices = vertices[:, [0, 2, 1]]
    vertices[:, 1] = 1e-3 * np.sin(20 * vertices[:, 0])
    builder = ModelBuilder()
    builder.add_garment(vertices, faces, pinned=(len(vertices) - 48, len(vertices) - 1))
    model = builder.build()
    solver, state = SolverXPBD(model), model.make_state()
    for _ in range(240):
        solver.step(state)
    garment = model.garments[0]
    ends = state.get_positions()[0][garment.edges]
    length = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)
    strain = 100 * np.abs(length / garment.rest_lengths - 1)
    name = "strain, panel hung by two corners"
    yield Row(name=f"{name}, mean", value=float(strain.mean()), unit="%", bar="<= 1")
    largest = float(np.percentile(strain, 99.9))
    yield Row(name=f"{name}, 99.9th percentile", value=largest, unit="%", bar="<= 4")


def _measure_pinch() -> Row:
    """Creep of 6 g of hanging cloth between two boxes, at the default material."""
    name = "creep in a pinch, largest of 2 s"
    try:
        value = 1e3 * _pinch()
    except PhysicsError:
        return Row(name=name, value=None, unit="mm", bar="<= 2")
    return Row(name=name, value=value, unit="mm", bar="<= 2")


def _pinch() -> float:
    material = ClothMaterial()
    vertices, faces = _make_sheet(9, 15)
    vertices = vertices[:, [0, 2, 1]]
    vertices[:, 2] += 0.03 - vertices[:, 2].max()  # the fingers close 3 cm below its top
    builder = ModelBuilder()
    for side in (-0.5, 0.5):
        builder.add_garment(
            np.add(vertices, [0, side * material.thickness, 0]), faces, material=material
        )
    for name in ("left", "right"):
        builder.add_shape(Shape(kind="box", size=(0.02, 0.01, 0.02)), body=builder.add_body(name))
    model = builder.build()
    state, solver = model.make_state(), SolverXPBD(model, SolverConfig(max_speed=5.0))
    closed = 0.5 * material.thickness + material.rest_offset + 0.01 - 0.001
    move = _make_mover(solver, state)
    state.set_gravity_scale(0.0)
    for k in range(11):
        move(0.0, closed + 0.01 * (1 - k / 10), is_jump=k == 0)
    x = state.get_positions()[0]
    inner = np.flatnonzero((np.abs(x[:, 0]) < 0.02) & (np.abs(x[:, 2]) < 0.007))
    state.set_gravity_scale(1.0)
    for k in range(30):  # 0.3 m at 0.6 m/s
        move(0.3 * (k + 1) / 30, closed)
    start = state.get_positions()[0, inner]
    for _ in range(120):
        move(0.3, closed)
    return float(np.linalg.norm(state.get_positions()[0, inner] - start, axis=1).max())


def _make_mover(solver: SolverXPBD, state: State) -> Callable[..., None]:
    def move(lift: float, opening: float, *, is_jump: bool = False) -> None:
        poses = np.zeros((1, 3, 7), dtype=np.float32)
        poses[..., 3] = 1.0
        poses[0, 1:, 1] = (-opening, opening)
        poses[0, 1:, 2] = lift
        state.set_body_poses(poses, is_jump=is_jump)
        solver.step(state)

    return move
