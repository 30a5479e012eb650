"""Verb `dgl bench`: its subjects are in the modules beside, one subcommand each."""

from typing import Annotated

import tyro  # noqa: TID253 - names the subjects; the command line imports it anyway

from dexgarmentlab.cli.bench_assets import AssetsOptions, measure_assets
from dexgarmentlab.cli.bench_collect import CollectOptions, measure_collect
from dexgarmentlab.cli.bench_gam import GamOptions, measure_gam
from dexgarmentlab.cli.bench_physics import PhysicsOptions, measure_physics
from dexgarmentlab.cli.bench_sadp import SadpOptions, measure_sadp
from dexgarmentlab.cli.bench_soak import SoakOptions, measure_soak

__all__ = ["Options", "run"]

Options = Annotated[
    Annotated[PhysicsOptions, tyro.conf.subcommand("physics")]
    | Annotated[AssetsOptions, tyro.conf.subcommand("assets")]
    | Annotated[CollectOptions, tyro.conf.subcommand("collect")]
    | Annotated[GamOptions, tyro.conf.subcommand("gam")]
    | Annotated[SadpOptions, tyro.conf.subcommand("sadp")]
    | Annotated[SoakOptions, tyro.conf.subcommand("soak")],
    tyro.conf.arg(name=""),
]
"""What each subject takes."""


def run(
    options: PhysicsOptions
    | AssetsOptions
    | CollectOptions
    | GamOptions
    | SadpOptions
    | SoakOptions,
) -> int:
    """Measure the subject."""
    if isinstance(options, PhysicsOptions):
        return measure_physics(options)
    if isinstance(options, CollectOptions):
        return measure_collect(options)
    if isinstance(options, GamOptions):
        return measure_gam(options)
    if isinstance(options, SadpOptions):
        return measure_sadp(options)
    if isinstance(options, SoakOptions):
        return measure_soak(options)
    return measure_assets(options)
