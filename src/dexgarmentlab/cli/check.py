"""Verb `dgl check`."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro  # noqa: TID253 - marks the positional argument; the command line imports it anyway

from dexgarmentlab.cli import EXIT_FAILURE, EXIT_OK, console

__all__ = ["CheckOptions", "run"]


@dataclass(frozen=True, kw_only=True)
class CheckOptions:
    """Send the actions of an exported data set through the environment that evaluates policies.

    Where a recorded success is none there, no policy can learn the task from the data. The exit
    status is 1 when fewer than nine tenths of the verdicts agree.

    Example: dgl check lerobot out/fold_lerobot --episodes 10
    """

    format: Annotated[Literal["lerobot"], tyro.conf.Positional, tyro.conf.arg(metavar="FORMAT")]
    """lerobot."""
    dataset: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="DATASET")]
    """Folder of a data set that `dgl export` wrote, of episodes instead of stages."""
    episodes: int | None = None
    """The first so many episodes. Default: all."""
    json: bool = False
    """Write the verdicts as JSON."""


LEAST = 0.9
"""Share of the verdicts that must agree."""


def run(options: CheckOptions) -> int:
    """Send the actions, and compare the verdicts."""
    from dgl_collect.exporting.origins import read_origins
    from dgl_collect.exporting.writers import load_format

    if options.episodes is not None and options.episodes < 1:
        raise ValueError(f"--episodes must be at least 1; got {options.episodes}")
    check = load_format(options.format).check
    wanted = len(read_origins(options.dataset).episodes[: options.episodes])
    with console.progress("checking", wanted) as bar:
        found = check(options.dataset, episodes=options.episodes, on_episode=bar.advance)
    agreed = sum(each.recorded == each.reached for each in found)
    if options.json:
        rows = [vars(each) for each in found]
        console.out_json({"episodes": rows, "agreed": agreed})
    else:
        for each in found:
            if each.recorded != each.reached:
                words = {True: "success", False: "failure"}
                console.out(
                    f"episode {each.index}: recorded {words[each.recorded]}, "
                    f"{words[each.reached]} after {each.actions} actions"
                )
        console.out(f"{agreed} of {len(found)} verdicts agree")
    return EXIT_OK if agreed >= LEAST * len(found) else EXIT_FAILURE
