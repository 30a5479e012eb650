"""The report of a run: one page with the table, the failures, and what the garments look like."""

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from dexgarmentlab.reports.page import write_page
from dgl_assets import list_categories, load_garment, save_picture
from dgl_bench.assets.attempts import Attempt, find_positions
from dgl_bench.assets.rows import group, summarise
from dgl_bench.assets.run import load_run
from dgl_bench.assets.sheets import COLUMNS, draw_sheet, load_dropped
from dgl_bench.rows import Reading
from dgl_files.whole import written_beside

__all__ = ["PICTURES", "REPORT_FILE", "TABLE_FILE", "count_pictures", "make_table", "write_report"]

REPORT_FILE, TABLE_FILE, PICTURES = "report.html", "table.md", "pictures"
SHOWN, WORST = 2 * COLUMNS, COLUMNS
"""Garments of a category that are shown before and after, and those that were strained most."""

_COLUMNS: tuple[tuple[str, Callable[[Mapping[str, Reading]], str]], ...] = (
    ("garments", lambda r: _write(r, "garments")),
    ("whole", lambda r: f"{_write(r, 'whole', digits=1)} %"),
    ("errors", lambda r: _write(r, "errors")),
    ("mean strain, median / worst [%]", lambda r: _pair(r, "strain_median", "strain_worst", 2)),
    ("one edge at the end, at most [%]", lambda r: _write(r, "edge_change", digits=0)),
    ("at rest", lambda r: f"{_write(r, 'at_rest', digits=1)} %"),
    ("layers crossed", lambda r: _write(r, "crossings")),
    ("edges 8 to 18 mm, all / least [%]", lambda r: _pair(r, "edges", "edges_least", 2)),
    ("angles of 20° or more, all / least [%]", lambda r: _pair(r, "angles", "angles_least", 2)),
    ("particles", lambda r: _pair(r, "particles_least", "particles_most", 0, " to ")),
    ("landmarks [edges]", lambda r: _write(r, "landmarks", digits=2)),
    ("build, median / longest [s]", lambda r: _pair(r, "build", "build_longest", 2)),
)


def write_report(folder: Path | str, *, on_picture: Callable[[], None] = lambda: None) -> Path:
    """Write the page, its pictures and the table, of a run that is finished or not.

    Args:
        folder: Of the run. Files of the same names are replaced.
        on_picture: Called after each of `count_pictures` pictures.

    Returns:
        The page, `report.html`, which needs nothing but the folder.

    Raises:
        ValueError: If the folder holds no run.
    """
    folder = Path(folder)
    content, attempts = load_run(folder)
    with written_beside(folder / TABLE_FILE) as partial:
        partial.write_text(make_table(attempts), encoding="utf-8")
    broken = [attempt for attempt in attempts if not attempt.is_whole]
    crossed = [attempt for attempt in attempts if attempt.crossings_end]
    moving = [a for a in attempts if not a.error and a.still_seconds is None]
    return write_page(
        folder / REPORT_FILE,
        "assets.html",
        package="dgl_bench",
        facts=[
            (f"{len(attempts) - len(broken):,} of {len(attempts):,}", "garments stay whole"),
            (f"{len(attempts):,} of {int(content['count']):,}", "garments dropped"),
            (f"{sum(bool(a.error) for a in attempts)}", "errors"),
            (f"{content['frames'] / 60:g} s", "each, simulated"),
        ],
        rows=summarise("all", attempts),
        columns=[(title, "number") for title, _ in _COLUMNS],
        table=_cells(attempts),
        lists=[
            _list("Not whole", broken, lambda a: "; ".join(a.faults)),
            _list("Layers crossed at the end", crossed, _describe_crossings),
            _list("Still moving at the end", moving, _describe_motion),
        ],
        categories=[
            (name, _draw(folder, name, own, on_picture))
            for name, own in _in_order(attempts).items()
        ],
        commands=content["commands"],
        versions=content["versions"],
    )


def count_pictures(attempts: Sequence[Attempt]) -> int:
    """Count the pictures of a report."""
    return 3 * len(group(attempts))


def make_table(attempts: Sequence[Attempt]) -> str:
    """Make the table of the categories, and all of them, in Markdown."""
    lines = [
        "| category | " + " | ".join(title for title, _ in _COLUMNS) + " |",
        "|---|" + "--:|" * len(_COLUMNS),
    ]
    lines += [f"| {' | '.join(cells)} |" for cells in _cells(attempts)]
    return "\n".join(lines) + "\n"


def _cells(attempts: Sequence[Attempt]) -> list[list[str]]:
    """Name and figures of each category, and of all."""
    parts = dict(_in_order(attempts))
    if len(parts) != 1:
        parts["all"] = list(attempts)
    table = []
    for name, own in parts.items():
        rows = {row.name.partition(".")[2]: row for row in summarise(name, own)}
        table.append([name, *(write(rows) for _, write in _COLUMNS)])
    return table


def _in_order(attempts: Sequence[Attempt]) -> dict[str, list[Attempt]]:
    """Sort by category, in the catalogue's order."""
    found = group(attempts)
    return {name: found[name] for name in list_categories() if name in found}


def _draw(
    folder: Path, name: str, own: Sequence[Attempt], on_picture: Callable[[], None]
) -> list[tuple[str, str]]:
    """Draw a category, whose attempts come with the worst first; return files and captions."""
    drawn = [attempt for attempt in own if find_positions(folder, attempt.id).is_file()]
    if not drawn:
        return []
    # those in the order of their ids are as good as drawn at random: an id is a seed
    sample = sorted(drawn, key=lambda attempt: attempt.id)
    sample = [
        sample[k * len(sample) // min(SHOWN, len(sample))] for k in range(min(SHOWN, len(sample)))
    ]
    numbers = [attempt.id.partition("/")[2] for attempt in sample]
    worst = drawn[:WORST]
    pictures = (
        ("made", [load_garment(a.id) for a in sample], numbers, "As they are made"),
        ("dropped", [load_dropped(folder, a) for a in sample], numbers, "As they came to lie"),
        (
            "strained",
            [load_dropped(folder, a) for a in worst],
            [f"{a.id.partition('/')[2]}: {100 * (a.strain_worst or 0):.2f} %" for a in worst],
            "Those that were strained most, as they came to lie, with their mean strain in the "
            "worst frame",
        ),
    )
    files = []
    for kind, garments, labels, caption in pictures:
        path = folder / PICTURES / f"{name}-{kind}.png"
        save_picture(draw_sheet(garments, labels), path)
        on_picture()
        files.append((f"{PICTURES}/{path.name}", caption))
    return files


def _list(
    title: str, attempts: Sequence[Attempt], describe: Callable[[Attempt], str]
) -> tuple[str, list[tuple[str, str]]]:
    return title, [(a.id, describe(a)) for a in sorted(attempts, key=lambda a: a.id)]


def _describe_crossings(attempt: Attempt) -> str:
    return f"{attempt.crossings_end} edges pierce a triangle; {attempt.crossings_start} as made"


def _describe_motion(attempt: Attempt) -> str:
    return f"{1000 * (attempt.speed or 0.0):.1f} mm/s, root mean square"


def _write(rows: Mapping[str, Reading], name: str, *, digits: int = 0) -> str:
    """Write a value; a share that is not quite all is not rounded up to 100."""
    value = rows[name].value
    if value is None:
        return "-"
    if rows[name].unit == "%" and 99 < value < 100:
        value = math.floor(value * 10**digits) / 10**digits
    return f"{value:,.{digits}f}"


def _pair(
    rows: Mapping[str, Reading], first: str, second: str, digits: int, between: str = " / "
) -> str:
    return f"{_write(rows, first, digits=digits)}{between}{_write(rows, second, digits=digits)}"
