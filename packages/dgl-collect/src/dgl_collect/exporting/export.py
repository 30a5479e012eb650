"""Export of a folder of episodes: frames made by workers, then written by the format's writer."""

import dataclasses
import json
import shutil
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py

from dgl_collect.episodes import opened_episode, read_episode
from dgl_collect.errors import CollectionError, OutputFolderError
from dgl_collect.exporting.frames import make_frames
from dgl_collect.exporting.origins import Origin, Origins, write_origins
from dgl_collect.exporting.trajectory import Trajectory, read_trajectory, write_trajectory
from dgl_collect.files import check_continued, locked_folder
from dgl_collect.options import ExportOptions, RunOptions
from dgl_collect.runner import locate_task
from dgl_collect.setup import Setup, make_setup
from dgl_collect.workers import Dispatcher, Job, Work, Workers, end_unguarded_import
from dgl_files.fields import check_value
from dgl_files.whole import write_json
from dgl_physics import PhysicsError
from dgl_tasks import TaskError

__all__ = [
    "Exported",
    "FrameMaker",
    "Writer",
    "export_episodes",
    "make_frame_maker",
    "read_source",
]

Writer = Callable[[Path, Iterator[Trajectory], Origins], None]
"""Writes a data set to a folder or file that does not exist."""
_ORDER = "order.json"


@dataclass(frozen=True, kw_only=True)
class Exported:
    """Outcome of an export."""

    episodes: int
    """Episodes in the data set; with stages, the sum of their numbers."""
    frames: int
    """Frames in the data set."""
    left_out: Mapping[str, str]
    """Reason by name of each episode that is not in it."""


@dataclass(frozen=True, kw_only=True)
class _Done:
    """Result of a job."""

    files: tuple[str, ...]
    fault: str = ""


def make_frame_maker(task: str, options: ExportOptions, run: RunOptions) -> "FrameMaker":
    """Build the frame maker of a worker."""
    return FrameMaker(make_setup(task, run), options)


class FrameMaker:
    """Makes the frames of episodes in one environment; implements `workers.JobRunner`."""

    def __init__(self, setup: Setup, options: ExportOptions) -> None:
        """Take over the environment of the episodes' task, robot, look and cloud."""
        self._setup, self._options = setup, options

    def close(self) -> None:
        """Release the environment."""
        self._setup.env.close()

    def run(self, request: str, out_dir: Path) -> _Done:
        """Write the frames of an episode file; a fault of the episode is a result."""
        path, files = Path(request), []
        try:
            for number, (_, frames) in enumerate(
                make_frames(read_episode(path), self._options, self._setup)
            ):
                files.append(f"{path.stem}.{number}.h5")
                write_trajectory(out_dir / files[-1], frames)
        except (CollectionError, TaskError, PhysicsError) as err:
            return _Done(files=(), fault=str(err))
        return _Done(files=tuple(files))


def export_episodes(
    episodes: Sequence[Path],
    out: Path,
    writer: Writer,
    options: ExportOptions,
    *,
    format_name: str,
    workers: Workers | None = None,
    resume: bool = False,
    task: str | None = None,
    stop: threading.Event | None = None,
    on_episode: Callable[[], None] | None = None,
) -> Exported | None:
    """Export episodes of one task to a data set, which appears whole.

    Frames are made in the folder `OUT.part`, which is removed at the end: an interrupted export
    continues there.

    Args:
        episodes: Episode files, at least one; the data set has them in this order.
        out: Folder of the data set; it must not exist.
        writer: Writes the data set.
        options: Content of the frames.
        format_name: Name of the format, which a resumed export must share.
        workers: Number and engine of the workers; one of this machine when None.
        resume: Continue the export in `OUT.part`.
        task: File or module that declares the task, where it is one of your own.
        stop: Ends the export when it is set; see `dgl_collect.workers.stop_signals`.
        on_episode: Called for each episode whose frames are made, those of an earlier run included.

    Returns:
        The outcome; None if it was stopped before the end.

    Raises:
        ValueError: If there is no episode, they differ in task, robot, look or cloud, or none can
            be exported.
        OutputFolderError: If `out` exists, or `OUT.part` is of another export.
        CorruptEpisodeError: If an episode is damaged.
    """
    end_unguarded_import()
    source = read_source(episodes, options)
    part = out.with_name(f"{out.name}.part")
    if out.exists():
        raise OutputFolderError(f"{out} is there already; choose another --out")
    with locked_folder(part):
        identity = {
            "format": format_name,
            "options": json.loads(json.dumps(dataclasses.asdict(options), default=str)),
            "episodes": [str(path.absolute()) for path in episodes],
        }
        done = _open(part, identity, resume=resume)
        if on_episode is not None:
            for _ in done:
                on_episode()
        run = RunOptions(
            robot=source.robot,
            robots=options.robots,
            look=source.look,
            cloud=source.cloud,
            control_mode=options.control_mode,
            matcher=options.matcher,
        )
        work = Work(
            factory="dgl_collect.exporting.export:make_frame_maker",
            arguments={"task": locate_task(task or source.task), "options": options, "run": run},
        )
        dispatcher = Dispatcher(
            [Job(name=p.stem, request=str(p.absolute())) for p in episodes if p.stem not in done],
            work=work,
            workers=workers or Workers(),
            folder=part,
            stop=stop or threading.Event(),
        )
        with closing(dispatcher.run()) as outcomes:
            for outcome in outcomes:
                result = outcome.result
                if not isinstance(result, _Done):
                    assert outcome.failure is not None
                    fault = f"{outcome.failure.reason}: {outcome.failure.detail}"
                    result = _Done(files=(), fault=fault)
                for name in result.files:
                    (outcome.folder / name).replace(part / name)
                done[outcome.job.name] = result
                _write_order(part, done)
                if on_episode is not None:
                    on_episode()
        if stop is not None and stop.is_set():
            return None
        outcome = _write(part, out, writer, [done[path.stem] for path in episodes], source)
    shutil.rmtree(part)
    faults = {path.stem: done[path.stem].fault for path in episodes if done[path.stem].fault}
    return dataclasses.replace(outcome, left_out=faults)


def _write(
    part: Path, out: Path, writer: Writer, done: Sequence[_Done], source: Origins
) -> Exported:
    """Write the data set from the frames, and put it in its place."""
    files = [part / name for each in done for name in each.files]
    if not files:
        shutil.rmtree(part)
        raise ValueError(f"none of {len(done)} episodes can be exported: {done[0].fault}")
    target = part / "dataset"
    if target.is_dir():
        shutil.rmtree(target)  # of a run that was killed while it wrote
    target.unlink(missing_ok=True)
    frames, origins = 0, []

    def read() -> Iterator[Trajectory]:
        nonlocal frames
        for path in files:
            each = read_trajectory(path)
            frames += len(each)
            origins.append(Origin(seed=each.seed, garment=each.garment, success=each.success))
            yield each

    writer(target, read(), source)
    if target.is_dir():
        write_origins(target, dataclasses.replace(source, episodes=tuple(origins)))
    target.replace(out)
    return Exported(episodes=len(files), frames=frames, left_out={})


def read_source(episodes: Sequence[Path], options: ExportOptions) -> Origins:
    """Read task, robot, look and cloud of episodes.

    Raises:
        ValueError: If there is no episode, two have the same name, or they differ.
        CorruptEpisodeError: If one is damaged.
    """
    if not episodes:
        raise ValueError("at least one episode must be exported; got none")
    if len({path.stem for path in episodes}) < len(episodes):
        raise ValueError("episodes must have different names; some have the same")
    found: dict[Origins, Path] = {}
    for path in episodes:
        with opened_episode(path) as file:
            found.setdefault(_read_source(file, options), path)
    if len(found) > 1:
        (one, first), (other, second) = list(found.items())[:2]
        names = [f.name for f in dataclasses.fields(Origins)]
        name = next(n for n in names if getattr(one, n) != getattr(other, n))
        raise ValueError(
            f"episodes must be of one {name}; got {getattr(one, name)} ({first.name}) and "
            f"{getattr(other, name)} ({second.name})"
        )
    return next(iter(found))


def _read_source(file: h5py.File, options: ExportOptions) -> Origins:
    draws: Any = json.loads(str(file.attrs["randomisation"]))
    return Origins(
        task=str(file.attrs["task"]),
        robot=str(file.attrs.get("robot", "ur10e+shadow")),
        cloud=str(file.attrs.get("cloud", "segmented")),  # pyright: ignore[reportArgumentType]
        look="random" if "floor" in draws else "studio",
        control_mode=options.control_mode,
        content=options.content,
        matcher=options.matcher,
    )


def _open(part: Path, identity: Mapping[str, object], *, resume: bool) -> dict[str, _Done]:
    """Check the folder of an unfinished export; return the results in it by episode."""
    record = part / "export.json"
    if record.is_file():
        if not resume:
            raise OutputFolderError(
                f"{part} holds an unfinished export; add --resume to continue it, or remove it"
            )
        check_continued(part, json.loads(record.read_text(encoding="utf-8")), identity)
    write_json(record, identity)
    order = part / _ORDER
    if not order.is_file():
        return {}
    found = json.loads(order.read_text(encoding="utf-8"))
    check_value("order", found, dict[str, dict[str, Any]])
    return {
        name: _Done(files=tuple(each["files"]), fault=each["fault"])
        for name, each in found.items()
        if all((part / file).is_file() for file in each["files"])
    }


def _write_order(part: Path, done: Mapping[str, _Done]) -> None:
    write_json(part / _ORDER, {name: dataclasses.asdict(each) for name, each in done.items()})
