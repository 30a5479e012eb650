"""Verb `dgl gam`: its actions are in the modules beside, one subcommand each."""

from typing import Annotated

import tyro  # noqa: TID253 - names the actions; the command line imports it anyway

from dexgarmentlab.cli.gam_data import DataOptions, make_data
from dexgarmentlab.cli.gam_eval import GamEvalOptions, GamPackOptions, evaluate_models, pack
from dexgarmentlab.cli.gam_match import MatchOptions, match
from dexgarmentlab.cli.gam_skeleton import SkeletonOptions, register_category

__all__ = ["GamOptions", "run"]

GamOptions = Annotated[
    Annotated[DataOptions, tyro.conf.subcommand("data")]
    | Annotated[MatchOptions, tyro.conf.subcommand("match")]
    | Annotated[GamEvalOptions, tyro.conf.subcommand("eval")]
    | Annotated[GamPackOptions, tyro.conf.subcommand("pack")]
    | Annotated[SkeletonOptions, tyro.conf.subcommand("skeleton")],
    tyro.conf.arg(name=""),
]
"""Options of each action."""


def run(
    options: DataOptions | MatchOptions | GamEvalOptions | GamPackOptions | SkeletonOptions,
) -> int:
    """Do what the action says."""
    if isinstance(options, DataOptions):
        return make_data(options)
    if isinstance(options, MatchOptions):
        return match(options)
    if isinstance(options, GamEvalOptions):
        return evaluate_models(options)
    if isinstance(options, GamPackOptions):
        return pack(options)
    return register_category(options)
