"""Verb `dgl export`."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import tyro  # noqa: TID253 - marks the positional argument; the command line imports it anyway

from dexgarmentlab.cli import EXIT_FAILURE, EXIT_INTERRUPTED, EXIT_OK, console
from dexgarmentlab.cli.flags import (
    Flags,
    WorkerFlags,
    check_writable,
    find_recorded_task,
    tell_command,
    told_how_to_continue,
)
from dgl_collect.options import ExportOptions as FrameOptions

__all__ = ["ExportOptions", "run"]


@dataclass(frozen=True, kw_only=True)
class ExportOptions:
    """Write recorded episodes as a data set for other projects, at 12 frames a second.

    Formats: `lerobot`, a LeRobotDataset v3; `zarr`, the replay buffer of Diffusion Policy and DP3;
    `robomimic`, its HDF5 file. Whole episodes are replayed, which adds approaches, retreats and any
    camera. Ctrl-C keeps every finished replay, and --resume continues.

    Example: dgl export lerobot out/fold/episodes --control-mode pd_hand_poses --out out/lerobot
    """

    format: Annotated[
        Literal["lerobot", "zarr", "robomimic"],
        tyro.conf.Positional,
        tyro.conf.arg(metavar="FORMAT"),
    ]
    """lerobot, zarr or robomimic."""
    episodes: Annotated[
        tuple[Path, ...], tyro.conf.Positional, tyro.conf.arg(metavar="EPISODES [EPISODES ...]")
    ]
    """Episode files (*.h5) of one task, or folders of them."""
    out: Path
    """The data set: a folder, for robomimic a file. It must not exist."""
    frames: Flags[FrameOptions] = field(default_factory=FrameOptions)
    task: str | None = None
    """File or module that declares the task, where it is one of your own."""
    resume: bool = False
    """Continue an interrupted export."""
    workers: Flags[WorkerFlags] = field(default_factory=WorkerFlags)
    json: bool = False
    """Write the result as JSON."""


def run(options: ExportOptions) -> int:
    """Export, and tell which episodes were left out."""
    from dgl_collect.exporting.export import export_episodes, read_source
    from dgl_collect.exporting.writers import get_writer
    from dgl_collect.workers import stop_signals

    writer = get_writer(options.format)
    files = list_episodes(options.episodes)
    check_writable(options.out.parent)
    source = read_source(files, options.frames)
    find_recorded_task(source.task, options.task)
    command = tell_command("export", options)
    with (
        console.progress("replaying", len(files)) as bar,
        stop_signals() as stop,
        told_how_to_continue(command),
    ):
        exported = export_episodes(
            files,
            options.out,
            writer,
            options.frames,
            format_name=options.format,
            workers=options.workers.make(),
            resume=options.resume,
            task=options.task,
            stop=stop,
            on_episode=bar.advance,
        )
    if exported is None:
        console.error(f"interrupted; continue with: {command} --resume")
        return EXIT_INTERRUPTED
    for name, reason in exported.left_out.items():
        console.error(f"{name} was left out: {reason}")
    if options.json:
        content = {
            "episodes": exported.episodes,
            "frames": exported.frames,
            "left_out": dict(exported.left_out),
            "out": str(options.out),
        }
        console.out_json(content)
    else:
        console.out(f"{options.out}: {exported.episodes} episodes, {exported.frames} frames")
    return EXIT_FAILURE if exported.left_out else EXIT_OK


def list_episodes(paths: Iterable[Path]) -> list[Path]:
    """List the episode files among paths, and in the folders among them.

    Raises:
        ValueError: If a path is missing, or a folder holds no episode.
    """
    from dgl_collect.episodes import find_episodes

    found: list[Path] = []
    for path in paths:
        if path.is_dir():
            inside = find_episodes(path)
            if not inside:
                raise ValueError(f"no episodes (*.h5) in {path}")
            found += inside
        elif path.is_file():
            found.append(path)
        else:
            raise ValueError(f"there is no episode file or folder {path}")
    return found
