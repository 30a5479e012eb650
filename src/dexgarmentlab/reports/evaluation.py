"""The page of an evaluation: success rates, and all episodes."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from dexgarmentlab.reports.attempt import make_card
from dexgarmentlab.reports.page import format_duration, format_number, split_words, write_page
from dexgarmentlab.reports.pictures import Shot, draw_sheet, load_gallery, make_shot
from dgl_collect.evaluation.results import Results, Run
from dgl_collect.results import AttemptResult

__all__ = ["PICTURES_FILE", "REPORT_FILE", "write_report"]

REPORT_FILE, PICTURES_FILE = "index.html", "pictures.jpg"
SHOWN_FAILURES = 24
"""Failures shown with film and figures at most; the pictures and the table have all episodes."""


def write_report(
    folder: Path | str,
    results: Results,
    runs: Sequence[Run],
    *,
    asked: Mapping[str, object],
    wanted: int,
    versions: Mapping[str, str],
) -> Path:
    """Write the page of an evaluation, and a sheet of all final pictures, replacing older ones.

    Args:
        folder: Folder of the evaluation.
        results: Its figures.
        runs: The episodes of each seed.
        asked: Options of the run, of which "task", "policy", "matcher" and "command" are shown.
        wanted: Episodes in all; an evaluation of fewer was interrupted.
        versions: Versions of the packages.

    Returns:
        The page, `index.html`; the sheet, `pictures.jpg`, is beside it.

    Raises:
        OSError: If a picture cannot be read.
    """
    folder, many = Path(folder), len(runs) > 1
    shots = {run.seed: _shoot(folder, run) for run in runs}
    every = [shot for own in shots.values() for shot in own]
    if every:
        draw_sheet(every, folder / PICTURES_FILE)
    episodes = [(run, result) for run in runs for result in run.results]
    failed = [(run, result) for run, result in episodes if not result.success]
    counts = {f"seed {seed}": item for seed, item in results.by_seed.items()}
    counts |= {f"{split} garments": item for split, item in results.by_split.items()}
    return write_page(
        folder / REPORT_FILE,
        "evaluation.html",
        task=split_words(str(asked["task"])),
        asked=asked,
        results=results,
        wanted=wanted,
        facts=_list_facts(results, asked),
        counts=counts,
        galleries={seed: load_gallery(own) for seed, own in shots.items()},
        failed=len(failed),
        cards=[
            make_card(
                result,
                {kind: _find_address(run, result, kind) for kind in ("video", "picture")},
                name=f"s{run.seed}e{result.index}",
                heading=_name(run, result, many=many),
            )
            for run, result in failed[:SHOWN_FAILURES]
        ],
        episodes=[
            (_name(run, result, many=many), _find_address(run, result, "video"), result)
            for run, result in episodes
        ],
        commands=[str(asked["command"])],
        versions=versions,
    )


def _shoot(folder: Path, run: Run) -> list[Shot]:
    return [
        make_shot(result, folder / run.folder, link=_find_address(run, result, "video"))
        for result in run.results
        if "picture" in result.files
    ]


def _list_facts(results: Results, asked: Mapping[str, object]) -> list[tuple[str, str]]:
    total = results.total
    facts = [
        (f"{total.first_try} of {total.episodes}", "succeeded at the first try"),
        (f"{total.succeeded} of {total.episodes}", "succeeded with retries"),
    ]
    if results.std is not None:
        seeds = f"over {len(results.by_seed)} seeds"
        facts.append((f"{results.mean:.3f} ± {results.std:.3f}", f"mean and deviation {seeds}"))
    if results.value_median is not None:
        facts.append((format_number(results.value_median), "median value"))
    if results.placement_error is not None:
        facts.append((f"{100 * results.placement_error.median:.1f} cm", "median placement error"))
    facts.append((str(asked["matcher"]), "finds the points"))
    if results.seconds_median is not None:
        facts.append((format_duration(results.seconds_median), "median per episode"))
    return facts


def _name(run: Run, result: AttemptResult, *, many: bool) -> str:
    return f"Episode {result.index}" + (f" of seed {run.seed}" if many else "")


def _find_address(run: Run, result: AttemptResult, kind: str) -> str | None:
    """Return the address of an episode's film or picture, relative to the page."""
    if kind not in result.files:
        return None
    return (run.folder / result.files[kind]).as_posix()
