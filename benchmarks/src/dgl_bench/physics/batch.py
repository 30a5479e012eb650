"""Many environments in one model: throughput and memory."""

# What Warp's arrays hold is not in their type.
# pyright: reportAttributeAccessIssue=false
import time

import numpy as np
import warp as wp

from dgl_bench.physics.experiment import Bench, Result
from dgl_bench.physics.figures import Chart, Figure, Series
from dgl_bench.physics.sheets import make_sheet
from dgl_bench.rows import NO_CUDA, Reading
from dgl_physics import ClothMaterial, ModelBuilder, SolverXPBD, State

__all__ = ["measure_batch"]

CPU_BATCHES = (1, 2, 4, 8, 16)
CUDA_BATCHES = (1, 4, 16, 64, 256, 1024)
FRAMES = 20


def measure_batch(bench: Bench) -> Result:
    """Two layers at rest in each of B environments."""
    rows, curves, memory = [], [], []
    for tone, device in enumerate(bench.devices):
        speeds, sizes = [], []
        batches = CPU_BATCHES if device == "cpu" else CUDA_BATCHES
        for count in batches:
            solver, state = build_pile(count, device=device)
            seconds = time_frames(solver, state, bench.scale(FRAMES, least=3))
            model = solver.model
            particles = count * model.particles_per_env * solver.config.substeps
            speeds.append(particles / seconds)
            sizes.append(measure_memory(model, state, solver) / count / 1e6)
            rows.append(
                Reading(
                    f"batch of {count} on {device}, particle-substeps",
                    particles / seconds,
                    "1/s",
                    note=f"{count / seconds:.0f} env-frames/s of {model.particles_per_env} "
                    "particles",
                )
            )
        rows.append(
            Reading(
                f"batch on {device}, memory of an environment",
                sizes[-1],
                "MB",
                note="arrays of model, state and solver, without the neighbour grid",
            )
        )
        curves.append(Series(batches, np.array(speeds) / 1e6, device, tone=tone))
        curves.append(Series(batches, np.array(speeds) / 1e6, kind="measured", tone=tone))
        memory.append(Series(batches, np.array(sizes) * np.array(batches), device, tone=tone))
    if bench.cuda is None:
        rows.append(Reading.skip("batch on CUDA, particle-substeps", "1/s", NO_CUDA))
    figure = Figure(
        "batch",
        "B environments in one model, two layers of 2,205 particles at rest in each. Warp "
        "runs a kernel on "
        "one thread of a CPU, so there throughput does not grow with B: use a process for each "
        "core.",
        (
            Chart(
                "throughput",
                "environments B",
                "particle-substeps [10⁶/s]",
                curves,
                is_log_x=True,
                y_range=(0.0, 1.25 * max(float(np.max(c.y)) for c in curves)),
            ),
            Chart("memory", "environments B", "memory [MB]", memory, is_log_x=True, is_log_y=True),
        ),
    )
    return Result(rows, (figure,))


def build_pile(env_count: int, *, device: str = "cpu") -> tuple[SolverXPBD, State]:
    """Build two layers of 2,205 particles that lie on the ground."""
    vertices, faces = make_sheet(0.55, 0.52, 0.0125)
    material = ClothMaterial()
    vertices[:, 2] += material.rest_offset
    builder = ModelBuilder(env_count)
    builder.add_garment(vertices, faces, material=material)
    builder.add_garment(np.add(vertices, [0, 0, material.thickness]), faces, material=material)
    builder.add_ground()
    model = builder.build(device)
    return SolverXPBD(model), State(model)


def time_frames(solver: SolverXPBD, state: State, frames: int, *, warm_up: int = 5) -> float:
    """Median duration of a frame [s], which other load on the machine disturbs little."""
    for _ in range(warm_up):
        solver.step(state)
    durations = []
    for _ in range(frames):
        wp.synchronize()
        started = time.perf_counter()
        solver.step(state)
        wp.synchronize()
        durations.append(time.perf_counter() - started)
    return float(np.median(durations))


def measure_memory(*owners: object) -> int:
    """Sum the arrays [bytes] that objects and their structures hold, each once."""
    seen: dict[int, int] = {}

    def visit(value: object, depth: int) -> None:
        if isinstance(value, wp.array):
            seen[value.ptr or id(value)] = value.capacity
        elif isinstance(value, list | tuple):
            for item in value:
                visit(item, depth)
        elif depth and hasattr(value, "__dict__"):
            for item in vars(value).values():
                visit(item, depth - 1)

    for owner in owners:
        visit(owner, 2)
    return sum(seen.values())
