"""The report of `dgl bench physics`: one page, and its figures beside it."""

import html
import json
from collections.abc import Sequence
from datetime import date
from importlib import metadata
from pathlib import Path

from dexgarmentlab.reports.page import badge, figure, make_page, provenance, table, tiles
from dgl_bench.physics.drawing import save_figure
from dgl_bench.physics.experiment import Experiment, Result
from dgl_bench.rows import Row, format_value

__all__ = ["REPORT_FILE", "ROWS_FILE", "write_report"]

REPORT_FILE = "index.html"
ROWS_FILE = "rows.json"
_PACKAGES = ("dgl-physics", "dgl-tasks", "warp-lang", "numpy", "sapien", "mani-skill")
_MARKS = {True: ("met", "good"), False: ("not met", "bad")}


def write_report(
    folder: Path | str, results: Sequence[tuple[Experiment, Result, float]], *, command: str
) -> Path:
    """Write the page, its figures and the rows.

    Args:
        folder: Made when it is missing. Files of the same names are replaced.
        results: Experiments with what they found and how long they took [s].
        command: How to make it again.

    Returns:
        The page, `index.html`, which needs nothing but the folder.
    """
    # Not above: it brings the simulator, which rows alone do not need.
    from dgl_files.whole import written_beside

    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    sections = []
    for experiment, result, seconds in results:
        files = [(shown, save_figure(shown, folder)) for shown in result.figures]
        drawn = "".join(figure(path.name, shown.caption) for shown, path in files)
        sections.append(
            f'<article id="{experiment.name}"><h3>{html.escape(experiment.title)}</h3>'
            f'<p class="quiet">{html.escape(experiment.about)} It took {seconds:.0f} s.</p>'
            f"{_table(result.rows)}{drawn}</article>"
        )
    rows = [row for _, result, _ in results for row in result.rows]
    content = json.dumps([row.to_dict() for row in rows], indent=2, allow_nan=False)
    for name, text in ((ROWS_FILE, content), (REPORT_FILE, _page(rows, sections, command))):
        with written_beside(folder / name) as partial:
            partial.write_text(text, encoding="utf-8")
    return folder / REPORT_FILE


def _page(rows: Sequence[Row], sections: Sequence[str], command: str) -> str:
    judged = [row.ok for row in rows if row.ok is not None]
    skipped = sum(row.is_skipped for row in rows)
    facts = [(f"{sum(judged)} of {len(judged)}", "bars met"), (str(len(rows)), "rows")]
    facts += [(str(skipped), "skipped on this machine"), (date.today().isoformat(), "measured")]
    versions = {name: _find_version(name) for name in _PACKAGES}
    return make_page(
        "Physics",
        overline="validation of dgl-physics",
        header=tiles(facts),
        body=[*sections, provenance([command], versions)],
    )


def _table(rows: Sequence[Row]) -> str:
    columns = {"measure": "", "value": "number", "bar": "", "": "", "how": "note"}
    return table(columns, [_cells(row) for row in rows])


def _cells(row: Row) -> list[str]:
    return [
        html.escape(row.name),
        f"{format_value(row.value)} {html.escape(row.unit)}",
        html.escape(row.bar),
        _badge(row),
        f'<span class="quiet">{html.escape(row.note)}</span>',
    ]


def _badge(row: Row) -> str:
    if row.is_skipped:
        return badge("skipped", "quiet")
    return "" if row.ok is None else badge(*_MARKS[row.ok])


def _find_version(package: str) -> str:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return "not installed"
