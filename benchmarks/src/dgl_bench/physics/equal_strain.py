"""Cost of a frame of the hung panel in each solver, at equal strain."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from dgl_bench.physics.against_newton import (
    NewtonError,
    Setting,
    hang_here,
    hang_in_newton,
)
from dgl_bench.physics.experiment import Bench, Result
from dgl_bench.physics.panel import HungPanel
from dgl_bench.rows import Reading
from dgl_physics import SolverConfig

__all__ = ["StrainTrial", "find_cheapest", "make_rows", "measure_equal_strain"]

FRAMES = 10
"""A sixth of a second, in which the panel falls into its corners; strain counts in its second
half."""
MEAN_LIMIT, TAIL_LIMIT = 0.5, 8.0
"""Largest mean and 99.9th percentile of the edges' strain [%]: about what this solver leaves at its
default."""
OURS = "dgl-physics"
SETTINGS: Mapping[str, Sequence[Setting]] = MappingProxyType(
    {
        OURS: [Setting(n, 1) for n in (4, 5, 6, 8, 9, 10, 12, 15, 20)],
        "xpbd": [Setting(n, 1) for n in (40, 60, 80, 100, 120, 160, 240)],
        "vbd": [Setting(20, 2), Setting(40, 1), Setting(30, 2), Setting(40, 2), Setting(80, 1)],
    }
)
"""Settings from cheap to expensive. With more iterations instead of substeps, XPBD needs softer
springs."""


@dataclass(frozen=True, kw_only=True)
class StrainTrial:
    """The panel with one setting."""

    setting: Setting
    frame: float
    """Median processor time of a frame [ms]."""
    mean: float
    """Mean strain of the edges [%]; infinite where the simulation blew up."""
    tail: float
    """99.9th percentile of it [%]."""

    @property
    def is_enough(self) -> bool:
        """True if the strain is within the limits."""
        return self.mean <= MEAN_LIMIT and self.tail <= TAIL_LIMIT

    def __str__(self) -> str:
        return f"{self.setting}: mean strain {self.mean:.2f} %, 99.9th percentile {self.tail:.1f} %"

    @classmethod
    def from_run(cls, setting: Setting, run: Mapping) -> "StrainTrial":
        """Sum up what `hang_here` or `hang_in_newton` returned."""
        late = slice(len(run["means"]) // 2, None)
        mean, tail = (
            np.inf if None in run[key] else float(np.mean(run[key][late]))
            for key in ("means", "tails")
        )
        frame = 1e3 * float(np.median(run["seconds"]))
        return cls(setting=setting, frame=frame, mean=mean, tail=tail)


def measure_equal_strain(bench: Bench) -> Result:
    """Find the cheapest setting of each solver that leaves as little strain."""
    frames, panel = bench.scale(FRAMES, least=4), HungPanel()

    def hang(kind: str, setting: Setting) -> Mapping:
        if kind == OURS:
            return hang_here(panel, frames, SolverConfig(substeps=setting.substeps))
        return hang_in_newton(bench, panel, frames, kind, setting)

    rows: list[Reading] = []
    ours: StrainTrial | None = None
    for kind, settings in SETTINGS.items():
        name = kind if kind == OURS else f"Newton {kind.upper()}"
        try:
            trials = find_cheapest(settings, lambda s, kind=kind: hang(kind, s))
        except NewtonError as err:
            rows.append(Reading.skip(f"{name}, frame at equal strain", "ms", str(err)))
            continue
        rows += make_rows(name, trials, ours)
        ours = trials[-1] if kind == OURS else ours
    return Result(rows)


def find_cheapest(
    settings: Sequence[Setting], hang: Callable[[Setting], Mapping]
) -> list[StrainTrial]:
    """Try settings, from cheap to expensive, up to the first that is enough."""
    trials: list[StrainTrial] = []
    for setting in settings:
        trials.append(StrainTrial.from_run(setting, hang(setting)))
        if trials[-1].is_enough:
            break
    return trials


def make_rows(name: str, trials: Sequence[StrainTrial], ours: StrainTrial | None) -> list[Reading]:
    """Sum up the trials of a solver, beside the one that was enough for this solver."""
    label, found = f"{name}, frame at equal strain", trials[-1]
    if not found.is_enough:
        return [Reading(label, None, "ms", note=f"not reached; {found}")]
    before = f"; not enough: {trials[-2]}" if len(trials) > 1 else ""
    rows = [Reading(label, found.frame, "ms", note=f"processor time; {found}{before}")]
    if ours is not None and ours.is_enough:
        rows.append(
            Reading(
                f"{label}, relative to {OURS}",
                found.frame / ours.frame,
                "times",
                note=f"at most {MEAN_LIMIT:g} % mean strain and {TAIL_LIMIT:g} % at the 99.9th "
                "percentile",
            )
        )
    return rows
