"""Verb `dgl train`: what is trained is in the modules beside, one subcommand each."""

from typing import Annotated

import tyro  # noqa: TID253 - names the subjects; the command line imports it anyway

from dexgarmentlab.cli.train_gam import TrainGamOptions, train_gam
from dexgarmentlab.cli.train_policy import (
    TrainDp3Options,
    TrainDpOptions,
    TrainPolicyOptions,
    TrainSadpGOptions,
    TrainSadpOptions,
    train_policy,
)

__all__ = ["TrainOptions", "run"]

TrainOptions = Annotated[
    Annotated[TrainGamOptions, tyro.conf.subcommand("gam")]
    | Annotated[TrainSadpOptions, tyro.conf.subcommand("sadp")]
    | Annotated[TrainSadpGOptions, tyro.conf.subcommand("sadp-g")]
    | Annotated[TrainDp3Options, tyro.conf.subcommand("dp3")]
    | Annotated[TrainDpOptions, tyro.conf.subcommand("dp")],
    tyro.conf.arg(name=""),
]
"""Options of each subject."""


def run(options: TrainGamOptions | TrainPolicyOptions) -> int:
    """Train the subject."""
    return train_gam(options) if isinstance(options, TrainGamOptions) else train_policy(options)
