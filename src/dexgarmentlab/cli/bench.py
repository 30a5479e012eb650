"""Verb `dgl bench`: its subjects are in the modules beside, one subcommand each."""

import importlib.util

from dexgarmentlab.cli.bench_assets import BenchAssetsOptions, measure_assets
from dexgarmentlab.cli.bench_collect import BenchCollectOptions, measure_collect
from dexgarmentlab.cli.bench_gam import BenchGamOptions, measure_gam
from dexgarmentlab.cli.bench_physics import BenchPhysicsOptions, measure_physics
from dexgarmentlab.cli.bench_sadp import BenchSadpOptions, measure_sadp
from dexgarmentlab.cli.bench_soak import BenchSoakOptions, measure_soak
from dexgarmentlab.cli.flags import Actions, join_options, run_action

__all__ = ["BenchOptions", "run"]

_SUBJECTS: Actions = {
    "physics": (BenchPhysicsOptions, measure_physics),
    "assets": (BenchAssetsOptions, measure_assets),
    "collect": (BenchCollectOptions, measure_collect),
    "gam": (BenchGamOptions, measure_gam),
    "sadp": (BenchSadpOptions, measure_sadp),
    "soak": (BenchSoakOptions, measure_soak),
}
BenchOptions = join_options(_SUBJECTS)
"""Options of each subject."""


def run(options: object) -> int:
    """Measure the subject."""
    if importlib.util.find_spec("dgl_bench") is None:
        raise ValueError(
            "the benchmarks are not installed: they are no part of the wheels; in a checkout, "
            "`make setup` installs them"
        )
    return run_action(_SUBJECTS, options)
