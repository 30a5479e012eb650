"""Verb `dgl gam`: its actions are in the modules beside, one subcommand each."""

from dexgarmentlab.cli.flags import Actions, join_options, run_action
from dexgarmentlab.cli.gam_data import DataOptions, make_data
from dexgarmentlab.cli.gam_eval import GamEvalOptions, GamPackOptions, evaluate_models, pack
from dexgarmentlab.cli.gam_match import MatchOptions, match
from dexgarmentlab.cli.gam_skeleton import SkeletonOptions, register_category

__all__ = ["GamOptions", "run"]

_ACTIONS: Actions = {
    "data": (DataOptions, make_data),
    "match": (MatchOptions, match),
    "eval": (GamEvalOptions, evaluate_models),
    "pack": (GamPackOptions, pack),
    "skeleton": (SkeletonOptions, register_category),
}
GamOptions = join_options(_ACTIONS)
"""Options of each action."""


def run(options: object) -> int:
    """Do what the action says."""
    return run_action(_ACTIONS, options)
