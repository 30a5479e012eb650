"""Verb `dgl relabel`."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro  # noqa: TID253 - marks the positional argument; the command line imports it anyway

from dexgarmentlab.cli import EXIT_FAILURE, EXIT_OK, console
from dexgarmentlab.cli.flags import check_writable, find_recorded_task

if TYPE_CHECKING:
    from dgl_collect.relabel import Relabelling

__all__ = ["RelabelOptions", "run"]


@dataclass(frozen=True, kw_only=True)
class RelabelOptions:
    """Give recorded episodes the affordance that the Garment Affordance Model sees in their clouds.

    For policies that will be run behind the model, from demonstrations that another matcher has
    guided, and for new weights of the model. What the hands did stays as it was; episodes whose
    hands took hold elsewhere than the model would have sent them are left out. Ctrl-C keeps every
    finished file, and the same command goes on.

    Example: dgl relabel out/fling/episodes --out out/fling_gam
    """

    data: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="EPISODES")]
    """Folder of collected episodes (*.h5), of one task."""
    out: Path
    """Folder for the copies."""
    weights: Path | None = None
    """Weights of the model, ending in .safetensors; those that come with it when not given."""
    within: float = 0.15
    """Farthest that a matched point may be from where the hand took hold [m]."""
    task: str | None = None
    """File or module that declares the task, where it is one of your own."""
    demonstration: Path | None = None
    """A demonstration of your own (JSON); the one that belongs to the task when not given."""
    json: bool = False
    """Write the result as JSON."""


def run(options: RelabelOptions) -> int:
    """Relabel, and say what was left out."""
    from dgl_collect import RunOptions
    from dgl_collect.episodes import find_episodes
    from dgl_collect.relabel import Relabeller, relabel_episodes

    paths = find_episodes(options.data)
    if not paths:
        raise ValueError(f"no episodes (*.h5) in {options.data}")
    check_writable(options.out)
    run_options = RunOptions(demonstration=options.demonstration)
    task = find_recorded_task(_read_task(paths), options.task)
    relabeller = Relabeller(task.id, run_options, weights=options.weights)
    with console.progress("relabelling", len(paths)) as bar:
        result = relabel_episodes(
            paths, options.out, relabeller, within=options.within, on_file=lambda _: bar.advance()
        )
    for path, fault in result.refused.items():
        console.error(f"{path}: {fault}")
    if options.json:
        console.out_json(_to_json(result))
    else:
        console.out(
            f"{len(result.written)} relabelled, {len(result.kept)} were there, "
            f"{len(result.left_out)} left out "
            f"with a point farther than {options.within:g} m from the hand's, "
            f"{len(result.refused)} damaged or foreign"
        )
    return EXIT_OK if result.written or result.kept else EXIT_FAILURE


def _read_task(paths: list[Path]) -> str:
    """Read the task of the first episode that can be read."""
    from dgl_collect import CorruptEpisodeError, read_episode

    fault = ""
    for path in paths:
        try:
            return read_episode(path).task
        except CorruptEpisodeError as err:
            fault = fault or str(err)
    raise ValueError(f"none of {len(paths)} episodes can be read: {fault}")


def _to_json(result: "Relabelling") -> dict[str, object]:
    return {
        "written": [path.name for path in result.written],
        "kept": [path.name for path in result.kept],
        "left_out": {
            path.name: distance if distance < float("inf") else None
            for path, distance in result.left_out.items()
        },
        "refused": {path.name: fault for path, fault in result.refused.items()},
    }
