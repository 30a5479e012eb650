"""Verb `dgl train`: what is trained is in the modules beside, one subcommand each."""

from dexgarmentlab.cli.flags import Actions, join_options, run_action
from dexgarmentlab.cli.train_gam import TrainGamOptions, train_gam
from dexgarmentlab.cli.train_policy import (
    TrainDp3Options,
    TrainDpOptions,
    TrainSadpGOptions,
    TrainSadpOptions,
    train_policy,
)
from dexgarmentlab.cli.train_primitive import TrainPrimitiveOptions, train_primitive

__all__ = ["TrainOptions", "run"]

_SUBJECTS: Actions = {
    "gam": (TrainGamOptions, train_gam),
    "sadp": (TrainSadpOptions, train_policy),
    "sadp-g": (TrainSadpGOptions, train_policy),
    "dp3": (TrainDp3Options, train_policy),
    "dp": (TrainDpOptions, train_policy),
    "primitive": (TrainPrimitiveOptions, train_primitive),
}
TrainOptions = join_options(_SUBJECTS)
"""Options of each subject."""


def run(options: object) -> int:
    """Train the subject."""
    return run_action(_SUBJECTS, options)
