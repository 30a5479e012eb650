"""A run: many garments, by one or more workers, which can be interrupted and continued."""

import json
import logging
import threading
from collections.abc import Generator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

from dgl_assets import choose_categories
from dgl_bench.assets.attempts import (
    POSITIONS_FILE,
    Attempt,
    DropRequest,
    find_positions,
    read_attempts,
)
from dgl_bench.assets.drop import FRAMES, HEIGHT
from dgl_bench.assets.selection import find_partners, select_ids
from dgl_collect.files import check_continued, disk_faults_told, locked_folder
from dgl_collect.results import package_versions
from dgl_collect.workers import Dispatcher, Job, JobOutcome, Work, Workers, end_unguarded_import
from dgl_files.whole import append_line, drop_unfinished_line, write_json

__all__ = ["ATTEMPTS_FILE", "COUNT", "RUN_FILE", "RunConfig", "drop_garments", "load_run"]

logger = logging.getLogger(__name__)

COUNT = 2500
"""As many garments as the paper speaks of."""
RUN_FILE, ATTEMPTS_FILE = "run.json", "attempts.jsonl"
_RUN_FORMAT = 1


@dataclass(frozen=True, kw_only=True)
class RunConfig:
    """Settings of a run of drops.

    Raises:
        ValueError: If a number is out of its range or a category does not exist.
    """

    count: int = COUNT
    """Garments in all; at least one of each category."""
    categories: tuple[str, ...] = ()
    """Of the catalogue; all when none is named."""
    frames: int = FRAMES
    """Simulated time [1/60 s]; at least 1."""
    height: float = HEIGHT
    """Of a garment's lowest point above the ground [m]; positive."""

    def __post_init__(self) -> None:
        if self.frames < 1:
            raise ValueError(f"frames must be at least 1; got {self.frames}")
        if not self.height > 0:
            raise ValueError(f"height must be positive; got {self.height}")
        object.__setattr__(self, "categories", choose_categories(self.categories))
        select_ids(self.count, self.categories)

    @property
    def identity(self) -> dict[str, object]:
        """Settings that must be equal for a run to be continued."""
        return {
            "run_format": _RUN_FORMAT,
            "count": self.count,
            "categories": list(self.categories),
            "frames": self.frames,
            "height": self.height,
        }


def drop_garments(
    config: RunConfig,
    folder: Path,
    *,
    workers: Workers | None = None,
    resume: bool = False,
    command: str = "",
    stop: threading.Event | None = None,
) -> Generator[Attempt, None, None]:
    """Drop the garments of a run that are not there yet.

    Each is on disk before it is yielded. What comes out does not depend on the number of workers.

    Args:
        config: Which garments, and how.
        folder: Of the run; missing or empty, unless `resume`.
        workers: How many, and where; one of this machine when None.
        resume: Continue the run in the folder.
        command: The command line, to be remembered.
        stop: Ends the run when it is set; see `dgl_collect.workers.stop_signals`.

    Yields:
        Garments as they are finished; first those that an earlier run has left. Closing the
        generator ends the workers.

    Raises:
        ValueError: If the folder is not empty, busy, or of another run.
        WorkerError: If workers keep dying; what had finished is kept.
        MachineError: If a disk is full, or fails; what had finished is kept.
    """
    end_unguarded_import()
    with locked_folder(folder):
        done = _open_run(config, folder, resume=resume, command=command)
        yield from done
        ids = select_ids(config.count, config.categories)
        partners = find_partners(ids)
        known = {attempt.id for attempt in done}
        dispatcher = Dispatcher(
            (
                Job(
                    name=garment_id.replace("/", "-"),
                    request=DropRequest(id=garment_id, partner=partners[garment_id]),
                )
                for garment_id in ids
                if garment_id not in known
            ),
            work=Work(
                factory="dgl_bench.assets.attempts:Drops",
                arguments={"frames": config.frames, "height": config.height},
            ),
            workers=workers or Workers(),
            folder=folder,
            stop=stop or threading.Event(),
        )
        with closing(dispatcher.run()) as outcomes:
            for outcome in outcomes:
                with disk_faults_told():
                    attempt = _take(outcome, folder)
                yield attempt


def _take(outcome: JobOutcome, folder: Path) -> Attempt:
    """Take over where a garment came to lie, and write its line."""
    attempt = outcome.result
    if not isinstance(attempt, Attempt):
        assert isinstance(outcome.job.request, DropRequest)
        assert outcome.failure is not None
        error = f"{outcome.failure.reason}: {outcome.failure.detail}"
        attempt = Attempt(id=outcome.job.request.id, error=error)
    positions = outcome.folder / POSITIONS_FILE
    if positions.is_file():
        path = find_positions(folder, attempt.id)
        path.parent.mkdir(parents=True, exist_ok=True)
        positions.replace(path)
    append_line(folder / ATTEMPTS_FILE, attempt.to_line())
    return attempt


def load_run(folder: Path) -> tuple[dict, list[Attempt]]:
    """Read a run, finished or not.

    Returns:
        The content of `run.json`, and the garments so far.

    Raises:
        ValueError: If there is none, or it cannot be read.
    """
    path = folder / RUN_FILE
    if not path.is_file():
        raise ValueError(f"{folder} holds no run ({RUN_FILE} is missing)")
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        content |= {"commands": list(content["commands"]), "versions": dict(content["versions"])}
    except (ValueError, KeyError, TypeError) as err:
        raise ValueError(f"{path} cannot be read: {err!r}") from err
    return content, read_attempts(folder / ATTEMPTS_FILE)


def _open_run(config: RunConfig, folder: Path, *, resume: bool, command: str) -> list[Attempt]:
    """Check the folder, remember the command, and give what is there."""
    is_empty = not any(folder.iterdir())
    if not is_empty and not resume:
        raise ValueError(
            f"{folder} is not empty; add --resume to continue the run in it, or choose another "
            "--out"
        )
    commands: list[str] = []
    versions = package_versions()
    done: list[Attempt] = []
    if not is_empty:
        found, _ = load_run(folder)
        check_continued(folder, found, config.identity)
        if found["versions"] != versions:
            logger.warning("%s was begun with other package versions", folder)
        commands = list(found["commands"])
        drop_unfinished_line(folder / ATTEMPTS_FILE)
        done = read_attempts(folder / ATTEMPTS_FILE)
    content = {**config.identity, "versions": versions, "commands": [*commands, command]}
    write_json(folder / RUN_FILE, content)
    return done
