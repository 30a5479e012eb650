"""The report of a collection run: one HTML page that needs nothing but the run's folder."""

import json
import logging
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from dexgarmentlab.reports.attempt import make_card
from dexgarmentlab.reports.figures import file_uri
from dexgarmentlab.reports.page import format_duration, split_words, write_page
from dexgarmentlab.reports.pictures import load_gallery, make_shot
from dgl_collect import CorruptEpisodeError
from dgl_collect.previews import read_previews
from dgl_collect.results import ATTEMPTS_FILE, AttemptResult, read_results
from dgl_collect.run_folder import RUN_FILE, SUMMARY_FILE

__all__ = ["REPORT_FILE", "write_report"]

logger = logging.getLogger(__name__)

REPORT_FILE = "index.html"
SHOWN_EACH = 12
"""Successes, and failures, shown with pictures at most; the table has all attempts."""


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
    commands = json.loads((folder / RUN_FILE).read_text(encoding="utf-8"))["commands"]
    summary = json.loads((folder / SUMMARY_FILE).read_text(encoding="utf-8"))
    results = read_results(folder / ATTEMPTS_FILE)
    shown = _choose_shown(results)

    def find_media(result: AttemptResult, kind: str) -> str | None:
        if kind not in result.files:
            return None
        name = result.files[kind]
        return file_uri(folder / name) if embed_media else name

    shots = []
    if len(results) != 1:
        shots = [
            make_shot(result, folder, link=None if embed_media else result.files.get("video"))
            for result in results
            if "picture" in result.files
        ]
    is_single = len(results) == 1
    return write_page(
        folder / REPORT_FILE,
        "collection.html",
        task=split_words(str(summary["task"])),
        summary=summary,
        facts=_list_facts(summary, results),
        results=results,
        shown={result.index for result in shown},
        shots=load_gallery(shots),
        cards=[_make_card(folder, r, find_media, is_single=is_single) for r in shown],
        commands=[command for command in commands if command],
        versions=summary["versions"],
    )


def _choose_shown(results: Sequence[AttemptResult]) -> list[AttemptResult]:
    """Choose the attempts that are shown with pictures."""
    chosen = [result for result in results if result.success][:SHOWN_EACH]
    chosen += [result for result in results if not result.success][:SHOWN_EACH]
    return sorted(chosen, key=lambda result: result.index)


def _list_facts(summary: Mapping, results: Sequence[AttemptResult]) -> list[tuple[str, str]]:
    attempted, succeeded = summary["attempted"], summary["succeeded"]
    is_single, facts = attempted == 1, []
    if not is_single:
        facts.append((f"{summary['succeeded_first']} of {attempted}", "succeeded at the first try"))
        facts.append((f"{succeeded} of {attempted}", "succeeded with retries"))
    median = summary["seconds_per_attempt"]["median"]
    if median is not None:
        what = "an attempt" if is_single else "median per attempt"
        facts.append((format_duration(median), what))
    if not is_single:
        facts.append((str(len(summary["garments"])), "different garments"))
    facts.append((str(sum(result.frames for result in results)), "recorded frames"))
    return [*facts, (str(summary["seed"]), "seed of the run")]


def _make_card(
    folder: Path,
    result: AttemptResult,
    find_media: Callable[[AttemptResult, str], str | None],
    *,
    is_single: bool,
) -> dict[str, object]:
    stages, fault = (), ""
    if result.success and "episode" in result.files:
        try:
            stages = read_previews(folder / result.files["episode"])
        except (CorruptEpisodeError, FileNotFoundError) as err:
            fault = f"{err}; dgl verify looks at all files"  # the other attempts are worth a page
            logger.warning("%s", fault)
    return make_card(
        result,
        {kind: find_media(result, kind) for kind in ("video", "picture")},
        name=f"a{result.index}",
        heading="" if is_single else f"Attempt {result.index}",
        stages=stages,
        fault=fault,
    )
