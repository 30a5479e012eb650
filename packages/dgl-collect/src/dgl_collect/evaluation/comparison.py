"""Paired comparison of evaluations on their common episodes."""

import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

from dgl_collect.evaluation.results import RESULTS_FILE, Count, EpisodeRecord, ResultsRecord, count
from dgl_files.fields import read_json_file

__all__ = ["Comparison", "Evaluation", "Key", "Pair", "Score", "compare", "read_evaluation"]

Key = tuple[int, int]
"""Seed and number of an episode."""


@dataclass(frozen=True, kw_only=True)
class Evaluation:
    """Episodes of one method, read from a folder of `dgl eval`."""

    folder: Path
    """The folder."""
    task: str
    """Environment id."""
    policy: str
    """The method."""
    friction: float
    """The factor on the garments' friction and adhesion."""
    episodes: Mapping[Key, EpisodeRecord]
    """Episodes by seed and number."""


@dataclass(frozen=True, kw_only=True)
class Score:
    """Figures of one method on the common episodes."""

    count: Count
    """Its successes."""
    value_median: float | None
    """Median value of the rule; None without a judged episode."""


@dataclass(frozen=True, kw_only=True)
class Pair:
    """Two methods on the common episodes."""

    first: int
    """Index of the first evaluation."""
    second: int
    """Index of the second."""
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


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """Comparison of evaluations on their common episodes."""

    task: str
    """Environment id."""
    episodes: Sequence[Key]
    """The common episodes."""
    scores: Sequence[Score]
    """One for each evaluation."""
    pairs: Sequence[Pair]
    """All pairs of evaluations."""


def read_evaluation(folder: Path | str) -> Evaluation:
    """Read the results of `dgl eval`.

    Args:
        folder: The folder given as its `--out`.

    Raises:
        FileNotFoundError: If the folder holds no results.
        ValueError: If they are damaged, or of another kind.
    """
    path = Path(folder) / RESULTS_FILE
    if not path.is_file():
        raise FileNotFoundError(
            f"{folder} holds no evaluation: {RESULTS_FILE}, which dgl eval writes, is missing"
        )
    try:
        content = read_json_file(ResultsRecord, path)
    except ValueError as err:
        raise ValueError(f"{err}; the file is damaged or not of dgl eval") from err
    return Evaluation(
        folder=Path(folder),
        task=content.task,
        policy=content.policy,
        friction=content.friction,
        episodes={(run.seed, run.episode): run for run in content.runs},
    )


def compare(evaluations: Sequence[Evaluation]) -> Comparison:
    """Compare evaluations on their common episodes.

    Args:
        evaluations: At least two, of one task.

    Raises:
        ValueError: If there are fewer, they are of several tasks, share no episode, or an episode
            began differently.
    """
    if len(evaluations) < 2:
        raise ValueError(f"at least two evaluations are compared; got {len(evaluations)}")
    first, *others = evaluations
    for other in others:
        for name in ("task", "friction"):
            ours, theirs = getattr(first, name), getattr(other, name)
            if ours != theirs:
                raise ValueError(
                    f"{first.folder} and {other.folder} cannot be compared: "
                    f"their {name} is {ours} and {theirs}"
                )
    common = sorted(set(first.episodes).intersection(*(other.episodes for other in others)))
    if not common:
        names = ", ".join(str(evaluation.folder) for evaluation in evaluations)
        raise ValueError(f"there is no episode that all of {names} have run")
    for other in others:
        for key in common:
            if not _began_alike(first.episodes[key], other.episodes[key]):
                starts = [
                    f"with {e.garment} (seed {e.episode_seed}) in {evaluation.folder}"
                    for evaluation in (first, other)
                    for e in [evaluation.episodes[key]]
                ]
                raise ValueError(f"episode {key[1]} of seed {key[0]} began {' and '.join(starts)}")
    return Comparison(
        task=first.task,
        episodes=common,
        scores=[_score(evaluation, common) for evaluation in evaluations],
        pairs=[
            _pair(evaluations, (i, j), common) for i, j in combinations(range(len(evaluations)), 2)
        ],
    )


def _began_alike(ours: EpisodeRecord, theirs: EpisodeRecord) -> bool:
    garments = {ours.garment, theirs.garment} - {None}  # None where an exception ended it
    return ours.episode_seed == theirs.episode_seed and len(garments) < 2


def _score(evaluation: Evaluation, common: Sequence[Key]) -> Score:
    episodes = [evaluation.episodes[key] for key in common]
    values = [episode.value for episode in episodes if episode.value is not None]
    return Score(
        count=count(episodes),
        value_median=statistics.median(values) if values else None,
    )


def _pair(
    evaluations: Sequence[Evaluation], indices: tuple[int, int], common: Sequence[Key]
) -> Pair:
    groups: dict[tuple[bool, bool], list[Key]] = {
        (a, b): [] for a in (True, False) for b in (True, False)
    }
    for key in common:
        ours, theirs = (evaluations[index].episodes[key].success for index in indices)
        groups[ours, theirs].append(key)
    return Pair(
        first=indices[0],
        second=indices[1],
        both=groups[True, True],
        first_alone=groups[True, False],
        second_alone=groups[False, True],
        neither=groups[False, False],
        p_value=compute_mcnemar(len(groups[True, False]), len(groups[False, True])),
    )


def compute_mcnemar(first_alone: int, second_alone: int) -> float:
    """Compute the two-sided p of McNemar's exact test from the numbers of one-sided successes."""
    from scipy.stats import binomtest

    unequal = first_alone + second_alone
    return float(binomtest(first_alone, unequal).pvalue) if unequal else 1.0
