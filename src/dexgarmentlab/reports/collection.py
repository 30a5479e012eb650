"""The report of a collection run: one HTML page that needs nothing but the run's folder."""

import html
import json
import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
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
from dexgarmentlab.reports.pictures import gallery, make_shot
from dgl_collect import CorruptEpisodeError
from dgl_collect.previews import read_previews
from dgl_collect.results import ATTEMPTS_FILE, AttemptResult, read_results
from dgl_collect.run_folder import RUN_FILE, SUMMARY_FILE
from dgl_files.whole import written_beside

__all__ = ["REPORT_FILE", "write_report"]

logger = logging.getLogger(__name__)

REPORT_FILE = "index.html"
SHOWN_EACH = 12
"""Successes, and failures, shown with pictures at most; the table has all attempts."""


@dataclass(frozen=True, kw_only=True)
class _Run:
    folder: Path
    commands: Sequence[str]
    summary: Mapping
    results: Sequence[AttemptResult]
    is_embedding: bool

    def media(self, result: AttemptResult, kind: str) -> str | None:
        """Give the address of an attempt's film or picture, if it has one."""
        if kind not in result.files:
            return None
        name = result.files[kind]
        return figures.file_uri(self.folder / name) if self.is_embedding else html.escape(name)


def write_report(out_dir: Path | str, *, embed_media: bool = False) -> Path:
    """Write the report of a run, replacing an older one.

    Args:
        out_dir: A run's folder, as `dgl collect` writes it.
        embed_media: Put films and pictures into the page, so that it can be sent as one file;
            otherwise it refers to those beside it.

    Returns:
        The page, `index.html` in the folder.

    Raises:
        FileNotFoundError: If the folder holds no run.
    """
    folder = Path(out_dir)
    for name in (RUN_FILE, SUMMARY_FILE):
        if not (folder / name).is_file():
            raise FileNotFoundError(f"{folder} holds no run to report ({name} is missing)")
    run = _Run(
        folder=folder,
        commands=json.loads((folder / RUN_FILE).read_text(encoding="utf-8"))["commands"],
        summary=json.loads((folder / SUMMARY_FILE).read_text(encoding="utf-8")),
        results=read_results(folder / ATTEMPTS_FILE),
        is_embedding=embed_media,
    )
    path = folder / REPORT_FILE
    with written_beside(path) as partial:
        partial.write_text(_page(run), encoding="utf-8")
    return path


def _page(run: _Run) -> str:
    summary = run.summary
    is_single = len(run.results) == 1
    body = [
        resume_notice(summary["status"], summary["attempted"], summary["requested"], "attempts")
    ]
    if not is_single:
        body += [reason_bars("Why attempts failed", summary["reasons"]), *_overview(run)]
    shown = _shown(run.results)
    if shown and not is_single:
        note = "" if len(shown) == len(run.results) else f" of {len(run.results)}, see the table"
        body.append(f'<h2>In detail <span class="quiet">{len(shown)}{note}</span></h2>')
    body += [_detail(run, result, is_single=is_single) for result in shown]
    body.append(provenance(run.commands, summary["versions"]))
    title = split_words(str(summary["task"]))
    return make_page(title, overline="collected demonstrations", header=_header(run), body=body)


def _shown(results: Sequence[AttemptResult]) -> list[AttemptResult]:
    """Choose the attempts that are shown with pictures."""
    chosen = [result for result in results if result.success][:SHOWN_EACH]
    chosen += [result for result in results if not result.success][:SHOWN_EACH]
    return sorted(chosen, key=lambda result: result.index)


def _header(run: _Run) -> str:
    summary = run.summary
    attempted, succeeded = summary["attempted"], summary["succeeded"]
    if attempted == 0:
        headline = '<p class="headline">No attempts yet</p>'
    elif attempted == 1:
        word = "Success" if succeeded else "Failed"
        headline = f'<p class="headline {"good" if succeeded else "bad"}">{word}</p>'
    else:
        headline = rate_headline(succeeded / attempted, summary["success_interval"])
    facts = []
    if attempted != 1:
        facts.append((f"{summary['succeeded_first']} of {attempted}", "succeeded at the first try"))
        facts.append((f"{succeeded} of {attempted}", "succeeded with retries"))
    median = summary["seconds_per_attempt"]["median"]
    if median is not None:
        what = "an attempt" if attempted == 1 else "median per attempt"
        facts.append((format_duration(median), what))
    if attempted != 1:
        facts.append((str(len(summary["garments"])), "different garments"))
    facts.append((str(sum(result.frames for result in run.results)), "recorded frames"))
    facts.append((str(summary["seed"]), "seed of the run"))
    return f'<div class="summary"><div>{headline}</div>{tiles(facts)}</div>'


def _overview(run: _Run) -> list[str]:
    """Show the final pictures of all attempts, and their table."""
    if not run.results:
        return []
    shots = [
        make_shot(result, run.folder, link=None if run.is_embedding else result.files.get("video"))
        for result in run.results
        if "picture" in result.files
    ]
    pictures = f"<section><h2>When they were judged</h2>{gallery(shots)}</section>" if shots else ""
    shown = {result.index for result in _shown(run.results)}
    columns = {"#": "", "outcome": "", "garment": "", "value": "number", "frames": "number"}
    rows = [_row(result, is_shown=result.index in shown) for result in run.results]
    attempts = table({**columns, "time": "number", "seed": ""}, rows)
    return [pictures, f"<section><h2>Attempts</h2>{attempts}</section>"]


def _row(result: AttemptResult, *, is_shown: bool) -> list[str]:
    number = f'<a href="#a{result.index}">{result.index}</a>' if is_shown else str(result.index)
    reason = f' <span class="quiet">{html.escape(result.reason or "")}</span>'
    return [
        number,
        outcome_badge(success=result.success) + reason,
        html.escape(result.garment_id or ""),
        "" if result.value is None else figures.format_number(result.value),
        str(result.frames) if result.frames else "",
        format_duration(result.seconds),
        f'<span class="quiet">{result.seed}</span>',
    ]


def _detail(run: _Run, result: AttemptResult, *, is_single: bool) -> str:
    stages, fault = (), ""
    if result.success and "episode" in result.files:
        try:
            stages = read_previews(run.folder / result.files["episode"])
        except (CorruptEpisodeError, FileNotFoundError) as err:
            fault = f"{err}; dgl verify looks at all files"  # the other attempts are worth a page
            logger.warning("%s", fault)
    heading = "" if is_single else f"Attempt {result.index}"
    media = {kind: run.media(result, kind) for kind in ("video", "picture")}
    return attempt_card(
        result, media, heading=heading, name=f"a{result.index}", stages=stages, fault=fault
    )
