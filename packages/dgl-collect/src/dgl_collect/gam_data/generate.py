"""A data set of many garments, made by workers; an interrupted run can be resumed."""

import json
import threading
from collections.abc import Generator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

from dgl_assets import choose_categories, garment_ids
from dgl_collect.files import check_continued, disk_faults_told, locked_folder
from dgl_collect.gam_data.garment import FILE, SPACING, Entry, Made, Split, find_path, get_versions
from dgl_collect.workers import Dispatcher, Job, JobOutcome, Work, Workers, end_unguarded_import
from dgl_files.whole import append_line, drop_unfinished_line, sync_folder, write_json

__all__ = ["FAILURES_FILE", "RUN_FILE", "DataConfig", "Entry", "generate_data", "list_garments"]

RUN_FILE, FAILURES_FILE = "run.json", "failures.jsonl"
_RUN_FORMAT = 1


@dataclass(frozen=True, kw_only=True)
class DataConfig:
    """Garments of a data set.

    Raises:
        ValueError: If a number is out of its range or a category does not exist.
    """

    categories: tuple[str, ...] = ()
    """Categories of the catalogue; all by default."""
    train: int = 200
    """Training garments of each category, at most 8,000: the first ids of the split."""
    test: int = 40
    """Test garments of each category, at most 2,000."""
    flat: int = 0
    """Further training garments of each category, flat state only; the ids that follow."""
    flat_test: int = 0
    """Further test garments of each category, flat state only."""
    seed: int = 0
    """Seed of all draws; not negative."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "categories", choose_categories(self.categories))
        for name, flat, most in (("train", "flat", 8000), ("test", "flat_test", 2000)):
            whole, more = getattr(self, name), getattr(self, flat)
            if not 0 <= whole <= most:
                raise ValueError(f"{name} must be in [0, {most}]; got {whole}")
            if not 0 <= more <= most - whole:
                raise ValueError(f"{flat} must be in [0, {most - whole}]; got {more}")
        if self.train + self.test + self.flat + self.flat_test < 1:
            raise ValueError("at least 1 garment must be made; got 0 of each kind")
        if self.seed < 0:
            raise ValueError(f"seed must not be negative; got {self.seed}")

    @property
    def identity(self) -> dict[str, object]:
        """Values that must be equal for a run to be continued."""
        return {
            "run_format": _RUN_FORMAT,
            "categories": list(self.categories),
            "train": self.train,
            "test": self.test,
            "flat": self.flat,
            "flat_test": self.flat_test,
            "seed": self.seed,
            "spacing": SPACING,
            "versions": get_versions(),
        }


def list_garments(config: DataConfig) -> tuple[Entry, ...]:
    """List the garments of a data set, with categories by turns."""
    counts: dict[Split, tuple[int, int]] = {
        "train": (config.train, config.flat),
        "test": (config.test, config.flat_test),
    }
    columns = []
    for category in config.categories:
        kinds: list[list[Entry]] = []
        for split, (whole, flat) in counts.items():
            ids = garment_ids(category, split, count=whole + flat)
            for part, is_flat in ((ids[:whole], False), (ids[whole:], True)):
                kinds.append([Entry(id=name, split=split, is_flat=is_flat) for name in part])
        # All kinds by turns too, in proportion.
        placed = [((k + 0.5) / len(own), entry) for own in kinds for k, entry in enumerate(own)]
        columns.append([entry for _, entry in sorted(placed, key=lambda pair: pair[0])])
    return tuple(entry for row in zip(*columns, strict=True) for entry in row)


def generate_data(
    config: DataConfig,
    folder: Path,
    *,
    workers: Workers | None = None,
    resume: bool = False,
    stop: threading.Event | None = None,
) -> Generator[Made, None, None]:
    """Make the missing garments of a data set.

    Each is on disk before it is yielded: its file, or a line with the reason among the failures.
    The files do not depend on the number of workers.

    Args:
        config: The garments.
        folder: Folder of the data set; missing or empty, unless `resume`.
        workers: Number and engine; one worker of this machine when None.
        resume: Continue the data set in the folder.
        stop: Ends the run when it is set; see `dgl_collect.workers.stop_signals`.

    Yields:
        Garments as they are finished; first those of an earlier run, in 0 s. Closing the generator
        ends the workers.

    Raises:
        ValueError: If the folder is not empty, busy, or was made with other options.
        WorkerError: If workers keep dying; what had finished is kept.
        MachineError: If a disk is full, or fails; what had finished is kept.
    """
    end_unguarded_import()
    with locked_folder(folder):
        failures = _open_run(config, folder, resume=resume)
        left: list[Entry] = []
        for entry in list_garments(config):
            path = find_path(folder, entry.id)
            if entry.id in failures:
                yield Made(id=entry.id, error=failures[entry.id])
            elif path.is_file():
                yield Made(id=entry.id, bytes=path.stat().st_size)
            else:
                left.append(entry)
        dispatcher = Dispatcher(
            (Job(name=entry.id.replace("/", "-"), request=entry) for entry in left),
            work=Work(
                factory="dgl_collect.gam_data.garment:GarmentMaker", arguments={"seed": config.seed}
            ),
            workers=workers or Workers(),
            folder=folder,
            stop=stop or threading.Event(),
        )
        with closing(dispatcher.run()) as outcomes:
            for outcome in outcomes:
                with disk_faults_told():
                    made = _take(outcome, folder)
                yield made


def _take(outcome: JobOutcome, folder: Path) -> Made:
    """Commit the file of a garment, or record the reason for its failure."""
    made = outcome.result
    if not isinstance(made, Made):
        assert isinstance(outcome.job.request, Entry)
        assert outcome.failure is not None
        error = f"{outcome.failure.reason}: {outcome.failure.detail}"
        made = Made(id=outcome.job.request.id, error=error, seconds=outcome.seconds)
    if made.error:
        append_line(folder / FAILURES_FILE, json.dumps({"id": made.id, "reason": made.error}))
    else:
        path = find_path(folder, made.id)
        path.parent.mkdir(exist_ok=True)
        (outcome.folder / FILE).replace(path)
        sync_folder(path.parent)
    return made


def _open_run(config: DataConfig, folder: Path, *, resume: bool) -> dict[str, str]:
    """Check the folder, write the options, and return earlier failures by id."""
    path = folder / RUN_FILE
    if any(folder.iterdir()):
        if not resume:
            raise ValueError(
                f"{folder} is not empty; add --resume to continue the run in it, or choose "
                "another --out"
            )
        if not path.is_file():
            raise ValueError(f"{folder} holds no run ({RUN_FILE} is missing)")
        try:
            found = dict(json.loads(path.read_text(encoding="utf-8")))
        except (ValueError, TypeError) as err:
            raise ValueError(f"{path} cannot be read: {err}") from err
        check_continued(folder, found, config.identity)
    else:
        write_json(path, config.identity)
    drop_unfinished_line(folder / FAILURES_FILE)
    return _read_failures(folder / FAILURES_FILE)


def _read_failures(path: Path) -> dict[str, str]:
    if not path.exists():
        return {}
    found = {}
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1):
        try:
            entry = json.loads(line)
            found[str(entry["id"])] = str(entry["reason"])
        except (ValueError, KeyError, TypeError) as err:
            raise ValueError(f"{path}, line {number}: it is no failure: {err!r}") from err
    return found
