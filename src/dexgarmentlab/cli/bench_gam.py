"""`dgl bench gam`: the speed of the affordance model."""

from dataclasses import dataclass
from typing import Literal

from dexgarmentlab.cli import EXIT_OK, console
from dexgarmentlab.cli.bench_physics import print_rows

__all__ = ["BenchGamOptions", "measure_gam"]


@dataclass(frozen=True, kw_only=True)
class BenchGamOptions:
    """Time the affordance model on pairs of clouds and batches of 32, on CPU and CUDA.

    Example: dgl bench gam --json
    """

    network: tuple[Literal["small", "paper"], ...] = ("small", "paper")
    """Networks to time, beside the shipped one."""
    repeats: int = 20
    """Timed pairs; the median counts."""
    threads: int = 1
    """Threads of the CPU."""
    seed: int = 0
    """Of the clouds and the weights."""
    json: bool = False
    """Print the rows as JSON."""


def measure_gam(options: BenchGamOptions) -> int:
    """Measure and write the rows."""
    from dgl_bench.gam import measure_speed

    console.info("timing the affordance model ...")
    rows = measure_speed(
        options.network, repeats=options.repeats, threads=options.threads, seed=options.seed
    )
    print_rows(rows, as_json=options.json)
    return EXIT_OK
