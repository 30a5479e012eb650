"""Experiments: functions of a bench that return rows and figures."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import warp as wp

from dgl_bench.physics.figures import Figure
from dgl_bench.rows import Reading
from dgl_physics.quiet import quiet_warp

if TYPE_CHECKING:
    from dgl_bench.physics.fold_replay import ClothReplay, FoldRecord

__all__ = ["Bench", "Experiment", "Result"]


@dataclass(frozen=True)
class Result:
    """Result of an experiment."""

    rows: Sequence[Reading]
    figures: Sequence[Figure] = ()


@dataclass(frozen=True)
class Experiment:
    """One experiment."""

    name: str
    """Name for `--only`."""
    title: str
    about: str
    """Procedure and theory, in a sentence or two."""
    measure: Callable[["Bench"], Result]


@dataclass(kw_only=True)
class Bench:
    """Settings of a run, and what several experiments use and is made once."""

    effort: float = 1.0
    """Factor on what can be repeated: timed frames, drops, random actions."""
    seed: int = 0
    newton_python: str | None = None
    """Python interpreter that has Newton; the running one when None."""

    def __post_init__(self) -> None:
        if not self.effort > 0:
            raise ValueError(f"effort must be > 0; got {self.effort}")

    def scale(self, count: int, *, least: int = 1) -> int:
        """Scale a number of repetitions by the effort."""
        return max(least, round(count * self.effort))

    @property
    def cuda(self) -> str | None:
        """The first CUDA device, if there is one."""
        with quiet_warp():
            devices = wp.get_cuda_devices()
        return str(devices[0]) if devices else None

    @property
    def devices(self) -> tuple[str, ...]:
        """The CPU, and the first CUDA device where there is one."""
        return ("cpu",) if self.cuda is None else ("cpu", self.cuda)

    @cached_property
    def fold(self) -> "FoldRecord":
        """The Fold Tops scene, played once by the demonstration's robots."""
        from dgl_bench.physics.fold_replay import record_fold

        return record_fold(seed=self.seed)

    @cached_property
    def fold_again(self) -> "ClothReplay":
        """The cloth of that scene, simulated and timed by itself at the same settings."""
        from dgl_bench.physics.fold_replay import replay_cloth

        return replay_cloth(self.fold)
