"""Verb `dgl bench`: its subjects are in the modules beside, one subcommand each."""

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
"""What each subject takes."""


def run(
    options: BenchPhysicsOptions
    | BenchAssetsOptions
    | BenchCollectOptions
    | BenchGamOptions
    | BenchSadpOptions
    | BenchSoakOptions,
) -> int:
    """Measure the subject."""
    if isinstance(options, BenchPhysicsOptions):
        return measure_physics(options)
    if isinstance(options, BenchCollectOptions):
        return measure_collect(options)
    if isinstance(options, BenchGamOptions):
        return measure_gam(options)
    if isinstance(options, BenchSadpOptions):
        return measure_sadp(options)
    if isinstance(options, BenchSoakOptions):
        return measure_soak(options)
    return measure_assets(options)
