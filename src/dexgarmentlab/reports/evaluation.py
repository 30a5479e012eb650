"""The page of an evaluation: how many episodes succeeded, and what all of them came to."""

import html
from collections.abc import Mapping, Sequence
from pathlib import Path

from dexgarmentlab.reports import figures
from dexgarmentlab.reports.attempt import attempt_card, split_words
from dexgarmentlab.reports.page import (
    format_duration,
    make_page,
    outcome_badge,
    provenance,
    rate_headline,
    reason_bars,
    resume_notice,
    table,
    tiles,
)
from dexgarmentlab.reports.pictures import Shot, draw_sheet, gallery, make_shot
from dgl_collect.evaluation.results import Count, Results, Run
from dgl_collect.results import AttemptResult
from dgl_files.whole import written_beside

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
        folder: The evaluation's.
        results: Its figures.
        runs: The episodes of each seed.
        asked: What was asked for, of which "task", "policy", "matcher" and "command" are shown.
        wanted: Episodes that it is to have in all; with fewer it was interrupted.
        versions: Of the packages.

    Returns:
        The page, `index.html`; the sheet, `pictures.jpg`, is beside it.

    Raises:
        OSError: If a picture cannot be read.
    """
    folder = Path(folder)
    shots = {run.seed: _shoot(folder, run) for run in runs}
    every = [shot for own in shots.values() for shot in own]
    if every:
        draw_sheet(every, folder / PICTURES_FILE)
    done = results.total.episodes
    body = [
        resume_notice("interrupted" if done < wanted else "complete", done, wanted, "episodes"),
        reason_bars("Why episodes failed", results.reasons),
        _counts(results),
        *(_pictures(seed, own, many=len(shots) > 1) for seed, own in shots.items()),
        *_failures(runs),
        _episodes(runs),
        provenance([str(asked["command"])], versions),
    ]
    page = make_page(
        f"{split_words(str(asked['task']))}: {asked['policy']}",
        overline="evaluation",
        header=_header(results, asked),
        body=body,
    )
    path = folder / REPORT_FILE
    with written_beside(path) as partial:
        partial.write_text(page, encoding="utf-8")
    return path


def _shoot(folder: Path, run: Run) -> list[Shot]:
    return [
        make_shot(result, folder / run.folder, link=_address(run, result, "video"))
        for result in run.results
        if "picture" in result.files
    ]


def _header(results: Results, asked: Mapping[str, object]) -> str:
    total = results.total
    if total.rate is None or results.mean is None:
        headline = '<p class="headline">No episodes yet</p>'
    else:
        headline = rate_headline(total.rate, total.interval)
    facts = [
        (f"{total.first_try} of {total.episodes}", "succeeded at the first try"),
        (f"{total.succeeded} of {total.episodes}", "succeeded with retries"),
    ]
    if results.std is not None:
        seeds = f"over {len(results.by_seed)} seeds"
        facts.append((f"{results.mean:.3f} ± {results.std:.3f}", f"mean and deviation {seeds}"))
    if results.value_median is not None:
        facts.append((figures.format_number(results.value_median), "median value"))
    facts.append((str(asked["matcher"]), "finds the points"))
    if results.seconds_median is not None:
        facts.append((format_duration(results.seconds_median), "median per episode"))
    return f'<div class="summary"><div>{headline}</div>{tiles(facts)}</div>'


def _counts(results: Results) -> str:
    """Lay out the successes by seed and by split."""
    parts = {f"seed {seed}": item for seed, item in results.by_seed.items()}
    parts |= {f"{split} garments": item for split, item in results.by_split.items()}
    columns = {"": "", "episodes": "number", "first try": "number", "with retries": "number"}
    columns["rate"] = "number"
    rows = [_count_row(name, item) for name, item in parts.items()]
    return f"<section><h2>Successes</h2>{table({**columns, '95 % interval': ''}, rows)}</section>"


def _count_row(name: str, item: Count) -> list[str]:
    rate = "" if item.rate is None else f"{item.rate:.3f}"
    low, high = item.interval
    return [
        html.escape(name),
        str(item.episodes),
        str(item.first_try),
        str(item.succeeded),
        rate,
        f"{low:.1%} to {high:.1%}",
    ]


def _pictures(seed: int, shots: Sequence[Shot], *, many: bool) -> str:
    if not shots:
        return ""
    which = f' <span class="quiet">seed {seed}</span>' if many else ""
    return f"<section><h2>When they were judged{which}</h2>{gallery(shots)}</section>"


def _failures(runs: Sequence[Run]) -> list[str]:
    failed = [(run, result) for run in runs for result in run.results if not result.success]
    if not failed:
        return []
    shown = failed[:SHOWN_FAILURES]
    note = "" if len(shown) == len(failed) else f" {len(shown)} of {len(failed)}, see the table"
    cards = [
        attempt_card(
            result,
            {kind: _address(run, result, kind) for kind in ("video", "picture")},
            name=f"s{run.seed}e{result.index}",
            heading=_name(run, result, many=len(runs) > 1),
        )
        for run, result in shown
    ]
    return [f'<h2>Failures<span class="quiet">{note}</span></h2>', *cards]


def _episodes(runs: Sequence[Run]) -> str:
    """Lay out all episodes."""
    columns = {"episode": "", "outcome": "", "garment": "", "split": "", "value": "number"}
    rows = [_episode_row(run, result, many=len(runs) > 1) for run in runs for result in run.results]
    if not rows:
        return ""
    return f"<section><h2>Episodes</h2>{table({**columns, 'time': 'number'}, rows)}</section>"


def _episode_row(run: Run, result: AttemptResult, *, many: bool) -> list[str]:
    name = html.escape(_name(run, result, many=many))
    film = _address(run, result, "video")
    reason = f' <span class="quiet">{html.escape(result.reason or "")}</span>'
    return [
        name if film is None else f'<a href="{film}">{name}</a>',
        outcome_badge(success=result.success) + reason,
        html.escape(result.garment_id or ""),
        html.escape(str(result.randomisation.get("split", ""))),
        "" if result.value is None else figures.format_number(result.value),
        format_duration(result.seconds),
    ]


def _name(run: Run, result: AttemptResult, *, many: bool) -> str:
    return f"Episode {result.index}" + (f" of seed {run.seed}" if many else "")


def _address(run: Run, result: AttemptResult, kind: str) -> str | None:
    """Give the address of an episode's film or picture, relative to the page."""
    if kind not in result.files:
        return None
    return html.escape((run.folder / result.files[kind]).as_posix())
