"""All experiments by name, quick ones first.

A new one is one function of a `Bench`, `measure_NAME`, and one line of the table.
"""

import difflib
import importlib
import sys
import time
from collections.abc import Callable, Iterator, Sequence

from dgl_bench.physics.experiment import Bench, Experiment, Result
from dgl_bench.rows import Reading
from dgl_physics import PhysicsError

__all__ = ["EXPERIMENTS", "run", "select"]


_TABLE = {
    "free_fall": ("Free fall", "mechanics", "Without drag a sheet falls by ½gt²."),
    "incline": (
        "Friction on a slope",
        "mechanics",
        "A patch stays where tan θ < μ, and slides with g (sin θ - μ cos θ) where it is steeper.",
    ),
    "momentum": (
        "Momentum",
        "mechanics",
        "Free cloth keeps its momentum; what cloth and a body give to each other cancels.",
    ),
    "fabrics": (
        "Peirce's test of the fabrics",
        "fabrics",
        "A strip that hangs over an edge by twice its fabric's bending length has the chord of "
        "the heavy elastica.",
    ),
    "solids": (
        "Elastic solids",
        "solids",
        "A hanging bar stretches by F/A = E ε at every cut; a hat that was squeezed onto a "
        "head returns to its shape.",
    ),
    "pinch": (
        "A pinch between two fingers",
        "pinch",
        "Friction alone lifts and holds; without friction and adhesion it falls, and one "
        "finger lifts nothing.",
    ),
    "panel": (
        "Stretch of a hung panel",
        "panel",
        "Cloth of this stiffness would stretch by less than a thousandth; what is seen is what "
        "the solver leaves.",
    ),
    "batch": ("Batches", "batch", "B environments in one model."),
    "fold_speed": (
        "Speed of the Fold Tops scene",
        "fold",
        "Both robots are colliders, and the garment is one of the catalogue's.",
    ),
    "cpu_code": (
        "Two codes for a CPU",
        "cpu_code",
        "Vector code takes eight constraints at a time and gives what Warp's own gives, to the "
        "bit.",
    ),
    "fold_rest": (
        "Fold and rest",
        "fold",
        "What was folded should stay as it is, and come to rest.",
    ),
    "determinism": (
        "Determinism",
        "fold",
        "The same motion gives the same particles to the bit on the CPU, and nearly so on CUDA.",
    ),
    "convergence": (
        "Convergence of the fold",
        "fold",
        "A result that changes with the number of substeps is the solver's and not the cloth's.",
    ),
    "robustness": (
        "Flailing robots",
        "robustness",
        "Nothing that robots do may make the simulation explode.",
    ),
    "newton": (
        "Beside Newton",
        "against_newton",
        "The same mesh, hung by the same corners on the same core, in Newton's XPBD and VBD.",
    ),
    "equal_strain": (
        "Beside Newton at equal strain",
        "equal_strain",
        "The same panel: how long each solver takes for a frame of the same quality, by its "
        "cheapest setting.",
    ),
    "self_contact": (
        "Drops and folds",
        "selfcontact",
        "Cloth cannot pass through cloth: no edge may pierce a triangle of another place.",
    ),
}
"""Title of each experiment, module with its function `measure_<name>`, and what is measured."""


def _measure_in(module: str, name: str) -> Callable[[Bench], Result]:
    """Import an experiment's module when it is measured: some need the simulator of the tasks."""

    def measure(bench: Bench) -> Result:
        found = importlib.import_module(f"dgl_bench.physics.{module}")
        return getattr(found, f"measure_{name}")(bench)

    return measure


EXPERIMENTS: dict[str, Experiment] = {
    name: Experiment(name, title, about, _measure_in(module, name))
    for name, (title, module, about) in _TABLE.items()
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
            result = Result((Reading(name, None, "", bar=">= 1", note=note),))
        yield experiment, result, time.perf_counter() - started


def _get_findings() -> tuple[type[Exception], ...]:
    """Return the errors that are findings: of the simulation and, if imported, of the tasks."""
    tasks = sys.modules.get("dgl_tasks.errors")
    return (PhysicsError,) if tasks is None else (PhysicsError, tasks.TaskError)
