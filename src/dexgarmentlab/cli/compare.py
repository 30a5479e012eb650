"""Verb `dgl compare`."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro  # noqa: TID253 - marks the positional argument; the command line imports it anyway

from dexgarmentlab.cli import EXIT_OK, console

if TYPE_CHECKING:
    from dgl_collect.evaluation.comparison import Comparison
    from dgl_collect.evaluation.results import Median, ResultsRecord

__all__ = ["CompareOptions", "run"]


@dataclass(frozen=True, kw_only=True)
class CompareOptions:
    """Compare evaluations of one task on the episodes that all of them have run.

    Every method of `dgl eval` meets the same garments at the same places, so what tells two methods
    apart are the episodes that one of them does and the other does not: p is the exact test of
    McNemar. Where the garment has a place, such as a hook, its distance from it at the end is
    compared episode by episode: the difference is first minus second, p is Wilcoxon's.

    Example: dgl compare out/halo out/gam_dp3 out/dp3
    """

    folders: Annotated[tuple[Path, ...], tyro.conf.Positional, tyro.conf.arg(metavar="DIR")]
    """Two or more folders of `dgl eval`."""
    json: bool = False
    """Write the comparison, with the episodes by number, as JSON."""


def run(options: CompareOptions) -> int:
    """Compare, and show each method and every two of them."""
    from dgl_collect.evaluation.comparison import compare, read_evaluation

    if len(set(options.folders)) < len(options.folders):
        raise ValueError(f"folders must differ; got {' '.join(map(str, options.folders))}")
    evaluations = {folder: read_evaluation(folder) for folder in options.folders}
    comparison = compare(evaluations)
    for folder, evaluation in evaluations.items():
        left = len(evaluation.episodes) - len(comparison.episodes)
        if left:
            console.info(f"{folder} has {left} more episodes, which others have not run")
    if options.json:
        console.out_json(_to_json(evaluations, comparison))
    else:
        _show(evaluations, comparison)
    return EXIT_OK


def _show(evaluations: Mapping[Path, "ResultsRecord"], comparison: "Comparison") -> None:
    console.out(f"{comparison.task}, {len(comparison.episodes)} episodes that all have run")
    rows: list[Sequence[object]] = []
    for folder, score in comparison.scores.items():
        low, high = score.count.interval
        median = "-" if score.value_median is None else f"{score.value_median:.3f}"
        placement = describe_cm(score.placement_error)
        rows.append(
            (
                folder,
                evaluations[folder].policy,
                score.count.succeeded,
                f"{score.count.rate:.3f}",
                f"{low:.1%} to {high:.1%}",
                median,
                placement,
            )
        )
    console.out_table(
        ("", "method", "succeeded", "rate", "95 % interval", "median value", "placement error"),
        rows,
    )
    console.out("")
    console.out_table(
        (
            "first",
            "second",
            "both",
            "first alone",
            "second alone",
            "neither",
            "McNemar p",
            "placement difference",
            "Wilcoxon p",
        ),
        [
            (
                pair.first,
                pair.second,
                len(pair.both),
                len(pair.first_alone),
                len(pair.second_alone),
                len(pair.neither),
                f"{pair.p_value:.2g}",
                describe_cm(pair.placement_error),
                "-" if pair.placement_error is None else f"{pair.placement_error.p_value:.2g}",
            )
            for pair in comparison.pairs
        ],
    )


def describe_cm(found: "Median | None") -> str:
    """Put a median of lengths [m] and its 95 % interval into words [cm]."""
    if found is None:
        return "-"
    text = f"{100 * found.median:.1f} cm"
    if found.interval is not None:
        low, high = found.interval
        text += f" ({100 * low:.1f} to {100 * high:.1f})"
    return text


def _to_json(
    evaluations: Mapping[Path, "ResultsRecord"], comparison: "Comparison"
) -> dict[str, object]:
    return {
        "task": comparison.task,
        "episodes": [list(key) for key in comparison.episodes],
        "methods": [
            {
                "folder": str(folder),
                "policy": evaluations[folder].policy,
                "succeeded": score.count.succeeded,
                "rate": score.count.rate,
                "interval": list(score.count.interval),
                "value_median": score.value_median,
                "placement_error_m": _plain(score.placement_error),
            }
            for folder, score in comparison.scores.items()
        ],
        "pairs": [
            {
                "first": str(pair.first),
                "second": str(pair.second),
                "both": [list(key) for key in pair.both],
                "first_alone": [list(key) for key in pair.first_alone],
                "second_alone": [list(key) for key in pair.second_alone],
                "neither": [list(key) for key in pair.neither],
                "p": pair.p_value,
                "placement_error_m": _plain(pair.placement_error),
            }
            for pair in comparison.pairs
        ],
    }


def _plain(found: "Median | None") -> dict[str, object] | None:
    return None if found is None else asdict(found)
