"""The solver's two codes for a CPU, vector code and Warp's own, on the same frames."""

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dgl_bench.physics.experiment import Bench, Result
from dgl_bench.physics.figures import Bars, Figure
from dgl_bench.physics.speed_scenes import SpeedScene, make_drop, make_fold, make_hanging
from dgl_bench.rows import Reading
from dgl_physics.launcher import find_vector_obstacle

__all__ = ["CodeTimes", "compare_codes", "make_rows", "measure_cpu_code"]

BARS = {"Fold Tops, awake frame": "<= 5", "crumpled drop, frame": "<= 8"}
"""Longest frames of vector code [ms]."""
BLOCK = 30
"""Frames of one code before the other has its turn: a busy machine disturbs both alike."""
WARM_UP = 2
"""Frames at the beginning, awake, in which kernels are loaded."""


@dataclass(frozen=True, kw_only=True)
class CodeTimes:
    """Times of both codes for the same frames."""

    vector: np.ndarray
    """Processor time of each frame that counts [ms], shape (T,)."""
    warp: np.ndarray
    """The same of Warp's code."""
    differing: int
    """Particles that are elsewhere at the end, by a single bit."""


def measure_cpu_code(bench: Bench) -> Result:
    """Play the three scenes with both codes."""
    from dgl_bench.physics.fold_replay import record_fold
    from dgl_collect.attempt_jobs import make_attempt_seed

    if obstacle := find_vector_obstacle():
        why = f"this CPU runs no vector code: {obstacle}"
        return Result([Reading.skip("vector code against Warp's", "times", why)])
    # the garment and place of a collection's first attempt
    record = record_fold(seed=make_attempt_seed(bench.seed, 0), garment=None)
    found = [(s, compare_codes(s)) for s in (make_fold(record), make_drop(), make_hanging())]
    rows = [row for scene, comparison in found for row in make_rows(scene, comparison)]
    return Result(rows, (_draw(found),))


def compare_codes(scene: SpeedScene) -> CodeTimes:
    """Play a scene with both codes, in turns; frames in which all sleep do not count."""
    codes = ("vector", "warp")
    built = {code: scene.build(replace(scene.config, cpu_code=code)) for code in codes}
    milliseconds = np.zeros((len(codes), scene.frames))
    is_awake = np.zeros(scene.frames, dtype=bool)
    for start in range(0, scene.frames, BLOCK):
        for row, code in enumerate(codes):
            solver, state = built[code]
            for frame in range(start, min(start + BLOCK, scene.frames)):
                before = state.get_positions()
                began = time.process_time()
                scene.play(solver, state, frame)
                milliseconds[row, frame] = 1e3 * (time.process_time() - began)
                is_awake[frame] = (state.get_positions() != before).any()
    counted = np.flatnonzero(is_awake)[WARM_UP:]
    counted = counted[counted >= scene.first_timed]
    ends = [state.get_positions()[0].view(np.uint32) for _, state in built.values()]
    vector, warp = milliseconds[:, counted]
    return CodeTimes(
        vector=vector, warp=warp, differing=int((ends[0] != ends[1]).any(axis=1).sum())
    )


def make_rows(scene: SpeedScene, found: CodeTimes) -> list[Reading]:
    """Sum up a comparison."""
    vector, warp = float(found.vector.mean()), float(found.warp.mean())
    middle, late = np.percentile(found.vector, (50, 95))
    spread = f"median {middle:.1f}, 95th percentile {late:.1f}"
    return [
        Reading(
            f"{scene.name}, vector code",
            vector,
            "ms",
            bar=BARS.get(scene.name, ""),
            note=f"mean processor time of {len(found.vector)} frames, {spread}; {scene.note}",
        ),
        Reading(f"{scene.name}, Warp's code", warp, "ms"),
        Reading(f"{scene.name}, Warp's code relative to vector code", warp / vector, "times"),
        Reading(
            f"{scene.name}, particles that differ at the end",
            float(found.differing),
            "particles",
            bar="<= 0",
            note="to the bit",
        ),
    ]


def _draw(found: Sequence[tuple[SpeedScene, CodeTimes]]) -> Figure:
    names = [scene.name.removesuffix(", frame").removesuffix(", awake frame") for scene, _ in found]
    panels = [
        Bars(
            title,
            names,
            [float(getattr(comparison, code).mean()) for _, comparison in found],
            "processor time of a frame [ms]",
        )
        for code, title in (("vector", "vector code"), ("warp", "Warp's code"))
    ]
    return Figure(
        "cpu_code",
        "Mean time of a frame on one core, the same frames in turns by vector code and by "
        "Warp's own: the "
        "robots' fold while the top moves, a crumpled dress, and a dress that hangs from two "
        "hands over a bar.",
        panels,
    )
