"""The report of `dgl bench physics`: one page, and its figures beside it."""

import json
from collections.abc import Sequence
from datetime import date
from importlib import metadata
from pathlib import Path

from dexgarmentlab.reports.page import write_page
from dgl_bench.physics.drawing import save_figure
from dgl_bench.physics.experiment import Experiment, Result
from dgl_files.whole import written_beside

__all__ = ["REPORT_FILE", "ROWS_FILE", "write_report"]

REPORT_FILE = "index.html"
ROWS_FILE = "rows.json"
_PACKAGES = ("dgl-physics", "dgl-tasks", "warp-lang", "numpy", "sapien", "mani-skill")


def write_report(
    folder: Path | str, results: Sequence[tuple[Experiment, Result, float]], *, command: str
) -> Path:
    """Write the page, its figures and the rows.

    Args:
        folder: Made when it is missing. Files of the same names are replaced.
        results: Experiments with their results and times [s].
        command: Command that makes it again.

    Returns:
        The page, `index.html`, which needs nothing but the folder.
    """
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    experiments = [
        (
            experiment,
            result.rows,
            seconds,
            [(save_figure(figure, folder).name, figure.caption) for figure in result.figures],
        )
        for experiment, result, seconds in results
    ]
    rows = [row for _, result, _ in results for row in result.rows]
    content = json.dumps([row.to_dict() for row in rows], indent=2, allow_nan=False)
    with written_beside(folder / ROWS_FILE) as partial:
        partial.write_text(content, encoding="utf-8")
    judged = [row.ok for row in rows if row.ok is not None]
    skipped = sum(row.is_skipped for row in rows)
    return write_page(
        folder / REPORT_FILE,
        "physics.html",
        package="dgl_bench",
        facts=[
            (f"{sum(judged)} of {len(judged)}", "bars met"),
            (str(len(rows)), "rows"),
            (str(skipped), "skipped on this machine"),
            (date.today().isoformat(), "measured"),
        ],
        experiments=experiments,
        commands=[command],
        versions={name: _find_version(name) for name in _PACKAGES},
    )


def _find_version(package: str) -> str:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return "not installed"
