"""Verb `dgl bench`: its subjects are in the modules beside, one subcommand each."""

import importlib.util
from typing import Annotated

import tyro  # noqa: TID253 - names the subjects; the command line imports it anyway

from dexgarmentlab.cli.bench_assets import BenchAssetsOptions, measure_assets
from dexgarmentlab.cli.bench_collect import BenchCollectOptions, measure_collect
from dexgarmentlab.cli.bench_gam import BenchGamOptions, measure_gam
from dexgarmentlab.cli.bench_physics import BenchPhysicsOptions, measure_physics
from dexgarmentlab.cli.bench_sadp import BenchSadpOptions, measure_sadp
from dexgarmentlab.cli.bench_soak import BenchSoakOptions, measure_soak

__all__ = ["BenchOptions", "run"]

BenchOptions = Annotated[
    Annotated[BenchPhysicsOptions, tyro.conf.subcommand("physics")]
    | Annotated[BenchAssetsOptions, tyro.conf.subcommand("assets")]
    | Annotated[BenchCollectOptions, tyro.conf.subcommand("collect")]
    | Annotated[BenchGamOptions, tyro.conf.subcommand("gam")]
    | Annotated[BenchSadpOptions, tyro.conf.subcommand("sadp")]
    | Annotated[BenchSoakOptions, tyro.conf.subcommand("soak")],
    tyro.conf.arg(name=""),
]
"""Options of each subject."""


_MEASURES = {
    BenchPhysicsOptions: measure_physics,
    BenchAssetsOptions: measure_assets,
    BenchCollectOptions: measure_collect,
    BenchGamOptions: measure_gam,
    BenchSadpOptions: measure_sadp,
    BenchSoakOptions: measure_soak,
}


def run(options: object) -> int:
    """Measure the subject."""
    if importlib.util.find_spec("dgl_bench") is None:
        raise ValueError(
            "the benchmarks are not installed: they are no part of the wheels; in a checkout, "
            "`make setup` installs them"
        )
    return _MEASURES[type(options)](options)
