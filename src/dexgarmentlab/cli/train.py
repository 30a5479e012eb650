"""Verb `dgl train`: what is trained is in the modules beside."""

from dexgarmentlab.cli.train_gam import TrainGamOptions, train_gam

__all__ = ["Options", "run"]

Options = TrainGamOptions
"""What each subject takes."""


def run(options: TrainGamOptions) -> int:
    """Train the subject."""
    return train_gam(options)
