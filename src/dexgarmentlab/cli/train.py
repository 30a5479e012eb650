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
from dexgarmentlab.cli.train_primitive import TrainPrimitiveOptions, train_primitive

__all__ = ["TrainOptions", "run"]

TrainOptions = Annotated[
    Annotated[TrainGamOptions, tyro.conf.subcommand("gam")]
    | Annotated[TrainSadpOptions, tyro.conf.subcommand("sadp")]
    | Annotated[TrainSadpGOptions, tyro.conf.subcommand("sadp-g")]
    | Annotated[TrainDp3Options, tyro.conf.subcommand("dp3")]
    | Annotated[TrainDpOptions, tyro.conf.subcommand("dp")]
    | Annotated[TrainPrimitiveOptions, tyro.conf.subcommand("primitive")],
    tyro.conf.arg(name=""),
]
"""Options of each subject."""


def run(options: TrainGamOptions | TrainPolicyOptions | TrainPrimitiveOptions) -> int:
    """Train the subject."""
    if isinstance(options, TrainGamOptions):
        return train_gam(options)
    if isinstance(options, TrainPrimitiveOptions):
        return train_primitive(options)
    return train_policy(options)
