"""A data set: many garments, by one or more processes, which can be interrupted and continued."""

import json
from collections.abc import Generator
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Literal

from dgl_assets import choose_categories, garment_ids
from dgl_collect.files import append_line, drop_unfinished_line, write_json
from dgl_collect.gam_data.garment import (
    SPACING,
    Made,
    find_path,
    get_versions,
    make_garment_data,
)
from dgl_collect.processes import check_continued, locked_folder, run_each

__all__ = ["FAILURES_FILE", "RUN_FILE", "DataConfig", "Entry", "generate_data", "list_garments"]

RUN_FILE, FAILURES_FILE = "run.json", "failures.jsonl"
_RUN_FORMAT = 1
Split = Literal["train", "test"]


@dataclass(frozen=True, kw_only=True)
class DataConfig:
    """Which garments a data set has.

    Raises:
        ValueError: If a number is out of its range or a category does not exist.
    """

    categories: tuple[str, ...] = ()
    """Of the catalogue; all when none is named."""
    train: int = 200
    """Garments of each category to train on; the first ids of the catalogue's split, at most 8,000."""
    test: int = 40
    """Garments of each category to measure on, at most 2,000."""
    flat: int = 0
    """More garments of each category to train on, of which only the flat state is made; the ids that follow."""
    flat_test: int = 0
    """More garments of each category to measure on, likewise."""
    seed: int = 0
    """Of everything that is drawn; not negative."""

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
        """What must be equal for a run to be continued."""
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


@dataclass(frozen=True, kw_only=True)
class Entry:
    """A garment of a data set."""

    id: str
    """Of the catalogue."""
    split: Split
    """That it belongs to."""
    is_flat: bool
    """Whether only its flat state is made."""


def list_garments(config: DataConfig) -> tuple[Entry, ...]:
    """List the garments of a data set, categories by turns, so that an unfinished run has some of each."""
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
    config: DataConfig, folder: Path, *, workers: int = 1, resume: bool = False
) -> Generator[Made, None, None]:
    """Make the garments of a data set that are not there yet.

    Each is on disk before it is yielded: its file, or a line with the reason among the failures. What comes out does
    not depend on the number of workers.

    Args:
        config: Which garments.
        folder: Of the data set; missing or empty, unless `resume`.
        workers: Processes.
        resume: Continue the data set in the folder.

    Yields:
        Garments as they are finished; first those that an earlier run has left, in 0 s. Closing the generator ends the
        workers, each after the garment that it has in hand.

    Raises:
        ValueError: If `workers` is not positive, or the folder is not empty, busy, or was made with other options.
        WorkerError: If a process died; what had finished is kept.
    """
    if workers < 1:
        raise ValueError(f"workers must be at least 1; got {workers}")
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
        calls = (
            partial(
                make_garment_data,
                entry.id,
                entry.split,
                seed=config.seed,
                folder=folder,
                is_flat=entry.is_flat,
            )
            for entry in left
        )
        with closing(run_each(calls, workers)) as results:
            for made in results:
                if made.error:
                    failure = {"id": made.id, "reason": made.error}
                    append_line(folder / FAILURES_FILE, json.dumps(failure))
                yield made


def _open_run(config: DataConfig, folder: Path, *, resume: bool) -> dict[str, str]:
    """Check the folder, remember the options, and give the failures that are there, by id."""
    path = folder / RUN_FILE
    if any(folder.iterdir()):
        if not resume:
            raise ValueError(
                f"{folder} is not empty; add --resume to continue the run in it, or choose another --out"
            )
        if not path.is_file():
            raise ValueError(f"{folder} holds no run ({RUN_FILE} is missing)")
        try:
            found = dict(json.loads(path.read_text(encoding="utf-8")))
        except (ValueError, TypeError) as err:
            raise ValueError(f"{path} cannot be read: {err}") from err
        check_continued(folder, found, config.identity)
        for unfinished in folder.glob("*/.*.part"):
            unfinished.unlink()  # of a run that was killed; the lock says that no other is at work
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
