"""Checks of a run's folder: every file opens, and files that state the same fact agree."""

import dataclasses
import io
from collections.abc import Iterator
from pathlib import Path

import av
import imageio.v3 as iio

from dgl_collect.attempt_jobs import make_attempt_seed, make_episode_id
from dgl_collect.episodes import read_episode
from dgl_collect.errors import CorruptEpisodeError, OutputFolderError
from dgl_collect.evaluation.results import RESULTS_FILE, ResultsRecord
from dgl_collect.files import unavailable_told
from dgl_collect.results import (
    ATTEMPTS_FILE,
    AttemptResult,
    Summary,
    inspect_results,
    read_results,
    summarize,
)
from dgl_collect.run_folder import SUMMARY_FILE, RunRecord, read_run
from dgl_collect.runner import CollectConfig
from dgl_files.fields import read_json_file
from dgl_files.whole import compute_checksum

__all__ = ["find_missing", "verify_evaluation", "verify_run"]

_FOLDERS = ("episodes", "failed")


def verify_run(folder: Path) -> Iterator[tuple[Path, str]]:
    """Check the folder of a collection, or of one seed of an evaluation; nothing is changed.

    Every file opens, with the recorded shapes, numbers and checksum; lines and files agree; seeds
    are those of the run; success follows from the criteria; the summary counts the lines, and no
    attempt of a complete run is missing.

    Args:
        folder: Of the run.

    Yields:
        Each file as it is checked, with its fault, or "".

    Raises:
        FileUnavailableError: If a file cannot be read now, so that nothing can be said of it.
        OutputFolderError: If the folder is of a search for parameters.
    """
    try:
        run = read_run(folder)
    except OutputFolderError as err:
        yield folder / "run.json", str(err)
        return
    if run.attempt_factory.startswith("dgl_collect.tuning."):
        raise OutputFolderError(f"{folder} is of dgl tune, whose trials leave no files to verify")
    yield folder / "run.json", ""
    lines = folder / ATTEMPTS_FILE
    with unavailable_told(lines):
        results, faults = inspect_results(lines)
    for fault in faults or [""]:
        yield lines, fault
    if lines.is_file() and not lines.read_bytes().endswith(b"\n"):
        yield lines, f"{lines}: its last line is not finished; --resume cuts it off"
    named: set[Path] = set()
    for result in results:
        yield lines, _check_result(run, result)
        for kind, name in result.files.items():
            path = folder / name
            named.add(path)
            with unavailable_told(path):
                fault = _check_file(run, result, kind, path)
            yield path, fault
    if not faults:  # else the files of these lines would be called unknown, and the counts wrong
        for part in _FOLDERS:
            for path in sorted((folder / part).glob("*")):
                if path not in named:
                    yield path, f"{path}: no attempt of {ATTEMPTS_FILE} names it"
        yield folder / SUMMARY_FILE, _check_summary(folder / SUMMARY_FILE, results)


def find_missing(folder: Path) -> list[int]:
    """List the attempts that were asked for and are not made yet; none without a summary."""
    try:
        summary = read_json_file(Summary, folder / SUMMARY_FILE)
        return _list_missing(summary, read_results(folder / ATTEMPTS_FILE))
    except (ValueError, OSError, OutputFolderError):
        return []


def _list_missing(summary: Summary, results: list[AttemptResult]) -> list[int]:
    return sorted(set(range(summary.requested)) - {result.index for result in results})


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
    again = "; --resume makes the attempt again" if kind == "episode" else ""
    if path.parent.name != part or path.stem != stem:
        return f"{path}: the files of attempt {result.index} must be {part}/{stem}.*"
    if not path.is_file():
        return f"{path} is missing{again}"
    content = b"" if kind == "episode" else path.read_bytes()
    try:
        if kind == "episode":
            fault = _check_episode(run, result, path)
        else:
            fault = _check_content(kind, content)
    except CorruptEpisodeError as err:
        return f"{err}; remove it{again}"
    except (OSError, ValueError, IndexError, EOFError, SyntaxError) as err:
        fault = f"cannot be read: {err}"
    if fault:
        return f"{path} {fault}"
    recorded = result.checksums.get(kind)
    if recorded is None:
        return f"{path}: {ATTEMPTS_FILE} holds no SHA-256 of it"
    if compute_checksum(path) != recorded:
        return f"{path}: it was changed since the run wrote it (its SHA-256 is another one)"
    return ""


def _check_content(kind: str, content: bytes) -> str:
    """Open the content of a film or a picture."""
    if kind == "picture":
        if not content.startswith(b"\x89PNG\r\n\x1a\n"):
            return "is no PNG picture"
        iio.imread(content, extension=".png")
    if kind == "video":
        with av.open(io.BytesIO(content)) as film:
            if not any(True for _ in film.decode(video=0)):
                return "has no picture"
    return ""


def _check_episode(run: RunRecord, result: AttemptResult, path: Path) -> str:
    episode = read_episode(path)
    facts: list[tuple[str, object, object]] = [
        ("task", run.task, episode.task),
        ("seed", result.seed, episode.seed),
        ("garment", result.garment_id, episode.garment_id),
        ("success", result.success, episode.success),
        ("value", result.value, episode.success_value),
        ("number of frames", result.frames, sum(stage.frame_count for stage in episode.stages)),
    ]
    for kind, line, file in (
        ("draw", result.randomisation, episode.randomisation),
        ("measurement", result.measurements, episode.measurements),
    ):
        facts += [(f"{kind} {name!r}", line.get(name), value) for name, value in file.items()]
    for name, ours, its in facts:
        if ours != its:
            return f"has {name} {its}; {ATTEMPTS_FILE} says {ours}"
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
        return (
            f"{path}: the run is called complete, and attempt {missing[0]} of {found.requested} "
            "is missing"
        )
    return ""


def verify_evaluation(folder: Path) -> Iterator[tuple[Path, str]]:
    """Check an evaluation: the runs of its seeds, and `results.json` against their lines.

    Args:
        folder: Of the evaluation.

    Yields:
        As `verify_run`.
    """
    path = folder / RESULTS_FILE
    try:
        content = read_json_file(ResultsRecord, path)
    except (ValueError, OSError) as err:
        yield path, str(err)
        return
    told = {(run.seed, run.episode): (run.episode_seed, run.success) for run in content.runs}
    counted = {}
    for run in sorted(folder.glob("seed-*")):
        yield from verify_run(run)
        seed = run.name.removeprefix("seed-")
        results, _ = inspect_results(run / ATTEMPTS_FILE)
        if seed.isdecimal():
            counted |= {(int(seed), r.index): (r.seed, r.success) for r in results}
    for seed, episode in sorted(told.keys() | counted.keys()):
        ours, its = told.get((seed, episode)), counted.get((seed, episode))
        if ours != its:
            where = f"{path}: episode {episode} of seed {seed}"
            told_there = f"{ATTEMPTS_FILE} of seed-{seed} says {_describe(its)}"
            yield path, f"{where} is {_describe(ours)}; {told_there}"
            return
    yield path, ""


def _describe(told: tuple[int, bool] | None) -> str:
    if told is None:
        return "not there"
    return f"a {'success' if told[1] else 'failure'} with the seed {told[0]}"
