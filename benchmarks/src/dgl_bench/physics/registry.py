"""All experiments by name, quick ones first.

A new one is one function of a `Bench` and one line here.
"""

import difflib
import importlib
import sys
import time
from collections.abc import Callable, Iterator, Sequence

from dgl_bench.physics.experiment import Bench, Experiment, Result
from dgl_bench.rows import Row
from dgl_physics import PhysicsError

__all__ = ["EXPERIMENTS", "run", "select"]


def _lazily(module: str, function: str) -> Callable[[Bench], Result]:
    """Import an experiment's module when it is measured: some need the simulator of the tasks."""

    def measure(bench: Bench) -> Result:
        found = importlib.import_module(f"dgl_bench.physics.{module}")
        return getattr(found, function)(bench)

    return measure


EXPERIMENTS: dict[str, Experiment] = {
    e.name: e
    for e in (
        Experiment(
            "free_fall",
            "Free fall",
            "Without drag a sheet falls by ½gt².",
            _lazily("mechanics", "measure_free_fall"),
        ),
        Experiment(
            "incline",
            "Friction on a slope",
            "A patch stays where tan θ < μ, and slides with g (sin θ - μ cos θ) where it is "
            "steeper.",
            _lazily("mechanics", "measure_incline"),
        ),
        Experiment(
            "momentum",
            "Momentum",
            "Free cloth keeps its momentum; what cloth and a body give to each other cancels.",
            _lazily("mechanics", "measure_momentum"),
        ),
        Experiment(
            "fabrics",
            "Peirce's test of the fabrics",
            "A strip that hangs over an edge by twice its fabric's bending length has the chord of "
            "the heavy elastica.",
            _lazily("fabrics", "measure_fabrics"),
        ),
        Experiment(
            "solids",
            "Elastic solids",
            "A hanging bar stretches by F/A = E ε at every cut; a hat that was squeezed onto a "
            "head returns to its shape.",
            _lazily("solids", "measure_solids"),
        ),
        Experiment(
            "pinch",
            "A pinch between two fingers",
            "Friction alone lifts and holds; without friction and adhesion it falls, and one "
            "finger lifts nothing.",
            _lazily("pinch", "measure_pinch"),
        ),
        Experiment(
            "panel",
            "Stretch of a hung panel",
            "Cloth of this stiffness would stretch by less than a thousandth; what is seen is what "
            "the solver leaves.",
            _lazily("panel", "measure_panel"),
        ),
        Experiment(
            "batch",
            "Batches",
            "B environments in one model.",
            _lazily("batch", "measure_batch"),
        ),
        Experiment(
            "fold_speed",
            "Speed of the Fold Tops scene",
            "Both robots are colliders, and the garment is one of the catalogue's.",
            _lazily("fold", "measure_fold_speed"),
        ),
        Experiment(
            "cpu_code",
            "Two codes for a CPU",
            "Vector code takes eight constraints at a time and gives what Warp's own gives, to the "
            "bit.",
            _lazily("cpu_code", "measure_cpu_code"),
        ),
        Experiment(
            "fold_rest",
            "Fold and rest",
            "What was folded should stay as it is, and come to rest.",
            _lazily("fold", "measure_fold_rest"),
        ),
        Experiment(
            "determinism",
            "Determinism",
            "The same motion gives the same particles to the bit on the CPU, and nearly so on "
            "CUDA.",
            _lazily("fold", "measure_determinism"),
        ),
        Experiment(
            "convergence",
            "Convergence of the fold",
            "A result that changes with the number of substeps is the solver's and not the "
            "cloth's.",
            _lazily("fold", "measure_convergence"),
        ),
        Experiment(
            "robustness",
            "Flailing robots",
            "Nothing that robots do may make the simulation explode.",
            _lazily("robustness", "measure_robustness"),
        ),
        Experiment(
            "newton",
            "Beside Newton",
            "The same mesh, hung by the same corners on the same core, in Newton's XPBD and VBD.",
            _lazily("against_newton", "measure_newton"),
        ),
        Experiment(
            "equal_strain",
            "Beside Newton at equal strain",
            "The same panel: how long each solver takes for a frame of the same quality, by its "
            "cheapest setting.",
            _lazily("equal_strain", "measure_equal_strain"),
        ),
        Experiment(
            "self_contact",
            "Drops and folds",
            "Cloth cannot pass through cloth: no edge may pierce a triangle of another place.",
            _lazily("selfcontact", "measure_self_contact"),
        ),
    )
}


def select(names: Sequence[str] = ()) -> tuple[Experiment, ...]:
    """Choose experiments by name, in their own order; all when no name is given.

    Raises:
        ValueError: If a name is unknown; the message lists the valid ones.
    """
    for name in names:
        if name not in EXPERIMENTS:
            near = difflib.get_close_matches(name, EXPERIMENTS, 1)
            hint = f"did you mean {near[0]}? " if near else ""
            raise ValueError(
                f"unknown experiment {name!r}; {hint}there are {', '.join(EXPERIMENTS)}"
            )
    return tuple(e for e in EXPERIMENTS.values() if not names or e.name in names)


def run(
    experiments: Sequence[Experiment], bench: Bench
) -> Iterator[tuple[Experiment, Result, float]]:
    """Measure one after the other; yields each with its result and the time that it took [s].

    A simulation that fails is a finding: the experiment's only row then says how, and the next
    follows.
    """
    for experiment in experiments:
        started = time.perf_counter()
        try:
            result = experiment.measure(bench)
        except _get_findings() as err:
            note = f"{type(err).__name__}: {err}"
            name = f"{experiment.title}, measured to its end"
            result = Result(rows=(Row(name=name, value=None, unit="", bar=">= 1", note=note),))
        yield experiment, result, time.perf_counter() - started


def _get_findings() -> tuple[type[Exception], ...]:
    """Return the errors that are findings: of the simulation and, if imported, of the tasks."""
    tasks = sys.modules.get("dgl_tasks.errors")
    return (PhysicsError,) if tasks is None else (PhysicsError, tasks.TaskError)
