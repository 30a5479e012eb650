"""A picture of matches: both clouds with the matched points, and where one of them fits."""

from pathlib import Path

import numpy as np

from dexgarmentlab.gam.clouds import Cloud
from dgl_files.whole import written_beside
from dgl_gam import Matches, compute_affordance

__all__ = ["draw_matches"]

_HEIGHT = 4.2  # of the picture [inch]


def draw_matches(
    path: Path, source: Cloud, points: np.ndarray, target: Cloud, matches: Matches, *, heat: int
) -> None:
    """Draw the source's points, their matches and one affordance, seen from above.

    Args:
        path: Picture to write, PNG: beside its place, then renamed.
        source: The demonstrated garment.
        points: Points on it, shape (K, 3) [m].
        target: The observed garment.
        matches: Where they were found.
        heat: Which point's affordance is drawn.
    """
    import matplotlib as mpl
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(3.2 * _HEIGHT, _HEIGHT), dpi=110, layout="constrained")
    panels = figure.subplots(1, 3)
    colors = mpl.colormaps["turbo"](np.linspace(0.05, 0.95, max(1, len(points))))
    places = (points, matches.points)
    for panel, cloud, marks in zip(panels, (source, target), places, strict=False):
        panel.scatter(*cloud.points[:, :2].T, s=2, c="#b8bec6", linewidths=0)
        panel.scatter(*marks[:, :2].T, s=46, c=colors, edgecolors="black", linewidths=0.6, zorder=3)
        for number, mark in enumerate(marks):
            panel.annotate(
                str(number), mark[:2], xytext=(5, 4), textcoords="offset points", fontsize=8
            )
    panels[0].set_title(source.name)
    panels[1].set_title(f"found on {target.name}")
    shown = panels[2].scatter(
        *target.points[:, :2].T,
        s=4,
        c=compute_affordance(matches.similarity)[:, heat],
        cmap="viridis",
        linewidths=0,
    )
    panels[2].set_title(f"affordance of point {heat}, confidence {matches.confidence[heat]:.2f}")
    figure.colorbar(shown, ax=panels[2], shrink=0.8)
    for panel in panels:
        panel.set_aspect("equal")
        panel.set_axis_off()
    with written_beside(path) as partial:
        FigureCanvasAgg(figure).print_png(str(partial))
