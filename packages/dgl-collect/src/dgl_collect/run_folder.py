"""Folder of one run: its files, and the lock against other runs."""

from __future__ import annotations

import dataclasses
import logging
from collections.abc import Iterable, Mapping
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Literal

from dgl_collect.errors import MachineError, OutputFolderError
from dgl_collect.files import check_continued, disk_faults_told, locked_folder
from dgl_collect.results import (
    ATTEMPTS_FILE,
    AttemptResult,
    Summary,
    drop_lost_attempts,
    package_versions,
    summarize,
    write_summary,
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

RUN_FORMAT = 1
RUN_FILE, SUMMARY_FILE = "run.json", "summary.json"
KEPT_OF_FAILURES = ("video", "picture")
"""Files of failed attempts that are kept for people; an episode would mislead training."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class RunRecord:
    """Content of `run.json`."""

    __pydantic_config__ = STRICT

    run_format: int
    """Version of the folder's format."""
    task: str
    """Environment id."""
    seed: int
    """Of the run."""
    attempt_factory: str
    """`CollectConfig.attempt_factory`."""
    options: Mapping[str, object]
    """Its options."""
    versions: Mapping[str, str]
    """Package versions at the last start."""
    commands: tuple[str, ...]
    """Command lines of the run, in order."""
    machines: tuple[Machine, ...] = ()
    """Machines of the workers; none in older folders."""

    def __post_init__(self) -> None:
        if self.run_format != RUN_FORMAT:
            raise ValueError(f"run_format must be {RUN_FORMAT}; got {self.run_format}")
        if self.seed < 0:
            raise ValueError(f"seed must be at least 0; got {self.seed}")


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


class RunFolder:
    """An open run folder; used as a context manager, it is locked against other runs.

    Args:
        path: The folder; made when missing.
        identity: Values that must be equal for a run to be continued; JSON-ready.
        resume: Continue the run in the folder. Without it the folder must be empty.
        command: Command line to record.

    Raises:
        OutputFolderError: If the folder is not writable, not empty, busy, or of another run.
    """

    def __init__(
        self, path: Path, *, identity: Mapping[str, object], resume: bool, command: str
    ) -> None:
        self.path = path
        self.results: list[AttemptResult] = []
        self.versions = package_versions()
        self._identity = identity
        self._resume = resume
        self._command = command
        self._content: dict[str, object] = {}  # of run.json
        self._machines: list[dict[str, object]] = []
        self._held = ExitStack()

    def __enter__(self) -> RunFolder:
        with ExitStack() as stack:
            stack.enter_context(locked_folder(self.path))
            with disk_faults_told():
                self._open_run()
            self._held = stack.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._held.close()

    @property
    def attempts_path(self) -> Path:
        """The file with one line per attempt."""
        return self.path / ATTEMPTS_FILE

    def add_machines(self, machines: Iterable[Machine]) -> None:
        """Record the machines of workers in `run.json`; processors may round differently."""
        new = [dataclasses.asdict(machine) for machine in machines]
        new = [machine for machine in new if machine not in self._machines]
        if new:
            self._machines += sorted(new, key=lambda machine: str(machine["host"]))
            with disk_faults_told():
                write_json(
                    self.path / RUN_FILE, {**self._content, "machines": list(self._machines)}
                )

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
        with disk_faults_told():
            result = self._commit(result, staging)
        self.results.append(result)
        return result

    def _commit(self, result: AttemptResult, staging: Path) -> AttemptResult:
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
        result = dataclasses.replace(result, files=files, checksums=checksums)
        append_line(self.attempts_path, result.to_line())
        return result

    def write_summary(
        self, *, requested: int, status: Literal["complete", "interrupted", "failed"]
    ) -> Summary:
        """Count the results so far and write `summary.json`."""
        summary = summarize(
            sorted(self.results, key=lambda result: result.index),
            task=str(self._identity["task"]),
            seed=int(str(self._identity["seed"])),
            requested=requested,
            status=status,
            versions=self.versions,
        )
        with disk_faults_told():
            write_summary(self.path / SUMMARY_FILE, summary)
        return summary

    def try_to_write_summary(
        self, *, requested: int, status: Literal["complete", "interrupted", "failed"]
    ) -> None:
        """Write `summary.json` after an error; a full disk does not hide the error."""
        with suppress(OSError, MachineError):
            self.write_summary(requested=requested, status=status)

    def _open_run(self) -> None:
        run_path = self.path / RUN_FILE
        is_empty = not any(self.path.iterdir())
        if not is_empty and not self._resume:
            raise OutputFolderError(
                f"{self.path} is not empty; add --resume to continue the run in it, "
                "or choose another --out"
            )
        if not is_empty and not run_path.exists():
            raise OutputFolderError(
                f"{self.path} holds no run to resume ({RUN_FILE} is missing); choose another --out"
            )
        if is_empty and self._resume:
            logger.warning("%s has no run yet: this one begins there", self.path)
        commands: list[object] = []
        if run_path.exists():
            commands = self._check_run()
            drop_unfinished_line(self.attempts_path)
            self.results = drop_lost_attempts(self.path)
        content = {"run_format": RUN_FORMAT, **self._identity, "versions": self.versions}
        self._content = {**content, "commands": [*commands, self._command]}
        write_json(run_path, {**self._content, "machines": self._machines})

    def _check_run(self) -> list[object]:
        """Compare with the run in the folder; return its commands."""
        found = read_run(self.path)
        check_continued(self.path, dataclasses.asdict(found), self._identity)
        self._machines = [dataclasses.asdict(machine) for machine in found.machines]
        if found.versions != self.versions:
            logger.warning("%s was begun with other package versions", self.path)
        return list(found.commands)
