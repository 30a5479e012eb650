"""Paired comparison of evaluations on their common episodes."""

import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Any

from dgl_collect.evaluation.results import (
    RESULTS_FILE,
    Count,
    EpisodeRecord,
    Key,
    Median,
    ResultsRecord,
    count,
    find_median,
)
from dgl_files.fields import read_json_file

__all__ = ["Comparison", "Difference", "Pair", "Score", "compare", "read_evaluation"]


@dataclass(frozen=True, kw_only=True)
class Score:
    """Figures of one method on the common episodes."""

    count: Count
    """Its successes."""
    value_median: float | None
    """Median value of the rule; None without a judged episode."""
    placement_error: Median | None
    """Distance of the garment from its place at the end [m]; None in tasks without a place."""


@dataclass(frozen=True, kw_only=True)
class Difference(Median):
    """Median of the paired differences, first minus second."""

    p_value: float
    """Two-sided p of Wilcoxon's signed-rank test, "Individual comparisons by ranking methods",
    1945; equal pairs are left out."""


@dataclass(frozen=True, kw_only=True)
class Pair:
    """Two methods on the common episodes."""

    first: Path
    """Folder of the first evaluation."""
    second: Path
    """Folder of the second."""
    both: Sequence[Key]
    """Successes of both."""
    first_alone: Sequence[Key]
    """Successes of the first alone."""
    second_alone: Sequence[Key]
    """Successes of the second alone."""
    neither: Sequence[Key]
    """Failures of both."""
    p_value: float
    """Two-sided p of the exact test of McNemar, "Note on the sampling error of the difference
    between correlated proportions", 1947."""
    placement_error: Difference | None
    """Difference of the placement errors [m], on the episodes where both have one."""


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """Comparison of evaluations on their common episodes."""

    task: str
    """Environment id."""
    episodes: Sequence[Key]
    """The common episodes."""
    scores: Mapping[Path, Score]
    """By folder of the evaluation."""
    pairs: Sequence[Pair]
    """All pairs of evaluations."""


def read_evaluation(folder: Path) -> ResultsRecord:
    """Read the results of `dgl eval`.

    Args:
        folder: The folder given as its `--out`.

    Raises:
        FileNotFoundError: If the folder holds no results.
        ValueError: If they are damaged, or of another kind.
    """
    path = folder / RESULTS_FILE
    if not path.is_file():
        raise FileNotFoundError(
            f"{folder} holds no evaluation: {RESULTS_FILE}, which dgl eval writes, is missing"
        )
    try:
        return read_json_file(ResultsRecord, path)
    except ValueError as err:
        raise ValueError(f"{err}; the file is damaged or not of dgl eval") from err


def compare(evaluations: Mapping[Path, ResultsRecord]) -> Comparison:
    """Compare evaluations on their common episodes.

    Args:
        evaluations: Folder to results, at least two, of one task.

    Raises:
        ValueError: If there are fewer, they are of several tasks, share no episode, or an episode
            began differently.
    """
    if len(evaluations) < 2:
        raise ValueError(f"at least two evaluations are compared; got {len(evaluations)}")
    (folder, first), *others = evaluations.items()
    for other_folder, other in others:
        for name in ("task", "friction"):
            ours, theirs = getattr(first, name), getattr(other, name)
            if ours != theirs:
                raise ValueError(
                    f"{folder} and {other_folder} cannot be compared: "
                    f"their {name} is {ours} and {theirs}"
                )
    common = sorted(set(first.episodes).intersection(*(other.episodes for _, other in others)))
    if not common:
        raise ValueError(f"there is no episode that all of {', '.join(map(str, evaluations))} have")
    for other_folder, other in others:
        for key in common:
            ours, theirs = first.episodes[key], other.episodes[key]
            if not _began_alike(ours, theirs):
                raise ValueError(
                    f"episode {key[1]} of seed {key[0]} began "
                    f"with {ours.garment} (seed {ours.episode_seed}) in {folder} and "
                    f"with {theirs.garment} (seed {theirs.episode_seed}) in {other_folder}"
                )
    common_of = {
        path: [evaluation.episodes[key] for key in common]
        for path, evaluation in evaluations.items()
    }
    return Comparison(
        task=first.task,
        episodes=common,
        scores={path: _score(episodes) for path, episodes in common_of.items()},
        pairs=[_pair(*two, common) for two in combinations(common_of.items(), 2)],
    )


def _began_alike(ours: EpisodeRecord, theirs: EpisodeRecord) -> bool:
    garments = {ours.garment, theirs.garment} - {None}  # None where an exception ended it
    return ours.episode_seed == theirs.episode_seed and len(garments) < 2


def _score(episodes: Sequence[EpisodeRecord]) -> Score:
    values = [episode.value for episode in episodes if episode.value is not None]
    return Score(
        count=count(episodes),
        value_median=statistics.median(values) if values else None,
        placement_error=find_median(
            [each.placement_error_m for each in episodes if each.placement_error_m is not None]
        ),
    )


def _pair(
    first: tuple[Path, Sequence[EpisodeRecord]],
    second: tuple[Path, Sequence[EpisodeRecord]],
    keys: Sequence[Key],
) -> Pair:
    groups: dict[tuple[bool, bool], list[Key]] = {
        (a, b): [] for a in (True, False) for b in (True, False)
    }
    for key, ours, theirs in zip(keys, first[1], second[1], strict=True):
        groups[ours.success, theirs.success].append(key)
    return Pair(
        first=first[0],
        second=second[0],
        both=groups[True, True],
        first_alone=groups[True, False],
        second_alone=groups[False, True],
        neither=groups[False, False],
        p_value=compute_mcnemar(len(groups[True, False]), len(groups[False, True])),
        placement_error=_compare_placement(first[1], second[1]),
    )


def _compare_placement(
    first: Sequence[EpisodeRecord], second: Sequence[EpisodeRecord]
) -> Difference | None:
    """Compare the placement errors of the same episodes."""
    from scipy.stats import wilcoxon

    differences = [
        ours.placement_error_m - theirs.placement_error_m
        for ours, theirs in zip(first, second, strict=True)
        if ours.placement_error_m is not None and theirs.placement_error_m is not None
    ]
    found = find_median(differences)
    if found is None:
        return None
    result: Any = wilcoxon(differences) if any(differences) else None
    return Difference(**vars(found), p_value=1.0 if result is None else float(result.pvalue))


def compute_mcnemar(first_alone: int, second_alone: int) -> float:
    """Compute the two-sided p of McNemar's exact test from the numbers of one-sided successes."""
    from scipy.stats import binomtest

    unequal = first_alone + second_alone
    return float(binomtest(first_alone, unequal).pvalue) if unequal else 1.0
