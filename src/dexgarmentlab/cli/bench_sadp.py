"""`dgl bench sadp`: the speed of the policies."""

from dataclasses import dataclass
from typing import Literal

from dexgarmentlab.cli import EXIT_OK, console
from dexgarmentlab.cli.bench_physics import print_rows

__all__ = ["BenchSadpOptions", "measure_sadp"]


@dataclass(frozen=True, kw_only=True)
class BenchSadpOptions:
    """Time the policies: a chunk of joint targets, the start of a stage, and training steps.

    Example: dgl bench sadp --json
    """

    method: tuple[Literal["sadp", "sadp-g", "dp3", "dp"], ...] = ("sadp", "sadp-g", "dp3", "dp")
    """Policies to time."""
    preset: Literal["small", "paper"] = "small"
    """Their sizes."""
    device: Literal["cpu", "cuda"] = "cpu"
    """Device to compute on."""
    precision: Literal["no", "bf16"] = "no"
    """Mixed precision of training."""
    repeats: int = 20
    """Timed chunks; the median counts."""
    threads: int = 1
    """Threads of the CPU."""
    seed: int = 0
    """Of weights and observations."""
    json: bool = False
    """Print the rows as JSON."""


def measure_sadp(options: BenchSadpOptions) -> int:
    """Measure and write the rows."""
    from dgl_bench.sadp import measure_speed

    console.info("timing the policies ...")
    rows = measure_speed(
        options.method,
        size=options.preset,
        device=options.device,
        precision=options.precision,
        repeats=options.repeats,
        threads=options.threads,
        seed=options.seed,
    )
    print_rows(rows, as_json=options.json)
    return EXIT_OK
