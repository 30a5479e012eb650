"""`dgl train primitive`: learn the ways of the hands from a few episodes."""

from dataclasses import dataclass
from pathlib import Path

from dexgarmentlab.cli import EXIT_OK, console
from dexgarmentlab.cli.flags import check_writable, find_recorded_task

__all__ = ["TrainPrimitiveOptions", "train_primitive"]

MOST_EPISODES = 1000


@dataclass(frozen=True, kw_only=True)
class TrainPrimitiveOptions:
    """Learn task-parameterised movement primitives, one for each stage, in seconds.

    The ways of the hands become affine functions of the points on the garment, the extents of its
    cloud, and the frames of objects. Three episodes suffice, ten are better; any robot's will do.

    Example: dgl train primitive --data out/fold_tops/episodes --out runs/fold_tops
    """

    data: Path
    """Folder of episodes (*.h5) of one task, or of the run that collected them."""
    out: Path
    """Folder for primitives.safetensors; see `dgl eval --policy primitive --checkpoints`."""
    episodes: int | None = None
    """Use the first ones alone, by name."""
    task: str | None = None
    """The task, if it is one of your own: a file or module. Default: the id in the episodes."""
    demonstration: Path | None = None
    """The demonstration whose stages they are, if it is your own."""
    robots: Path | None = None
    """Folder of imported robots, if the episodes are of one."""
    json: bool = False
    """Write the result as JSON."""


def train_primitive(options: TrainPrimitiveOptions) -> int:
    """Learn the primitives, and tell the errors of episodes that were left out."""
    from dexgarmentlab.primitives import learn_primitives
    from dgl_collect.demonstration import load_demonstration
    from dgl_collect.episodes import find_episodes, opened_episode
    from dgl_sadp.primitive_file import PRIMITIVES_FILE, save_primitives

    if not options.data.is_dir():
        raise ValueError(f"--data must be a folder of episodes; {options.data} is none")
    path = options.out / PRIMITIVES_FILE
    if path.exists() or (options.out.exists() and not options.out.is_dir()):
        what = "has primitives already" if path.exists() else "is a file"
        raise ValueError(f"--out must be a new folder; {options.out} {what}")
    check_writable(options.out)
    paths = find_episodes(options.data)
    if not paths:
        raise ValueError(f"--data must hold episodes (*.h5); {options.data} has none")
    if options.episodes is not None and not 1 <= options.episodes <= len(paths):
        raise ValueError(
            f"--episodes must be from 1 to {len(paths)}, the number of episodes in {options.data}; "
            f"got {options.episodes}"
        )
    paths = paths[: options.episodes or MOST_EPISODES]
    with opened_episode(paths[0]) as file:
        task_id = str(file.attrs["task"])
    task = find_recorded_task(task_id, options.task)
    demonstration = load_demonstration(task, options.demonstration)
    primitives = learn_primitives(task, demonstration, paths, robots=options.robots)
    save_primitives(path, primitives)
    errors = primitives.card["error_cm"]
    if options.json:
        console.out_json({"file": str(path), "episodes": len(paths), "error_cm": errors})
        return EXIT_OK
    console.out(f"primitives of {task.id} from {len(paths)} episodes: {path}")
    for stage, error in errors.items():
        console.out(f"  {stage}: the way ends within {error} cm, for an episode left out")
    return EXIT_OK
