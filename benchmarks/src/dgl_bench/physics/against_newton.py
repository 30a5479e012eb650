"""The hung panel in Newton's solvers, on the same mesh and core in the same run."""

import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np

from dgl_bench.physics.experiment import Bench, Result
from dgl_bench.physics.figures import Bars, Chart, Figure, Limit, Series
from dgl_bench.physics.panel import HungPanel, hang_panel, summarise_strain
from dgl_bench.rows import Reading
from dgl_physics import SolverConfig

__all__ = ["NewtonError", "Setting", "hang_here", "hang_in_newton", "measure_newton"]

FRAMES = 20
"""A third of a second, in which the panel falls into its corners: Newton's VBD takes seconds for a
frame."""


class Setting(NamedTuple):
    """Work of a solver for a frame: substeps and iterations."""

    substeps: int
    iterations: int
    """Passes over the constraints in each substep."""

    def __str__(self) -> str:
        return (
            f"{self.substeps} substeps x {self.iterations} iteration{'s' * (self.iterations > 1)}"
        )


SETTINGS = {
    "xpbd": (Setting(10, 2), "springs of 2 N/m, the stiffest that do not blow up"),
    "vbd": (Setting(10, 5), "contact of triangles at 3 mm"),
}
FIX = "install it with `pip install newton`, or name an interpreter that has it by --newton-python"


def measure_newton(bench: Bench) -> Result:
    """Hang the panel for a third of a second in this solver and in both of Newton's."""
    frames = bench.scale(FRAMES, least=3)
    panel = HungPanel()
    ours = hang_here(panel, frames)
    rows = _make_rows(
        "dgl-physics", ours, None, f"{len(panel.vertices)} particles, {frames} frames"
    )
    runs = {"dgl-physics": ours}
    for kind, (setting, about) in SETTINGS.items():
        name = f"Newton {kind.upper()}"
        try:
            theirs = hang_in_newton(bench, panel, frames, kind, setting)
        except NewtonError as err:
            rows.append(Reading.skip(f"{name}, frame relative to dgl-physics", "", str(err)))
            continue
        note = f"Newton {theirs['version']}, {setting}, {about}"
        rows += _make_rows(name, theirs, ours, note)
        runs[name] = theirs
    return Result(rows, (_draw(runs),))


class NewtonError(Exception):
    """Newton is not there, or did not do it; the message says why and what helps."""


def hang_here(panel: HungPanel, frames: int, config: SolverConfig | None = None) -> dict:
    """Hang the panel in this solver.

    Returns:
        "seconds": processor time of each frame [s]; "means" and "tails": mean and 99.9th percentile
        of the edges' absolute strain after each frame [%], None where it is not finite;
        "is_finite": whether all is.
    """
    warm = hang_panel(panel, drag=0.0, config=config)
    warm.step(2)
    scene = hang_panel(panel, drag=0.0, config=config)
    seconds, strains = [], []
    for _ in range(frames):
        started = time.process_time()
        scene.step()
        seconds.append(time.process_time() - started)
        strains.append(summarise_strain(scene.strain()))
    means, tails = zip(*strains, strict=True)
    return {"seconds": seconds, "means": means, "tails": tails, "is_finite": True}


def hang_in_newton(
    bench: Bench, panel: HungPanel, frames: int, kind: str, setting: Setting
) -> dict:
    """Hang the panel in a solver of Newton, "xpbd" or "vbd"; return as `hang_here`.

    Raises:
        NewtonError: If Newton is not there, or does not do it.
    """
    python = bench.newton_python or sys.executable
    probe = _call([python, "-I", "-c", "import newton"])
    if probe.returncode != 0:
        if "No module named 'newton'" in probe.stderr:
            raise NewtonError(f"Newton is not installed for {Path(python).name}; {FIX}")
        raise NewtonError(f"Newton does not start: {_last_line(probe.stderr)}")
    from dgl_physics.topology import compute_edges

    worker = Path(__file__).with_name("_newton_worker.py")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "panel.npz"
        np.savez(
            path,
            vertices=panel.vertices,
            faces=panel.faces,
            edges=compute_edges(panel.faces),
            pinned=panel.pinned,
            area_density=panel.material.area_density,
            stretch_stiffness=panel.material.stretch_stiffness,
            thickness=panel.material.thickness,
        )
        done = _call([python, "-I", str(worker), str(path), str(frames), kind, *map(str, setting)])
    if done.returncode != 0:
        raise NewtonError(f"it failed: {_last_line(done.stderr)}")
    return json.loads(done.stdout.splitlines()[-1])


def _call(command: list[str]) -> subprocess.CompletedProcess[str]:
    try:
        return subprocess.run(command, capture_output=True, text=True, check=False)
    except OSError as err:
        raise NewtonError(f"{command[0]} cannot be run ({err.strerror}); {FIX}") from err


def _last_line(text: str) -> str:
    lines = text.strip().splitlines()
    return lines[-1] if lines else "no message"


def _make_rows(name: str, run: dict, ours: dict | None, note: str) -> list[Reading]:
    frame = _frame(run)
    rows = [Reading(f"{name}, frame of the hung panel", frame, "ms", note=note)]
    if ours is not None:
        rows.append(
            Reading(
                f"{name}, frame relative to dgl-physics",
                frame / _frame(ours),
                "times",
                note="" if run["is_finite"] else "its result is not finite",
            )
        )
    for label, key in (("mean strain", "means"), ("99.9th percentile of strain", "tails")):
        values = [v for v in run[key] if v is not None]
        late = values[len(values) // 2 :]
        is_whole = len(values) == len(run[key])
        rows.append(
            Reading(
                f"{name}, {label} while it falls into its corners",
                float(np.mean(late)) if is_whole else None,
                "%",
                note="mean of the second half of the frames" if is_whole else "not finite",
            )
        )
    return rows


def _frame(run: dict) -> float:
    """Median time of a frame [ms]."""
    return 1e3 * float(np.median(run["seconds"]))


def _draw(runs: dict[str, dict]) -> Figure:
    names = list(runs)
    frames = [_frame(run) for run in runs.values()]
    curves = []
    for tone, (name, run) in enumerate(runs.items()):
        t = np.arange(1, len(run["tails"]) + 1) / 60
        tails = [np.nan if v is None else max(v, 1e-3) for v in run["tails"]]
        curves.append(Series(t, tails, name, tone=tone))
    return Figure(
        "newton",
        "The same panel of two layers hung by two corners in this solver and in Newton's, "
        "on the same core: "
        "time of a frame, and the strain that 1 in 1,000 edges exceeds while it falls into its "
        "corners.",
        (
            Bars("time of a frame", names, frames, "time of a frame [ms]", is_log=len(names) > 1),
            Chart(
                "strain at the same mesh",
                "time [s]",
                "99.9th percentile of strain [%]",
                curves,
                limits=(Limit(4.0, "bar at rest"),),
                is_log_y=True,
            ),
        ),
    )
