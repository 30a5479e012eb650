"""Is a run's folder whole? Every file is opened, and what says the same in two places is compared."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from pathlib import Path

import av
import imageio.v3 as iio

from dgl_collect.episodes import read_episode
from dgl_collect.errors import CollectionError, CorruptEpisodeError, OutputFolderError
from dgl_collect.results import AttemptResult, Summary, read_results, summarize
from dgl_collect.run_folder import ATTEMPTS_FILE, SUMMARY_FILE, RunRecord, read_run
from dgl_collect.runner import CollectConfig, make_attempt_seed, make_episode_id
from dgl_files.fields import read_json_file
from dgl_files.whole import compute_checksum

__all__ = ["find_missing", "verify_run"]

_FOLDERS = ("episodes", "failed")


def verify_run(folder: Path) -> Iterator[tuple[Path, str]]:
    """Check the folder of a collection, or of one seed of an evaluation; nothing is changed.

    Every file opens, holds what was written, and its shapes and numbers are right; lines and files agree; the seeds are
    those of the run; success follows from the recorded criteria; the summary says what the lines say, and no attempt of a
    complete run is missing.

    Args:
        folder: Of the run.

    Yields:
        Each file as it is checked, and what is wrong with it; nothing where it is whole.
    """
    try:
        run = read_run(folder)
    except CollectionError as err:
        yield folder / "run.json", str(err)
        return
    yield folder / "run.json", ""
    lines = folder / ATTEMPTS_FILE
    try:
        results = read_results(lines)
    except OutputFolderError as err:
        yield lines, str(err)
        return
    yield lines, _check_lines(lines)
    named: set[Path] = set()
    for result in results:
        yield lines, _check_result(run, result)
        for kind, name in result.files.items():
            path = folder / name
            named.add(path)
            yield path, _check_file(run, result, kind, path)
    for part in _FOLDERS:
        for path in sorted((folder / part).glob("*")):
            if path not in named:
                yield path, f"{path}: no attempt of {ATTEMPTS_FILE} names it"
    yield folder / SUMMARY_FILE, _check_summary(folder / SUMMARY_FILE, results)


def find_missing(folder: Path) -> list[int]:
    """Find the attempts that were asked for and are not made yet; none where the folder does not tell."""
    try:
        summary = read_json_file(Summary, folder / SUMMARY_FILE)
        return _list_missing(summary, read_results(folder / ATTEMPTS_FILE))
    except (ValueError, OSError, OutputFolderError):
        return []


def _list_missing(summary: Summary, results: list[AttemptResult]) -> list[int]:
    return sorted(set(range(summary.requested)) - {result.index for result in results})


def _check_lines(path: Path) -> str:
    if path.is_file() and not path.read_bytes().endswith(b"\n"):
        return f"{path}: its last line is not finished; --resume cuts it off"
    return ""


def _check_result(run: RunRecord, result: AttemptResult) -> str:
    """Compare a line with its run, and its success with its criteria."""
    where = f"{ATTEMPTS_FILE}, attempt {result.index}"
    seed = make_attempt_seed(run.seed, result.index)
    if result.seed != seed:
        return f"{where}: its seed must be {seed}, by the run's; got {result.seed}"
    unmet = [criterion.name for criterion in result.criteria if not criterion.is_met]
    if result.success and unmet:
        return f"{where}: it is called a success, and {unmet[0]!r} is not met"
    if result.criteria and not unmet and not result.success:
        return f"{where}: it is called a failure ({result.reason}), and all criteria are met"
    makes_episodes = run.attempt_factory == CollectConfig.attempt_factory
    if makes_episodes and result.success and not result.criteria:
        return f"{where}: it is called a success, and no criterion is recorded"
    if makes_episodes and result.success and "episode" not in result.files:
        return f"{where}: a success must have an episode file"
    return ""


def _check_file(run: RunRecord, result: AttemptResult, kind: str, path: Path) -> str:
    """Open a file of an attempt, and compare it with the attempt's line."""
    part = _FOLDERS[0] if result.success else _FOLDERS[1]
    stem = make_episode_id(run.task, run.seed, result.index)
    if path.parent.name != part or path.stem != stem:
        return f"{path}: the files of attempt {result.index} must be {part}/{stem}.*"
    if not path.is_file():
        return f"{path} is missing"
    if fault := _open_file(run, result, kind, path):
        return fault
    recorded = result.checksums.get(kind)
    if recorded is None:
        return f"{path}: {ATTEMPTS_FILE} holds no SHA-256 of it"
    if compute_checksum(path) != recorded:
        return f"{path}: it was changed since the run wrote it (its SHA-256 is another one)"
    return ""


def _open_file(run: RunRecord, result: AttemptResult, kind: str, path: Path) -> str:
    try:
        match kind:
            case "episode":
                return _check_episode(run, result, path)
            case "video":
                with av.open(path) as film:
                    frames = sum(1 for _ in film.decode(video=0))
                return "" if frames else f"{path} has no picture"
            case "picture":
                iio.imread(path)
    except CorruptEpisodeError as err:
        return str(err)
    except (OSError, ValueError, IndexError) as err:
        return f"{path} cannot be read: {err}"
    return ""


def _check_episode(run: RunRecord, result: AttemptResult, path: Path) -> str:
    episode = read_episode(path)
    for name, ours, its in (
        ("task", run.task, episode.task),
        ("seed", result.seed, episode.seed),
        ("garment", result.garment_id, episode.garment_id),
        ("success", result.success, episode.success),
        ("value", result.value, episode.success_value),
        ("number of frames", result.frames, sum(stage.frame_count for stage in episode.stages)),
    ):
        if ours != its:
            return f"{path}: its {name} is {its}; {ATTEMPTS_FILE} says {ours}"
    for kind, line, file in (
        ("draw", result.randomisation, episode.randomisation),
        ("measurement", result.measurements, episode.measurements),
    ):
        for name, value in file.items():
            if line.get(name) != value:
                return (
                    f"{path}: its {kind} {name!r} is {value}; {ATTEMPTS_FILE} says {line.get(name)}"
                )
    return ""


def _check_summary(path: Path, results: list[AttemptResult]) -> str:
    """Compare the summary with what follows from the lines."""
    if not path.is_file():
        return f"{path} is missing; --resume writes it"
    try:
        found = read_json_file(Summary, path)
    except (ValueError, OSError) as err:
        return str(err)
    expected = summarize(
        results,
        task=found.task,
        seed=found.seed,
        requested=found.requested,
        status=found.status,
        versions=found.versions,
    )
    for field in dataclasses.fields(Summary):
        its, ours = getattr(found, field.name), getattr(expected, field.name)
        if its != ours:
            return f"{path}: {field.name} is {its}; the lines of {ATTEMPTS_FILE} say {ours}"
    missing = _list_missing(found, results)
    if found.status == "complete" and missing:
        return f"{path}: the run is called complete, and attempt {missing[0]} of {found.requested} is missing"
    return ""
