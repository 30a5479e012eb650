"""Figures of an evaluation: success by seed and by split, with their spread."""

import math
import statistics
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Literal

from dgl_collect.results import PLACEMENT_ERROR, AttemptResult, count_reasons, wilson_interval
from dgl_files.fields import STRICT_PART

__all__ = [
    "RESULTS_FILE",
    "Count",
    "Median",
    "Results",
    "Run",
    "count",
    "find_median",
    "summarize",
    "to_json",
]

RESULTS_FILE = "results.json"
"""File of the figures in the evaluation's folder."""


@dataclass(frozen=True, kw_only=True)
class Run:
    """The episodes of one seed."""

    seed: int
    """As the command line names it."""
    folder: Path
    """Folder of films and pictures, relative to the evaluation's."""
    results: Sequence[AttemptResult]
    """In the order of the episodes."""


@dataclass(frozen=True, kw_only=True)
class Count:
    """Successes among episodes."""

    episodes: int
    """Episodes run."""
    first_try: int
    """Successes before any retry: the paper's protocol."""
    succeeded: int
    """Successes at the end, with retries."""
    rate: float | None
    """Succeeded over episodes; None without episodes."""
    interval: tuple[float, float]
    """95 % Wilson interval of the rate."""


@dataclass(frozen=True, kw_only=True)
class Median:
    """Median of a sample."""

    count: int
    """Size of the sample."""
    median: float
    """The median."""
    interval: tuple[float, float] | None
    """95 % interval of the population's median, from order statistics; None for fewer than six."""


@dataclass(frozen=True, kw_only=True)
class Results:
    """The figures of an evaluation."""

    total: Count
    """Over all seeds."""
    by_seed: Mapping[int, Count]
    """For each seed."""
    by_split: Mapping[str, Count]
    """For garments of the training and of the testing split."""
    mean: float | None
    """Mean over the seeds of their success rates; None without episodes."""
    std: float | None
    """Standard deviation of these rates, with n - 1; None for fewer than two seeds."""
    value_median: float | None
    """Median of the quantity that the rule judges, over the episodes that were judged."""
    value_least: float | None
    """Its smallest value; the best one where the rule has an upper threshold."""
    value_largest: float | None
    """Its largest value."""
    placement_error: Median | None
    """Distance of the garment from its place at the end [m]; None in tasks without a place."""
    seconds_median: float | None
    """Median wall-clock time of an episode [s]."""
    reasons: Mapping[str, int]
    """Reason of failure to count, most frequent first."""
    details: Mapping[str, str]
    """Reason of failure to the detail of its first episode."""


Key = tuple[int, int]
"""Seed and number of an episode."""


@dataclass(frozen=True, kw_only=True)
class EpisodeRecord:
    """One episode in `results.json`; other keys are ignored."""

    __pydantic_config__ = STRICT_PART

    seed: int
    """Of the evaluation."""
    episode: int
    """Number of the episode."""
    episode_seed: int
    """Its own seed."""
    garment: str | None
    """The garment; None where an exception ended the episode."""
    success: bool
    """Success at its end."""
    first_try: bool
    """Success before any retry."""
    value: float | None
    """Value of the rule; None if it was not judged."""
    placement_error_m: float | None = None
    """Distance of the garment from its place at the end [m]; None if it was not measured."""


@dataclass(frozen=True, kw_only=True)
class ResultsRecord:
    """Content of `results.json` that comparisons need."""

    __pydantic_config__ = STRICT_PART

    format: Literal[1]
    """Version of the format."""
    task: str
    """Environment id."""
    policy: str
    """The method."""
    friction: float
    """The factor on the garments' friction and adhesion."""
    runs: tuple[EpisodeRecord, ...]
    """The episodes."""

    def __post_init__(self) -> None:
        keys = Counter((run.seed, run.episode) for run in self.runs)
        for (seed, episode), times in keys.items():
            if times > 1:
                raise ValueError(f"episode {episode} of seed {seed} is there twice")

    @cached_property
    def episodes(self) -> Mapping[Key, EpisodeRecord]:
        """The episodes by seed and number."""
        return {(run.seed, run.episode): run for run in self.runs}


def count(results: Sequence[AttemptResult] | Sequence[EpisodeRecord]) -> Count:
    """Count successes."""
    succeeded = sum(result.success for result in results)
    return Count(
        episodes=len(results),
        first_try=sum(result.first_try for result in results),
        succeeded=succeeded,
        rate=succeeded / len(results) if results else None,
        interval=wilson_interval(succeeded, len(results)),
    )


def find_median(values: Sequence[float]) -> Median | None:
    """Compute the median of a sample and its interval; None without values."""
    from scipy.stats import quantile_test

    if not values:
        return None
    found = quantile_test(values, p=0.5).confidence_interval(0.95)
    low, high = float(found.low), float(found.high)
    return Median(
        count=len(values),
        median=statistics.median(values),
        interval=(low, high) if math.isfinite(low) and math.isfinite(high) else None,
    )


def summarize(runs: Sequence[Run]) -> Results:
    """Compute the figures of the runs of all seeds."""
    everything = [result for run in runs for result in run.results]
    by_seed = {run.seed: count(run.results) for run in runs}
    rates = [item.rate for item in by_seed.values() if item.rate is not None]
    values = [result.value for result in everything if result.value is not None]
    splits = sorted({_split(result) for result in everything})
    placed = [result.measurements.get(PLACEMENT_ERROR) for result in everything]
    reasons, details = count_reasons(everything)
    return Results(
        total=count(everything),
        by_seed=by_seed,
        by_split={s: count([r for r in everything if _split(r) == s]) for s in splits},
        mean=statistics.fmean(rates) if rates else None,
        std=statistics.stdev(rates) if len(rates) > 1 else None,
        value_median=statistics.median(values) if values else None,
        value_least=min(values, default=None),
        value_largest=max(values, default=None),
        placement_error=find_median([error for error in placed if error is not None]),
        seconds_median=statistics.median(r.seconds for r in everything) if everything else None,
        reasons=reasons,
        details=details,
    )


def to_json(
    results: Results,
    runs: Sequence[Run],
    *,
    asked: Mapping[str, object],
    status: Literal["complete", "interrupted"],
    versions: Mapping[str, str],
) -> dict[str, object]:
    """Build the content of `results.json`: options, figures, and a record of every episode."""
    return {
        "format": 1,
        **asked,
        "status": status,
        "success": {"mean": results.mean, "std": results.std, **asdict(results.total)},
        "by_seed": {str(seed): asdict(item) for seed, item in results.by_seed.items()},
        "by_split": {split: asdict(item) for split, item in results.by_split.items()},
        "value": {
            "median": results.value_median,
            "least": results.value_least,
            "largest": results.value_largest,
        },
        PLACEMENT_ERROR: None if (found := results.placement_error) is None else asdict(found),
        "seconds_median": results.seconds_median,
        "reasons": dict(results.reasons),
        "runs": [_record(run, result) for run in runs for result in run.results],
        "versions": dict(versions),
    }


def _record(run: Run, result: AttemptResult) -> dict[str, object]:
    return {
        "seed": run.seed,
        "episode": result.index,
        "episode_seed": result.seed,
        "garment": result.garment_id,
        "split": _split(result),
        "first_try": result.first_try,
        "success": result.success,
        "beliefs": dict(result.beliefs),
        "value": result.value,
        PLACEMENT_ERROR: result.measurements.get(PLACEMENT_ERROR),
        "reason": result.reason,
        "detail": result.detail,
        "steps": None if (steps := result.measurements.get("steps")) is None else int(steps),
        "seconds": result.seconds,
        "files": {kind: str(run.folder / name) for kind, name in result.files.items()},
    }


def _split(result: AttemptResult) -> str:
    return str(result.randomisation.get("split", "unknown"))
