"""Results of attempts: one line each in `attempts.jsonl`, and their summary."""

from __future__ import annotations

import dataclasses
import importlib.metadata
import json
import platform
import statistics
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import Literal

from scipy.stats import binomtest

from dgl_collect.errors import OutputFolderError
from dgl_files.fields import STRICT, read_json
from dgl_files.whole import write_json
from dgl_tasks.success import Criterion

VERSIONED_PACKAGES = (
    "dexgarmentlab", "dgl-physics", "dgl-assets", "dgl-gam", "dgl-sadp", "dgl-tasks", "dgl-collect",
    "h5py", "mani-skill", "numpy", "sapien", "torch", "warp-lang",
)  # fmt: skip
"""Distributions whose versions travel with every result."""


@dataclass(frozen=True, kw_only=True)
class AttemptResult:
    """The outcome of one attempt, JSON-ready.

    Raises:
        ValueError: If a failure has no reason, a success has one, or a number is not finite.
    """

    index: int
    """Number of the attempt in the run, from 0."""
    seed: int
    """The attempt's own seed."""
    success: bool
    """Whether the task's rule was met at the end."""
    first_try: bool = False
    """Whether it was met when something was about to be done again for the first time; at the end where nothing was."""
    value: float | None = None
    """The quantity that the rule judges; None when the attempt did not get that far."""
    reason: str | None = None
    """Why it failed, in a few words without numbers, so that equal failures can be counted."""
    detail: str = ""
    """The same with numbers."""
    criteria: tuple[Criterion, ...] = ()
    """The conditions of the rule."""
    garment_id: str | None = None
    """Which garment; None when the attempt did not get that far."""
    seconds: float = 0.0
    """Wall-clock time of the attempt [s]."""
    frames: int = 0
    """Recorded frames over all stages."""
    stage_seconds: Mapping[str, float] = field(default_factory=dict)
    """Wall-clock time by stage name [s], in order."""
    files: Mapping[str, str] = field(default_factory=dict)
    """Kind (`episode`, `video`, `picture`) to path, relative to the folder that was given to the attempt;
    relative to the run's folder once the run has taken them over."""
    checksums: Mapping[str, str] = field(default_factory=dict)
    """Kind to SHA-256 of the file, in hexadecimal digits, once the run has taken it over."""
    randomisation: Mapping[str, object] = field(default_factory=dict)
    """Every draw of the attempt."""
    measurements: Mapping[str, float] = field(default_factory=dict)
    """Further named numbers, such as the largest stretch."""
    beliefs: Mapping[str, float] = field(default_factory=dict)
    """What the method made of what it saw, by name: the basis of its decisions, and none of its success."""

    __pydantic_config__ = STRICT

    def __post_init__(self) -> None:
        if self.index < 0:
            raise ValueError(f"index must be at least 0; got {self.index}")
        if not 0 <= self.seed < 2**32:
            raise ValueError(f"seed must be in [0, 2**32); got {self.seed}")
        if self.seconds < 0:
            raise ValueError(f"seconds must be at least 0; got {self.seconds}")
        for kind, name in self.files.items():
            path = PurePosixPath(name)
            if not name or path.is_absolute() or ".." in path.parts:
                raise ValueError(f"{kind} file must lie in the run's folder; got {name!r}")
        if self.success and self.reason is not None:
            raise ValueError(f"reason must be None for a success; got {self.reason!r}")
        if not self.success and not self.reason:
            raise ValueError(f"reason must be given for a failure; got {self.reason!r}")
        try:
            self.to_line()
        except (TypeError, ValueError) as err:
            raise ValueError(f"result must be JSON-ready with finite numbers; {err}") from err

    def to_line(self) -> str:
        """Give the result as one line of JSON, without the line end."""
        return json.dumps(dataclasses.asdict(self), ensure_ascii=False, allow_nan=False)

    @classmethod
    def from_line(cls, line: str) -> AttemptResult:
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
        path: `attempts.jsonl`. A last line without a line end is what a power cut leaves: it is not a
            result.

    Raises:
        OutputFolderError: If a whole line is not a result, or an attempt is there twice.
    """
    if not path.exists():
        return []
    *lines, _ = path.read_text(encoding="utf-8", errors="replace").split("\n")
    results: dict[int, AttemptResult] = {}
    for number, line in enumerate(lines, start=1):
        try:
            result = AttemptResult.from_line(line)
        except ValueError as err:
            raise OutputFolderError(f"{path}, line {number}: {err}") from err
        if result.index in results:
            raise OutputFolderError(f"{path}, line {number}: attempt {result.index} is there twice")
        results[result.index] = result
    return [results[index] for index in sorted(results)]


def wilson_interval(successes: int, attempts: int) -> tuple[float, float]:
    """Compute the 95 % Wilson score interval of a success rate.

    Args:
        successes: Number of successes.
        attempts: Number of attempts.

    Returns:
        Lower and upper limit in [0, 1]; (0, 1) without attempts.
    """
    if not 0 <= successes <= attempts:
        raise ValueError(f"successes must be in [0, {attempts}]; got {successes}")
    if attempts == 0:
        return 0.0, 1.0
    interval = binomtest(successes, attempts).proportion_ci(method="wilson")
    return float(interval.low), float(interval.high)


@dataclass(frozen=True, kw_only=True)
class Summary:
    """What a run amounts to; the content of `summary.json`."""

    __pydantic_config__ = STRICT

    task: str
    """Environment id."""
    seed: int
    """Seed of the run."""
    status: Literal["complete", "interrupted", "failed"]
    """Whether every attempt that was asked for was made."""
    requested: int
    """Attempts asked for."""
    attempted: int
    """Attempts made."""
    succeeded: int
    """Attempts that met the task's rule at their end."""
    succeeded_first: int
    """Attempts that met it at the first try, before anything was done again."""
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
    """Reason of failure to what the first attempt that failed so says of it."""
    versions: Mapping[str, str]
    """Package to version."""


def summarize(
    results: Sequence[AttemptResult],
    *,
    task: str,
    seed: int,
    requested: int,
    status: Literal["complete", "interrupted", "failed"],
    versions: Mapping[str, str],
) -> Summary:
    """Count the results of a run; see `Summary` for the arguments and what comes out."""
    succeeded = sum(result.success for result in results)
    seconds = [result.seconds for result in results]
    garments: dict[str, dict[str, int]] = {}
    for result in results:
        if result.garment_id is not None:
            counts = garments.setdefault(result.garment_id, {"attempted": 0, "succeeded": 0})
            counts["attempted"] += 1
            counts["succeeded"] += result.success
    reasons = Counter(result.reason for result in results if result.reason is not None)
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
        reasons=dict(reasons.most_common()),
        details={
            name: next(result.detail for result in results if result.reason == name)
            for name, _ in reasons.most_common()
        },
        versions=versions,
    )


def write_summary(path: Path, summary: Summary) -> None:
    """Write `summary.json`: the old one stays until the new one is whole."""
    write_json(path, dataclasses.asdict(summary))


def package_versions() -> dict[str, str]:
    """Give the versions of Python and of what is installed among the packages that matter here."""
    versions = {"python": platform.python_version()}
    for name in VERSIONED_PACKAGES:
        try:
            versions[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            continue  # an optional one
    return versions
