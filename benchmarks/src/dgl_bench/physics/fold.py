"""The fold of the Fold Tops scene: its rest, convergence in substeps, determinism, and speed."""

from dataclasses import replace

import numpy as np

from dgl_bench.physics.experiment import Bench, Result
from dgl_bench.physics.figures import Chart, ClothView, Figure, Limit, Series
from dgl_bench.physics.fold_replay import ClothReplay, replay_cloth
from dgl_bench.rows import NO_CUDA, Reading
from dgl_tasks.coverage import sample_visible_surface

__all__ = [
    "measure_convergence",
    "measure_determinism",
    "measure_fold_rest",
    "measure_fold_speed",
]

CELL = 0.004
"""Side of the cells in which the covered area is counted [m]."""
REST_FRAMES = 600
FRAME_BUDGET = 1e3 / 60 / 1.5
"""Time of a frame at 1.5 times real time [ms]."""


def measure_fold_rest(bench: Bench) -> Result:
    """Measure the folded garment for 10 s after the robots have left."""
    record, replay = bench.fold, bench.fold_again
    solver, state = record.build()
    last = max(replay.positions)
    state.set_particles(replay.positions[last][None], replay.velocities[last][None])
    state.set_body_poses(record.poses[None, -1], is_jump=True)
    t, areas, speeds = [], [], []
    for frame in range(REST_FRAMES + 1):
        if frame % 10 == 0:
            x, v = state.get_positions()[0], state.get_velocities()[0].astype(float)
            t.append(frame / 60)
            areas.append(CELL**2 * len(sample_visible_surface(x, record.faces, cell=CELL)))
            speeds.append(1e3 * float(np.sqrt((v**2).sum(axis=1).mean())))
        solver.step(state)
    drift = 100 * np.abs(np.array(areas) / areas[0] - 1)
    late = float(np.max(np.array(speeds)[np.array(t) >= 3.0]))
    rows = (
        Reading(
            "fold, share of the area where the task wants it",
            record.success_value,
            "",
            bar=">= 0.85",
        ),
        Reading(
            "folded top, drift of the covered area in 10 s",
            float(drift.max()),
            "%",
            bar="<= 1",
            note=f"largest; cells of {1e3 * CELL:g} mm, {areas[0]:.4f} m² at first",
        ),
        Reading(
            "folded top, RMS speed of the particles after 3 s",
            late,
            "mm/s",
            bar="<= 1",
            note="largest between 3 and 10 s",
        ),
    )
    names = ["flat", *(name.replace("_", " ") for name in record.stages), "after 10 s of rest"]
    ends = [0, *(end for _, end in record.stages.values())]
    shapes = [*(replay.positions[f] for f in ends), state.get_positions()[0]]
    pictures = Figure(
        "fold",
        "A top of the catalogue, folded by the two robots after the demonstration, gripped "
        "by nothing but "
        "friction: before, after each stage, and after it has lain for 10 s.",
        [
            ClothView(name, shape, record.faces, azimuth=-90, elevation=60)
            for name, shape in zip(names, shapes, strict=True)
        ],
    )
    charts = Figure(
        "fold_rest",
        "The folded top at rest. Left: the area that it covers. Right: the particles' RMS speed.",
        (
            Chart(
                f"covered area drifts {drift.max():.2f} %",
                "time since the fold [s]",
                "change of covered area [%]",
                (Series(t, 100 * (np.array(areas) / areas[0] - 1)),),
                limits=(Limit(1.0, "bar"), Limit(-1.0, "")),
            ),
            Chart(
                f"RMS speed after 3 s: {late:.2g} mm/s",
                "time since the fold [s]",
                "RMS speed [mm/s]",
                (Series(t, speeds),),
                limits=(Limit(1.0, "bar after 3 s"),),
                is_log_y=True,
            ),
        ),
    )
    return Result(rows, (pictures, charts))


def measure_convergence(bench: Bench) -> Result:
    """Simulate the same motion of the robots with twice the substeps."""
    record, coarse = bench.fold, bench.fold_again
    count = record.config.substeps
    fine = replay_cloth(record, replace(record.config, substeps=2 * count))
    moved = 1e3 * np.linalg.norm(fine.final - coarse.final, axis=1)
    by_stage = {
        name: 1e3 * np.linalg.norm(fine.positions[end] - coarse.positions[end], axis=1)
        for name, (_, end) in record.stages.items()
    }
    rows = (
        Reading(
            "fold, change of the final shape by twice the substeps, mean",
            float(moved.mean()),
            "mm",
            bar="<= 5",
            note=f"{count} against {2 * count} substeps; the bodies' motion is the same",
        ),
        Reading("the same, 95th percentile", float(np.percentile(moved, 95)), "mm"),
    )
    share = 100 * (np.arange(len(moved)) + 1) / len(moved)
    limit = float(np.percentile(moved, 99))
    panels = [
        ClothView(
            f"{n} substeps",
            shape,
            record.faces,
            azimuth=-90,
            elevation=60,
            values=moved[record.faces].mean(axis=1),
            value_label="distance between the two [mm]",
            value_limit=limit,
        )
        for n, shape in ((count, coarse.final), (2 * count, fine.final))
    ]
    chart = Chart(
        f"mean {moved.mean():.1f} mm",
        "distance between the two [mm]",
        "particles up to it [%]",
        [
            Series(np.sort(d), share, f"after {name.replace('_', ' ')}", tone=k)
            for k, (name, d) in enumerate(by_stage.items())
        ],
        limits=(Limit(5.0, "bar, for the mean", is_vertical=True),),
        x_range=(0.0, max(8.0, limit)),
    )
    figure = Figure(
        "convergence",
        "The fold with the default and with twice the substeps, against the same motion of "
        "the robots: where "
        "the final shapes differ, and how many particles by how much after each stage.",
        (*panels, chart),
    )
    return Result(rows, (figure,))


def measure_determinism(bench: Bench) -> Result:
    """Repeat the fold on the CPU, and 2 s of it on CUDA."""
    record, again = bench.fold, bench.fold_again
    # Not against the environment, whose record begins without its state's memory.
    third = replay_cloth(record)
    differ = int((again.final.view(np.uint32) != third.final.view(np.uint32)).any(axis=1).sum())
    same = Reading(
        "CPU, particles that differ when the fold is repeated",
        float(differ),
        "particles",
        bar="<= 0",
        note=f"to the bit, after {len(record.actions)} frames of {len(record.final)} particles; "
        "the cloth alone, twice from the same state",
    )
    name = "CUDA against CPU, mean difference after 2 s of a fold"
    if bench.cuda is None:
        return Result((same, Reading.skip(name, "mm", NO_CUDA, bar="<= 2")))
    paths = [_play_part(bench, again, device) for device in ("cpu", bench.cuda)]
    mean = 1e3 * np.linalg.norm(paths[0] - paths[1], axis=2).mean(axis=1)
    row = Reading(name, float(mean[-1]), "mm", bar="<= 2", note=bench.cuda)
    figure = Figure(
        "cuda_against_cpu",
        "The first 2 s of the fold on both devices: how far particles lie apart.",
        (
            Chart(
                f"after 2 s: {mean[-1]:.2g} mm",
                "time [s]",
                "mean difference [mm]",
                (Series(np.arange(1, 121) / 60, np.maximum(mean, 1e-6)),),
                limits=(Limit(2.0, "bar at 2 s"),),
                is_log_y=True,
            ),
        ),
    )
    return Result((same, row), (figure,))


def _play_part(bench: Bench, again: ClothReplay, device: str) -> np.ndarray:
    """Two seconds from the first grasp on: particles [m], shape (120, V, 3)."""
    record = bench.fold
    first = next(iter(record.stages.values()))[0]
    solver, state = record.build(device=device)
    state.set_particles(again.positions[first][None], again.velocities[first][None])
    state.set_body_poses(record.poses[None, first], is_jump=True)
    path = []
    for frame in range(first, first + 120):
        record.play(solver, state, frame)
        path.append(state.get_positions()[0])
    return np.array(path)


def measure_fold_speed(bench: Bench) -> Result:
    """Time the cloth, and the environment with both robots."""
    record, replay = bench.fold, bench.fold_again
    cloth, step = 1e3 * replay.frame_seconds[2:], 1e3 * record.step_seconds[2:]
    bodies, shapes = replay.solver.model.body_count - 1, replay.solver.model.shape_count
    note = f"processor time; {len(record.final)} particles, {bodies} bodies with {shapes} shapes"
    rows = (
        Reading(
            "Fold Tops, frame of the cloth, mean",
            float(cloth.mean()),
            "ms",
            bar=f"<= {FRAME_BUDGET:.1f}",
            note=note + "; 1.5 times real time",
        ),
        Reading("Fold Tops, frame of the cloth, median", float(np.median(cloth)), "ms"),
        Reading(
            "Fold Tops, frame of the cloth, 95th percentile", float(np.percentile(cloth, 95)), "ms"
        ),
        Reading(
            "Fold Tops, cloth relative to real time",
            float(1e3 / 60 / cloth.mean()),
            "",
            bar=">= 1.5",
        ),
        Reading(
            "Fold Tops, step of the environment, mean",
            float(step.mean()),
            "ms",
            note="robots and cloth, nothing drawn",
        ),
    )
    t = np.arange(len(cloth)) / 60
    figure = Figure(
        "fold_speed",
        "Time of each frame while the robots fold the top, on one core: the cloth alone, "
        "and the step of the "
        "environment, which contains it (another run). Vertical lines: the hands of a stage begin "
        "to close.",
        (
            Chart(
                f"cloth {cloth.mean():.1f} ms a frame, {1e3 / 60 / cloth.mean():.2f} x real time",
                "simulated time [s]",
                "time of a frame [ms]",
                (
                    Series(t, _smooth(step), "environment", tone=1),
                    Series(t, _smooth(cloth), "cloth"),
                ),
                limits=(
                    Limit(FRAME_BUDGET, "bar: 1.5 x real time"),
                    *(
                        Limit(f / 60, name.replace("_", " "), is_vertical=True, is_quiet=True)
                        for name, (f, _) in record.stages.items()
                    ),
                ),
                y_range=(0.0, 1.25 * float(max(_smooth(step).max(), FRAME_BUDGET))),
            ),
        ),
    )
    return Result(rows, (figure,))


def _smooth(values: np.ndarray, window: int = 9) -> np.ndarray:
    """Median over some frames, which single disturbances of the machine do not enter."""
    padded = np.pad(values, window // 2, mode="edge")
    return np.median(np.lib.stride_tricks.sliding_window_view(padded, window), axis=1)
