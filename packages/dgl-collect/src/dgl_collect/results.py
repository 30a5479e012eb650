"""Results of attempts: one line each in `attempts.jsonl`, and their summary."""

import dataclasses
import importlib.metadata
import json
import logging
import math
import platform
import statistics
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import Annotated, ClassVar, Literal

from annotated_types import Ge, Lt

from dgl_collect.episodes import opened_episode
from dgl_collect.errors import CorruptEpisodeError, OutputFolderError
from dgl_files.fields import STRICT, check_fields, read_json
from dgl_files.whole import write_text
from dgl_tasks.success import Criterion

logger = logging.getLogger(__name__)

ATTEMPTS_FILE = "attempts.jsonl"
PLACEMENT_ERROR = "placement_error_m"
"""Measurement: horizontal distance from the garment's middle to its place at the end [m]."""
POLICY_UNAVAILABLE = "policy unavailable"
"""Reason of an attempt whose policy server did not answer: it says nothing about the policy."""
VERSIONED_PACKAGES = (
    "dexgarmentlab", "dgl-physics", "dgl-assets", "dgl-gam", "dgl-sadp", "dgl-tasks", "dgl-collect",
    "h5py", "mani-skill", "numpy", "sapien", "torch", "warp-lang",
)  # fmt: skip
"""Distributions whose versions travel with every result."""


@dataclass(frozen=True, kw_only=True)
class AttemptResult:
    """The outcome of one attempt, JSON-ready.

    Raises:
        ValueError: If a field is of another type or out of range, a failure has no reason, or a
            success has one.
    """

    __pydantic_config__: ClassVar = STRICT

    index: Annotated[int, Ge(0)]
    """Number of the attempt in the run, from 0."""
    seed: Annotated[int, Ge(0), Lt(2**32)]
    """The attempt's own seed."""
    success: bool
    """True if the task's rule was met at the end."""
    first_try: bool = False
    """Success before any retry."""
    value: float | None = None
    """The quantity that the rule judges; None when the attempt did not get that far."""
    reason: str | None = None
    """Reason of failure, in a few words without numbers, so that equal failures can be counted."""
    detail: str = ""
    """The same with numbers."""
    criteria: tuple[Criterion, ...] = ()
    """The criteria of the rule."""
    garment_id: str | None = None
    """Id of the garment; None when the attempt did not get that far."""
    seconds: Annotated[float, Ge(0)] = 0.0
    """Wall-clock time of the attempt [s]."""
    frames: int = 0
    """Recorded frames over all stages."""
    stage_seconds: Mapping[str, float] = field(default_factory=dict)
    """Wall-clock time by stage name [s], in order."""
    files: Mapping[str, str] = field(default_factory=dict)
    """Kind (`episode`, `video`, `picture`) to path, relative to the attempt's own folder; relative
    to the run's folder once the run has taken the file over."""
    checksums: Mapping[str, str] = field(default_factory=dict)
    """Kind to SHA-256 of the file, in hexadecimal digits, once the run has taken it over."""
    randomisation: Mapping[str, object] = field(default_factory=dict)
    """Every draw of the attempt."""
    measurements: Mapping[str, float] = field(default_factory=dict)
    """Further named numbers, such as the largest stretch."""
    beliefs: Mapping[str, float] = field(default_factory=dict)
    """The method's own estimates by name; they do not decide its success."""

    def __post_init__(self) -> None:
        check_fields(self)
        for kind, name in self.files.items():
            path = PurePosixPath(name)
            if not name or path.is_absolute() or ".." in path.parts:
                raise ValueError(f"{kind} file must lie in the run's folder; got {name!r}")
        if self.success == bool(self.reason):
            wanted = "None for a success" if self.success else "given for a failure"
            raise ValueError(f"reason must be {wanted}; got {self.reason!r}")
        try:
            self.to_line()
        except (TypeError, ValueError) as err:
            raise ValueError(f"result must be JSON-ready with finite numbers; {err}") from err

    def to_line(self) -> str:
        """Write the result as one line of JSON, without the line end."""
        return json.dumps(dataclasses.asdict(self), ensure_ascii=False, allow_nan=False)

    @classmethod
    def from_line(cls, line: str) -> "AttemptResult":
        """Read a result from its line.

        Raises:
            ValueError: If the line is not a result.
        """
        try:
            return read_json(cls, line)
        except ValueError as err:
            raise ValueError(f"line must be an attempt's result; {err}") from err


def read_results(path: Path) -> list[AttemptResult]:
    """Read every result, in the order of the attempts.

    Args:
        path: `attempts.jsonl`. A last line without a line end, left by a power cut, is ignored.

    Raises:
        OutputFolderError: If a whole line is not a result, or an attempt is there twice.
    """
    results, faults = inspect_results(path)
    if faults:
        raise OutputFolderError(faults[0])
    return results


def inspect_results(path: Path) -> tuple[list[AttemptResult], list[str]]:
    """Read the results of all valid lines, in the order of the attempts, and list the others."""
    if not path.exists():
        return [], []
    *lines, _ = path.read_text(encoding="utf-8", errors="replace").split("\n")
    results: dict[int, AttemptResult] = {}
    faults = []
    for number, line in enumerate(lines, start=1):
        try:
            result = AttemptResult.from_line(line)
            if result.index in results:
                raise ValueError(f"attempt {result.index} is there twice")
            results[result.index] = result
        except ValueError as err:
            faults.append(f"{path}, line {number}: {err}")
    return [results[index] for index in sorted(results)], faults


def drop_lost_attempts(folder: Path) -> list[AttemptResult]:
    """Remove the lines of attempts that are to be made again.

    They are those whose episode file is missing or cannot be opened, and those whose policy server
    did not answer.

    Args:
        folder: Of a run.

    Returns:
        The results that are left, in the order of the attempts.

    Raises:
        FileUnavailableError: If an episode cannot be opened now.
        OutputFolderError: As `read_results`.
    """
    path = folder / ATTEMPTS_FILE
    results = read_results(path)
    kept = [result for result in results if not _is_lost(folder, result)]
    if len(kept) < len(results):
        count = len(results) - len(kept)
        logger.warning("%d attempts are made again: an episode or the server was lost", count)
        write_text(path, "".join(f"{result.to_line()}\n" for result in kept))
    return kept


def _is_lost(folder: Path, result: AttemptResult) -> bool:
    if result.reason == POLICY_UNAVAILABLE:
        return True
    if "episode" not in result.files:
        return False
    try:
        with opened_episode(folder / result.files["episode"]):
            return False
    except (FileNotFoundError, CorruptEpisodeError):
        return True


def wilson_interval(successes: int, attempts: int) -> tuple[float, float]:
    """Compute the 95 % Wilson score interval of a success rate.

    Args:
        successes: Number of successes.
        attempts: Number of attempts.

    Returns:
        Lower and upper limit in [0, 1]; (0, 1) without attempts.

    Source:
        Newcombe 1998, method 3.
    """
    if not 0 <= successes <= attempts:
        raise ValueError(f"successes must be in [0, {attempts}]; got {successes}")
    if attempts == 0:
        return 0.0, 1.0
    z, share = 1.959963984540054, successes / attempts
    scale = 2 * (attempts + z**2)
    middle = (2 * attempts * share + z**2) / scale
    half = z / scale * math.sqrt(4 * attempts * share * (1 - share) + z**2)
    low = 0.0 if successes == 0 else middle - half
    return low, 1.0 if successes == attempts else middle + half


RunStatus = Literal["complete", "interrupted", "failed"]


@dataclass(frozen=True, kw_only=True)
class Summary:
    """Counts of a run; the content of `summary.json`."""

    __pydantic_config__: ClassVar = STRICT

    task: str
    """Environment id."""
    seed: int
    """Seed of the run."""
    status: RunStatus
    """`complete` if every attempt that was asked for was made."""
    requested: int
    """Attempts asked for."""
    attempted: int
    """Attempts made."""
    succeeded: int
    """Attempts that met the task's rule at their end."""
    succeeded_first: int
    """Attempts that met it before any retry."""
    success_rate: float | None
    """Succeeded over attempted; None without attempts."""
    success_interval: tuple[float, float]
    """95 % Wilson interval of the success rate."""
    seconds_per_attempt: Mapping[str, float | None]
    """`median` and `mean` wall-clock time of an attempt [s], each on its own worker."""
    garments: Mapping[str, Mapping[str, int]]
    """Garment id to `attempted` and `succeeded`."""
    reasons: Mapping[str, int]
    """Reason of failure to count, most frequent first."""
    details: Mapping[str, str]
    """Reason of failure to the detail of the first attempt that failed so."""
    versions: Mapping[str, str]
    """Package to version."""


def summarize(
    results: Sequence[AttemptResult],
    *,
    task: str,
    seed: int,
    requested: int,
    status: RunStatus,
    versions: Mapping[str, str],
) -> Summary:
    """Count the results of a run; `Summary` describes the arguments."""
    succeeded = sum(result.success for result in results)
    seconds = [result.seconds for result in results]
    garments: dict[str, dict[str, int]] = {}
    for result in results:
        if result.garment_id is not None:
            counts = garments.setdefault(result.garment_id, {"attempted": 0, "succeeded": 0})
            counts["attempted"] += 1
            counts["succeeded"] += result.success
    reasons, details = count_reasons(results)
    return Summary(
        task=task,
        seed=seed,
        status=status,
        requested=requested,
        attempted=len(results),
        succeeded=succeeded,
        succeeded_first=sum(result.first_try for result in results),
        success_rate=succeeded / len(results) if results else None,
        success_interval=wilson_interval(succeeded, len(results)),
        seconds_per_attempt={
            "median": statistics.median(seconds) if seconds else None,
            "mean": statistics.fmean(seconds) if seconds else None,
        },
        garments=dict(sorted(garments.items())),
        reasons=reasons,
        details=details,
        versions=versions,
    )


def count_reasons(results: Sequence[AttemptResult]) -> tuple[dict[str, int], dict[str, str]]:
    """Count the reasons of failure, most frequent first; also give the first detail of each."""
    counts = Counter(result.reason for result in results if result.reason is not None).most_common()
    first = {result.reason: result.detail for result in reversed(results)}
    return dict(counts), {reason: first[reason] for reason, _ in counts}


def package_versions() -> dict[str, str]:
    """List the versions of Python and of `VERSIONED_PACKAGES` as installed."""
    versions = {"python": platform.python_version()}
    for name in VERSIONED_PACKAGES:
        try:
            versions[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            continue  # an optional one
    return versions
