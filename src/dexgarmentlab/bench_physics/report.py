"""The report of a run: one page, and its figures beside it."""

import html
import json
from collections.abc import Sequence
from datetime import date
from importlib import metadata, resources
from pathlib import Path

from dexgarmentlab.bench_physics.drawing import save_figure
from dexgarmentlab.bench_physics.experiment import Experiment, Result
from dexgarmentlab.bench_physics.rows import Row

__all__ = ["REPORT_FILE", "ROWS_FILE", "format_value", "write_report"]

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
    from dgl_collect.files import written_beside

    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    sections = []
    for experiment, result, seconds in results:
        files = [(figure, save_figure(figure, folder)) for figure in result.figures]
        figures = "".join(
            f'<figure><img src="{html.escape(path.name)}" alt="{html.escape(figure.caption)}" loading="lazy">'
            f"<figcaption>{html.escape(figure.caption)}</figcaption></figure>"
            for figure, path in files
        )
        sections.append(
            f'<article id="{experiment.name}"><h3>{html.escape(experiment.title)}</h3>'
            f'<p class="quiet">{html.escape(experiment.about)} It took {seconds:.0f} s.</p>'
            f"{_table(result.rows)}{figures}</article>"
        )
    rows = [row for _, result, _ in results for row in result.rows]
    content = json.dumps([row.to_dict() for row in rows], indent=2, allow_nan=False)
    for name, text in ((ROWS_FILE, content), (REPORT_FILE, _page(rows, sections, command))):
        with written_beside(folder / name) as partial:
            partial.write_text(text, encoding="utf-8")
    return folder / REPORT_FILE


def format_value(value: float | None) -> str:
    """Write a value with three significant digits."""
    if value is None:
        return "-"
    return f"{value:.3g}" if abs(value) < 1e3 else f"{value:,.0f}"


def _page(rows: Sequence[Row], sections: Sequence[str], command: str) -> str:
    style = resources.files("dexgarmentlab").joinpath("report.css").read_text(encoding="utf-8")
    style += (
        "figure { margin-top: 22px; } figure img { background: #fff; max-width: max-content; }\n"
    )
    style += "td.note { white-space: normal; min-width: 240px; }\n"
    judged = [row.ok for row in rows if row.ok is not None]
    skipped = sum(row.is_skipped for row in rows)
    tiles = [(f"{sum(judged)} of {len(judged)}", "bars met"), (str(len(rows)), "rows")]
    tiles += [(str(skipped), "skipped on this machine"), (date.today().isoformat(), "measured")]
    items = "".join(f"<li><b>{value}</b>{label}</li>" for value, label in tiles)
    versions = "".join(
        f"<dt>{name}</dt><dd>{html.escape(_find_version(name))}</dd>" for name in _PACKAGES
    )
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        '<meta name="color-scheme" content="light dark">\n'
        f"<title>Physics · dexgarmentlab</title>\n<style>\n{style}</style>\n</head>\n<body>\n<main>\n"
        '<header><p class="overline">dexgarmentlab · validation of dgl-physics</p><h1>Physics</h1>'
        f'<ul class="tiles">{items}</ul></header>\n{chr(10).join(sections)}\n'
        f"<footer><h2>How this was made</h2><pre><code>{html.escape(command)}</code></pre>"
        f'<dl class="versions">{versions}</dl></footer>\n</main>\n</body>\n</html>\n'
    )


def _table(rows: Sequence[Row]) -> str:
    lines = "".join(
        f'<tr><td>{html.escape(row.name)}</td><td class="number">{format_value(row.value)} '
        f"{html.escape(row.unit)}</td><td>{html.escape(row.bar)}</td><td>{_badge(row)}</td>"
        f'<td class="quiet note">{html.escape(row.note)}</td></tr>'
        for row in rows
    )
    return (
        '<div class="scroll"><table><thead><tr><th>measure</th><th class="number">value</th>'
        f"<th>bar</th><th></th><th>how</th></tr></thead><tbody>{lines}</tbody></table></div>"
    )


def _badge(row: Row) -> str:
    if row.is_skipped:
        return '<span class="badge quiet">skipped</span>'
    if row.ok is None:
        return ""
    word, kind = _MARKS[row.ok]
    return f'<span class="badge {kind}">{word}</span>'


def _find_version(package: str) -> str:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return "not installed"
