"""Verb `dgl gam`: its actions are in the modules beside, one subcommand each."""

from typing import Annotated

import tyro  # noqa: TID253 - names the actions; the command line imports it anyway

from dexgarmentlab.cli.gam_data import DataOptions, make_data
from dexgarmentlab.cli.gam_eval import EvalOptions, PackOptions, evaluate_models, pack
from dexgarmentlab.cli.gam_match import MatchOptions, match
from dexgarmentlab.cli.gam_skeleton import SkeletonOptions, register_category

__all__ = ["Options", "run"]

Options = Annotated[
    Annotated[DataOptions, tyro.conf.subcommand("data")]
    | Annotated[MatchOptions, tyro.conf.subcommand("match")]
    | Annotated[EvalOptions, tyro.conf.subcommand("eval")]
    | Annotated[PackOptions, tyro.conf.subcommand("pack")]
    | Annotated[SkeletonOptions, tyro.conf.subcommand("skeleton")],
    tyro.conf.arg(name=""),
]
"""What each action takes."""


def run(options: DataOptions | MatchOptions | EvalOptions | PackOptions | SkeletonOptions) -> int:
    """Do what the action says."""
    if isinstance(options, DataOptions):
        return make_data(options)
    if isinstance(options, MatchOptions):
        return match(options)
    if isinstance(options, EvalOptions):
        return evaluate_models(options)
    if isinstance(options, PackOptions):
        return pack(options)
    return register_category(options)
