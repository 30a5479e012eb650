"""Verb `dgl view`."""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro  # noqa: TID253 - marks the positional argument; the command line imports it anyway

from dexgarmentlab.cli import EXIT_OK, console
from dexgarmentlab.cli.flags import (
    Actions,
    Flags,
    find_recorded_task,
    find_task,
    join_options,
    run_action,
)
from dgl_collect.options import RunOptions

__all__ = ["EpisodeOptions", "GarmentOptions", "TaskOptions", "ViewOptions", "run"]


@dataclass(frozen=True, kw_only=True)
class ServerFlags:
    """Address of the viewer."""

    host: str = "127.0.0.1"
    """Address to listen at; 0.0.0.0 lets every machine look."""
    port: int = 8080
    """Port to listen at; the next free one if it is taken."""


@dataclass(frozen=True, kw_only=True)
class GarmentOptions:
    """Show a garment with its landmarks; a click on it is found on another one.

    Example: dgl view garment Trousers/000001 Trousers/000002
    """

    garment: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="ID")]
    """Id of the catalogue, such as Tops_LongSleeve/000123; `dgl assets list` has the categories."""
    other: Annotated[str | None, tyro.conf.Positional, tyro.conf.arg(metavar="[OTHER]")] = None
    """Garment of the same category to find points on. Default: the category's first."""
    matcher: Literal["exact", "gam"] = "exact"
    """Finds points: `exact`, or the Garment Affordance Model, which shows its similarity, too."""
    server: Flags[ServerFlags] = field(default_factory=ServerFlags)


@dataclass(frozen=True, kw_only=True)
class TaskOptions:
    """Show a task, reset by a seed, and let the expert or a primitive act.

    Example: dgl view task FoldTops-v1 --seed 3
    """

    task: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="TASK")]
    """The task: an id such as FoldTops-v1, or a file or module of your own that declares one."""
    seed: int = 0
    """Seed of the first reset."""
    run: Flags[RunOptions] = field(default_factory=RunOptions)
    server: Flags[ServerFlags] = field(default_factory=ServerFlags)


@dataclass(frozen=True, kw_only=True)
class EpisodeOptions:
    """Scrub through a recorded episode: it is replayed once, and kept in the cache.

    Example: dgl view episode out/fold/episodes/FoldTops-v1-s0-00000.h5
    """

    episode: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="EPISODE")]
    """Episode file."""
    task: str | None = None
    """File or module that declares the task, where it is one of your own."""
    robots: Path | None = None
    """Folder of imported robots, for episodes of a robot that is not built in."""
    server: Flags[ServerFlags] = field(default_factory=ServerFlags)


def _view(flags: ServerFlags, build: Callable[[Any], object]) -> int:
    """Start a server, build its page, and let it work until an interrupt."""
    from dexgarmentlab.viewer.server import make_server, wait

    if not 0 <= flags.port < 2**16:
        raise ValueError(f"--port must be from 0 to 65535; got {flags.port}")
    server = make_server(flags.host, flags.port)
    try:
        build(server)
        port = server.get_port()
        console.out(f"http://{flags.host}:{port}; Ctrl-C ends")
        console.info(f"from another machine: ssh -L {port}:localhost:{port} HERE")
        console.flush()
        wait()
    finally:
        server.stop()
    return EXIT_OK


def view_garment(options: GarmentOptions) -> int:
    """Show a garment."""
    from dexgarmentlab.viewer.garment_page import GarmentPage
    from dgl_assets import load_garment

    category = options.garment.partition("/")[0]
    other = options.other or f"{category}/000000"
    for garment_id in (options.garment, other):
        load_garment(garment_id)  # a wrong id is told before a server starts
    return _view(
        options.server,
        lambda server: GarmentPage(server, options.garment, other, matcher=options.matcher),
    )


def view_task(options: TaskOptions) -> int:
    """Show a task."""
    from dexgarmentlab.viewer.task_page import TaskPage
    from dgl_collect.setup import make_setup, prepare_options

    if options.seed < 0:
        raise ValueError(f"--seed must be at least 0; got {options.seed}")
    task = find_task(options.task)
    prepared, notes = prepare_options(options.run, task)
    for note in notes:
        console.info(note)
    setup = make_setup(task, prepared)
    return _view(
        options.server,
        lambda server: TaskPage(server, setup, colour=COLOUR, seed=options.seed),
    )


def view_episode(options: EpisodeOptions) -> int:
    """Show an episode."""
    from dexgarmentlab.doctor import get_cache_folder
    from dexgarmentlab.viewer.episode_page import EpisodePage
    from dexgarmentlab.viewer.scene import SceneView
    from dexgarmentlab.viewer.shots import find_shots, take_shots
    from dgl_collect import read_episode
    from dgl_collect.setup import make_env

    episode = read_episode(options.episode)
    task = find_recorded_task(episode.task, options.task)
    run = RunOptions(
        robot=episode.robot,
        robots=options.robots,
        look="random" if "floor" in episode.randomisation else "studio",
        cloud=episode.cloud,
    )
    env = make_env(task, run)
    steps = len(episode.commands) if episode.commands is not None else 0

    def take() -> Any:
        with console.progress("replaying", steps) as bar:
            return take_shots(episode, env, on_step=lambda _: bar.advance())

    shots = find_shots(options.episode, get_cache_folder() / "views", take)

    def build(server: Any) -> None:
        env.reset(seed=episode.seed, options={"garment": episode.garment_id})
        view = SceneView(server, env, colour=COLOUR)
        EpisodePage(server, view, episode, shots)

    return _view(options.server, build)


COLOUR = (196, 84, 60)
"""The garment's, where its fabric is not shown."""
_ACTIONS: Actions = {
    "garment": (GarmentOptions, view_garment),
    "task": (TaskOptions, view_task),
    "episode": (EpisodeOptions, view_episode),
}
ViewOptions = join_options(_ACTIONS)


def run(options: object) -> int:
    """Do what the action says."""
    return run_action(_ACTIONS, options)
