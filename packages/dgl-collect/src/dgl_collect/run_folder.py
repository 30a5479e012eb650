"""Folder of one run: its files, and the lock against other runs."""

import logging
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from annotated_types import Ge

from dgl_collect.errors import OutputFolderError
from dgl_collect.files import check_continued, disk_faults_told, locked_folder
from dgl_collect.results import (
    ATTEMPTS_FILE,
    AttemptResult,
    RunStatus,
    Summary,
    drop_lost_attempts,
    summarize,
)
from dgl_collect.workers import Machine
from dgl_files.fields import STRICT, read_json_file
from dgl_files.whole import (
    append_line,
    compute_checksum,
    drop_unfinished_line,
    sync_folder,
    write_json,
)

logger = logging.getLogger(__name__)

RUN_FILE, SUMMARY_FILE = "run.json", "summary.json"
KEPT_OF_FAILURES = ("video", "picture")
"""Files of failed attempts that are kept for people; an episode would mislead training."""


@dataclass(frozen=True, kw_only=True)
class RunRecord:
    """Content of `run.json`."""

    __pydantic_config__: ClassVar = STRICT

    run_format: Literal[1]
    """Version of the folder's format."""
    task: str
    """Environment id."""
    seed: Annotated[int, Ge(0)]
    """Of the run."""
    attempt_factory: str
    """`CollectConfig.attempt_factory`."""
    options: Mapping[str, object]
    """Its options."""
    versions: Mapping[str, str]
    """Package versions at the last start."""
    commands: tuple[str, ...]
    """Command lines of the run, in order."""
    declaration: str = ""
    """SHA-256 of the file of a task of one's own, in hexadecimal digits; empty for others."""
    demonstration: str = ""
    """SHA-256 of a demonstration of one's own, likewise."""
    machines: tuple[Machine, ...] = ()
    """Machines of the workers; their processors may round differently."""


def read_run(folder: Path) -> RunRecord:
    """Read the record of a run.

    Raises:
        OutputFolderError: If it holds none, or `run.json` is damaged.
    """
    path = folder / RUN_FILE
    if not path.is_file():
        raise OutputFolderError(f"{folder} holds no run ({RUN_FILE} is missing)")
    try:
        return read_json_file(RunRecord, path)
    except ValueError as err:
        raise OutputFolderError(str(err)) from err


@dataclass
class RunFolder:
    """An open run folder; see `opened_run`."""

    path: Path
    record: RunRecord
    results: list[AttemptResult]
    """Results of the attempts made so far."""

    @disk_faults_told()
    def add_machines(self, machines: Iterable[Machine]) -> None:
        """Record the machines of workers in `run.json`."""
        new = set(machines) - set(self.record.machines)
        if new:
            added = sorted(new, key=lambda machine: machine.host)
            self.record = replace(self.record, machines=(*self.record.machines, *added))
            write_json(self.path / RUN_FILE, asdict(self.record))

    @disk_faults_told()
    def commit(self, result: AttemptResult, staging: Path) -> AttemptResult:
        """Move an attempt's files into the folder, then write its line.

        Args:
            result: The outcome, with files relative to `staging`.
            staging: Where the attempt has written.

        Returns:
            The outcome, with files relative to the run's folder.

        Raises:
            MachineError: If the disk is full; there is no line then.
        """
        target = "episodes" if result.success else "failed"
        files: dict[str, str] = {}
        checksums: dict[str, str] = {}
        for kind, name in result.files.items():
            if result.success or kind in KEPT_OF_FAILURES:
                destination = self.path / target / name
                destination.parent.mkdir(exist_ok=True)
                checksums[kind] = compute_checksum(staging / name)
                (staging / name).replace(destination)
                files[kind] = f"{target}/{name}"
        if files:
            sync_folder(self.path / target)
        result = replace(result, files=files, checksums=checksums)
        append_line(self.path / ATTEMPTS_FILE, result.to_line())
        self.results.append(result)
        return result

    @disk_faults_told()
    def write_summary(self, *, requested: int, status: RunStatus) -> Summary:
        """Count the results so far and write `summary.json`."""
        summary = summarize(
            sorted(self.results, key=lambda result: result.index),
            task=self.record.task,
            seed=self.record.seed,
            requested=requested,
            status=status,
            versions=self.record.versions,
        )
        write_json(self.path / SUMMARY_FILE, asdict(summary))
        return summary


@contextmanager
def opened_run(path: Path, record: RunRecord, *, resume: bool) -> Iterator[RunFolder]:
    """Open the folder of a run, and lock it against other runs.

    Args:
        path: The folder; made when missing.
        record: The run. One that is continued must have equal task, seed, factory and options.
        resume: Continue the run in the folder. Without it the folder must be empty.

    Raises:
        OutputFolderError: If the folder is not writable, not empty, busy, or of another run.
    """
    with locked_folder(path):
        with disk_faults_told():
            folder = _open_run(path, record, resume=resume)
        yield folder


def _open_run(path: Path, record: RunRecord, *, resume: bool) -> RunFolder:
    is_empty = not any(path.iterdir())
    if not is_empty and not resume:
        raise OutputFolderError(
            f"{path} is not empty; add --resume to continue the run in it, or choose another --out"
        )
    if not is_empty and not (path / RUN_FILE).exists():
        raise OutputFolderError(
            f"{path} holds no run to resume ({RUN_FILE} is missing); choose another --out"
        )
    results: list[AttemptResult] = []
    if is_empty and resume:
        logger.warning("%s has no run yet: this one begins there", path)
    elif not is_empty:
        found = read_run(path)
        identity = {
            name: getattr(record, name) for name in ("task", "seed", "attempt_factory", "options")
        }
        check_continued(path, asdict(found), identity)
        for name in ("declaration", "demonstration"):
            if getattr(found, name) != getattr(record, name):
                raise OutputFolderError(
                    f"{path} was begun with another {name}; undo its changes, or choose another "
                    "--out"
                )
        if found.versions != record.versions:
            logger.warning("%s was begun with other package versions", path)
        commands = (*found.commands, *record.commands)
        record = replace(record, commands=commands, machines=found.machines)
        drop_unfinished_line(path / ATTEMPTS_FILE)
        results = drop_lost_attempts(path)
    write_json(path / RUN_FILE, asdict(record))
    return RunFolder(path, record, results)
