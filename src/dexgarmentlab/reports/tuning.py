"""The page of a search: its curve, what each parameter matters, and the judgement."""

import base64
import io
from pathlib import Path
from typing import TYPE_CHECKING

from dexgarmentlab.reports.page import split_words, write_page
from dexgarmentlab.reports.pictures import load_gallery, make_shot
from dgl_collect.results import ATTEMPTS_FILE, read_results
from dgl_collect.run_folder import read_run

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from dgl_collect.tuning.search import Tuning

__all__ = ["write_report"]


def write_report(folder: Path, task: str, tuning: "Tuning") -> Path:
    """Write the page of a search, `index.html`, replacing an older one.

    Args:
        folder: Folder of the search.
        task: Environment id.
        tuning: What it has found.

    Raises:
        OSError: If a picture cannot be read.
    """
    results = [r for r in read_results(folder / ATTEMPTS_FILE) if "picture" in r.files]
    before, after = (
        load_gallery([make_shot(result, folder) for result in results[k::2]]) for k in (0, 1)
    )
    record = read_run(folder)
    response = tuning.response
    rows = [
        (name, tuning.before[name], tuning.after[name], t, gain)
        for name, t, gain in zip(tuning.names, response.t_values, response.gains, strict=True)
    ]
    return write_page(
        folder / "index.html",
        "tuning.html",
        task=split_words(task),
        tuning=tuning,
        rows=rows,
        curve=_to_uri(_draw_curve(tuning)),
        before=before,
        after=after,
        commands=record.commands,
        versions=record.versions,
    )


def _draw_curve(tuning: "Tuning") -> "Figure":
    """Draw the scores of the generations, and the parameters' weights."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9, 3.2), layout="constrained")
    curve, weights = figure.subplots(1, 2)
    numbers = range(1, len(tuning.generations) + 1)
    for name, label, style in (
        ("best", "best candidate", ":"),
        ("mean", "mean of the candidates", "-"),
        ("baseline", "demonstration", "--"),
    ):
        values = [getattr(each, name) for each in tuning.generations]
        curve.plot(numbers, values, style, marker="o", markersize=3, label=label)
    curve.set(xlabel="generation", ylabel="score on its first two starts", ylim=(0, 1))
    curve.xaxis.get_major_locator().set_params(integer=True)
    curve.legend(frameon=False)
    order = sorted(range(len(tuning.names)), key=lambda k: abs(tuning.response.t_values[k]))
    weights.barh([tuning.names[k] for k in order], [tuning.response.t_values[k] for k in order])
    weights.axvline(0, color="0.4", linewidth=0.8)
    weights.set(xlabel="slope of the score, in standard errors")
    return figure


def _to_uri(figure: "Figure") -> str:
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=140)
    return f"data:image/png;base64,{base64.b64encode(buffer.getvalue()).decode()}"
