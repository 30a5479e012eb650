"""Figures as files: one quiet style for all of them."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from dgl_bench.physics.figures import Bars, Chart, ClothView, Figure, Limit, Series
from dgl_bench.physics.rendering import (
    compute_value_limit,
    measure_extent,
    project,
    render,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["FORMAT", "save_figure"]

FORMAT = "png"
TONES = ("#2d7fd1", "#e86b3f", "#2a9d8f", "#8a63c9", "#d99a2b", "#6a6b74")
INK, QUIET, GRID, BAR = "#1c1d22", "#6a6b74", "#e4e2dc", "#b4432f"
STYLE: dict[str, Any] = {
    "font.family": "DejaVu Sans",
    "font.size": 9.0,
    "axes.titlesize": 9.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.titlecolor": INK,
    "axes.titlepad": 9.0,
    "axes.labelcolor": QUIET,
    "axes.edgecolor": QUIET,
    "axes.linewidth": 0.7,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": GRID,
    "grid.linewidth": 0.7,
    "xtick.color": QUIET,
    "ytick.color": QUIET,
    "xtick.labelsize": 8.0,
    "ytick.labelsize": 8.0,
    "legend.frameon": True,
    "legend.framealpha": 0.9,
    "legend.edgecolor": "none",
    "legend.fontsize": 8.0,
    "figure.facecolor": "white",
    "savefig.facecolor": "white",
}
_PANEL_WIDTH, _PANEL_HEIGHT, _DPI = 4.1, 3.1, 110  # inches, and pixels to an inch
_ASPECT = 4 / 3  # width of a picture to its height


def save_figure(figure: Figure, folder: Path) -> Path:
    """Draw a figure into a folder.

    Args:
        figure: What it shows.
        folder: Existing folder.

    Returns:
        The file, named after the figure. Of a palette of 128 colours, so that it stays small.
    """
    import matplotlib as mpl
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure as Canvas
    from PIL import Image

    with mpl.rc_context(STYLE):  # pyright: ignore[reportArgumentType]
        count = len(figure.panels)
        columns = count if count <= 3 else -(-count // (-(-count // 4)))
        rows = -(-count // columns)
        pictures = [panel for panel in figure.panels if isinstance(panel, ClothView)]
        share = 0.72 if len(pictures) == count > 3 else 1.0
        canvas = Canvas(
            figsize=(share * _PANEL_WIDTH * columns, share * _PANEL_HEIGHT * rows),
            dpi=_DPI,
            layout="constrained",
        )
        size = np.zeros(2)
        for picture in pictures:
            low, high = measure_extent(picture)
            size = np.maximum(size, high - low)
        agg = FigureCanvasAgg(canvas)
        axes = canvas.subplots(rows, columns, squeeze=False).ravel()
        for ax in axes[count:]:
            ax.set_axis_off()
        for ax, panel in zip(axes, figure.panels, strict=False):
            ax.set_title(panel.title)
            if isinstance(panel, Chart):
                _draw_chart(ax, panel)
            elif isinstance(panel, Bars):
                _draw_bars(ax, panel)
            else:
                _draw_picture(ax, panel, size)
        agg.draw()
        pixels = np.asarray(agg.buffer_rgba())[:, :, :3]
    path = folder / f"{figure.name}.{FORMAT}"
    image = Image.fromarray(np.ascontiguousarray(pixels)).quantize(128, dither=Image.Dither.NONE)
    image.save(path, optimize=True)
    return path


def _draw_chart(ax: "Axes", chart: Chart) -> None:
    for curve in chart.curves:
        _draw_curve(ax, curve)
    if chart.is_log_x:
        ax.set_xscale("log")
        values = np.unique(np.concatenate([np.asarray(curve.x) for curve in chart.curves]))
        if len(values) < 12 and (values == np.round(values)).all():  # counts
            ax.set_xticks(values, [f"{value:g}" for value in values])
            ax.set_xticks([], minor=True)
    if chart.is_log_y:
        ax.set_yscale("log")
    if chart.y_range is not None:
        ax.set_ylim(*chart.y_range)
    if chart.x_range is not None:
        ax.set_xlim(*chart.x_range)
    _draw_limits(ax, chart.limits)
    ax.set_xlabel(chart.x_label)
    ax.set_ylabel(chart.y_label)
    if any(curve.label for curve in chart.curves):
        ax.legend(loc="best", handlelength=1.6, borderaxespad=0.3, labelcolor=INK)


def _draw_curve(ax: "Axes", curve: Series) -> None:
    colour = TONES[curve.tone % len(TONES)]
    label = curve.label or None
    if curve.kind == "theory":
        ax.plot(curve.x, curve.y, "--", color=QUIET, linewidth=1.3, label=label, zorder=2)
    elif curve.kind == "measured":
        ax.plot(
            curve.x, curve.y, "o", color=colour, markersize=4.5, markeredgecolor="white",
            markeredgewidth=0.6, label=label, zorder=3,
        )  # fmt: skip
    elif curve.kind == "faint":
        ax.plot(curve.x, curve.y, color=colour, linewidth=0.6, alpha=0.35, label=label)
    else:
        ax.plot(curve.x, curve.y, color=colour, linewidth=1.4, label=label)


def _draw_limits(ax: "Axes", limits: Sequence[Limit]) -> None:
    for limit in limits:
        colour = QUIET if limit.is_quiet else BAR
        dashes = {"color": colour, "linewidth": 1.0, "linestyle": (0, (4, 2)), "zorder": 1.5}
        text = {"color": colour, "fontsize": 7.5, "textcoords": "offset points"}
        if limit.is_vertical:
            ax.axvline(limit.value, **dashes)
            at, coordinates = (limit.value, 0.98), ax.get_xaxis_transform()
            text |= {"xytext": (2, 0), "ha": "left", "va": "top", "rotation": 90}
        else:
            ax.axhline(limit.value, **dashes)
            at, coordinates = (0.985, limit.value), ax.get_yaxis_transform()
            text |= {"xytext": (0, 2), "ha": "right", "va": "bottom"}
        ax.annotate(limit.label, at, xycoords=coordinates, **text)


def _draw_bars(ax: "Axes", bars: Bars) -> None:
    y = np.arange(len(bars.labels))[::-1]
    ax.barh(y, bars.values, height=0.62, color=[TONES[k % len(TONES)] for k in range(len(y))])
    ax.set_yticks(y, bars.labels)
    ax.tick_params(axis="y", length=0, labelcolor=INK)
    ax.grid(visible=False, axis="y")
    if bars.expected:
        ax.vlines(bars.expected, y - 0.42, y + 0.42, colors=INK, linewidth=2.0, label="theory")
        ax.legend(loc="lower right")
    if bars.is_log:
        ax.set_xscale("log")
    ax.margins(x=0.18)
    if not bars.is_log:
        ax.set_xlim(left=0)
    ends = np.maximum(bars.values, bars.expected) if bars.expected else bars.values
    for position, value, end in zip(y, bars.values, ends, strict=True):
        ax.annotate(
            f"{value:,.3g}" if abs(value) < 1e3 else f"{value:,.0f}",
            (end, position), xytext=(4, 0), textcoords="offset points", va="center",
            color=INK, fontsize=8,
        )  # fmt: skip
    for limit in bars.limits:
        ax.axvline(limit.value, color=BAR, linewidth=1.0, linestyle=(0, (4, 2)))
        ax.text(
            limit.value, 1.0, f" {limit.label}", color=BAR, fontsize=7.5, va="top",
            transform=ax.get_xaxis_transform(),
        )  # fmt: skip
    ax.set_xlabel(bars.value_label)


def _draw_picture(ax: "Axes", picture: ClothView, size: np.ndarray) -> None:
    """Draw a picture whose width and height [m] hold `size`, which all of a figure share."""
    import matplotlib as mpl
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    colour_map = mpl.colormaps["YlOrRd"]
    low, high = measure_extent(picture)
    centre = (low + high) / 2
    half_width = 0.54 * max(float(size[0]), float(size[1]) * _ASPECT)
    half = (half_width, half_width / _ASPECT)
    image = render(picture, centre=centre, half=half, width=640, colour_map=colour_map)
    extent = (
        centre[0] - half[0], centre[0] + half[0], centre[1] - half[1], centre[1] + half[1],
    )  # fmt: skip
    ax.imshow(image, extent=extent, interpolation="antialiased", interpolation_stage="rgba")
    if picture.marks is not None and len(picture.marks):
        at = project(picture.marks, azimuth=picture.azimuth, elevation=picture.elevation)
        ax.plot(at[:, 0], at[:, 1], "o", mfc="none", mec=BAR, mew=1.2, ms=9)
    ax.set_xlim(extent[0], extent[1])
    ax.set_ylim(extent[2], extent[3])
    ax.set_axis_off()
    _draw_scale(ax)
    if picture.values is not None:
        scale = ScalarMappable(Normalize(0, compute_value_limit(picture)), colour_map)
        bar = ax.get_figure().colorbar(scale, ax=ax, fraction=0.04, pad=0.02, shrink=0.8)  # pyright: ignore[reportOptionalMemberAccess]
        bar.set_label(picture.value_label, color=QUIET)
        bar.outline.set_visible(False)  # pyright: ignore[reportCallIssue]


def _draw_scale(ax: "Axes") -> None:
    """Draw a line of 10 cm, or 5 in small pictures."""
    (left, right), (low, high) = ax.get_xlim(), ax.get_ylim()
    length = 0.1 if right - left > 0.3 else 0.05 if right - left > 0.12 else 0.01
    y = low + 0.01 * (high - low)
    ax.plot([left, left + length], [y, y], color=INK, linewidth=1.6, solid_capstyle="butt")
    ax.text(left, y, f"{100 * length:g} cm", color=QUIET, fontsize=7.5, va="bottom")
