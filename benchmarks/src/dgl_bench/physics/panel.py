"""A shirt panel hung by two corners: how far cloth stretches that cannot."""

import time
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from dgl_bench.physics.experiment import Bench, Result
from dgl_bench.physics.figures import Chart, ClothView, Figure, Limit, Series
from dgl_bench.physics.sheets import make_panel
from dgl_bench.rows import Reading
from dgl_physics import ClothMaterial, ModelBuilder, SolverConfig
from dgl_physics.scene import Scene

__all__ = ["HungPanel", "hang_panel", "measure_panel", "summarise_strain"]

WIDTH, LENGTH, EDGE = 0.6, 0.7, 0.013
"""Size [m] and the edge length of the catalogue's garments [m]."""
SWING_FRAMES, REST_FRAMES = 240, 360
REST_DRAG = 2.0


class HungPanel:
    """Mesh of two layers sewn at their sides, upright in x and z, with its fixed corners."""

    def __init__(self, material: ClothMaterial | None = None) -> None:
        """Make the mesh; its layers are apart by the material's thickness."""
        self.material = material or ClothMaterial()
        flat, self.faces, self.rest = make_panel(
            WIDTH, LENGTH, EDGE, gap=1.05 * self.material.thickness
        )
        self.vertices = flat[:, [0, 2, 1]] * [1.0, -1.0, 1.0]
        # a slight wave, so that it can buckle, as real cloth does
        self.vertices[:, 1] += 1e-3 * np.sin(20 * self.vertices[:, 0])
        top = np.flatnonzero(self.vertices[:, 2] > self.vertices[:, 2].max() - 1e-6)
        ends = self.vertices[top, 0]
        self.pinned = (int(top[ends.argmin()]), int(top[ends.argmax()]))


def hang_panel(panel: HungPanel, *, drag: float, config: SolverConfig | None = None) -> Scene:
    """Hang the panel by its two upper corners."""
    builder = ModelBuilder()
    builder.add_garment(
        panel.vertices,
        panel.faces,
        rest=panel.rest,
        pinned=panel.pinned,
        material=replace(panel.material, drag=drag),
    )
    return Scene(builder, config)


def summarise_strain(strain: np.ndarray) -> tuple[float, float]:
    """Mean and 99.9th percentile of the edges' absolute strain [%]."""
    absolute = 100 * np.abs(strain)
    return float(absolute.mean()), float(np.percentile(absolute, 99.9))


def measure_panel(bench: Bench) -> Result:
    """Let the panel fall into its corners and swing; and let it come to rest."""
    del bench
    panel = HungPanel()
    swinging = hang_panel(panel, drag=panel.material.drag)
    seconds, path = [], []
    for _ in range(SWING_FRAMES):
        started = time.process_time()
        swinging.step()
        seconds.append(time.process_time() - started)
        path.append(summarise_strain(swinging.strain()))
    means, tails = np.array(path).T
    resting = hang_panel(panel, drag=REST_DRAG)
    settle = []
    for _ in range(REST_FRAMES):
        resting.step()
        settle.append(summarise_strain(resting.strain()))
    strain = resting.strain()
    mean, tail = summarise_strain(strain)
    frame = 1e3 * float(np.mean(seconds[2:]))
    rows = (
        Reading(
            "hung panel at rest, mean strain",
            mean,
            "%",
            bar="<= 1",
            note=f"{len(panel.vertices)} particles, {WIDTH} m x {LENGTH} m in two layers, 6 s with "
            f"drag {REST_DRAG:g}/s",
        ),
        Reading("hung panel at rest, 99.9th percentile of strain", tail, "%", bar="<= 4"),
        Reading(
            "hung panel while swinging, mean strain",
            float(means.mean()),
            "%",
            bar="<= 1",
            note="average over 4 s at the default drag, from the fall into the corners on",
        ),
        Reading(
            "hung panel while swinging, 99.9th percentile of strain",
            float(tails.mean()),
            "%",
            bar="<= 4",
            note=f"average of the frames' percentiles; the largest is {tails.max():.1f} %",
        ),
        Reading(
            "hung panel, frame",
            frame,
            "ms",
            bar=f"<= {1e3 / 60 / 1.5:.1f}",
            note="mean processor time while swinging; the bar is 1.5 times real time",
        ),
    )
    return Result(rows, tuple(_draw(panel, resting, strain, (means, tails), settle)))


def _draw(
    panel: HungPanel,
    resting: Scene,
    strain: np.ndarray,
    swing: tuple[np.ndarray, np.ndarray],
    settle: list[tuple[float, float]],
) -> Iterator[Figure]:
    mean, tail = summarise_strain(strain)
    absolute = 100 * np.abs(strain)
    x = resting.x
    by_vertex = np.zeros(len(x))
    np.maximum.at(by_vertex, resting.model.garments[0].edges.ravel(), np.repeat(absolute, 2))
    t, rest = np.arange(1, len(swing[0]) + 1) / 60, np.array(settle)
    yield Figure(
        "panel",
        "Two layers of 0.6 m x 0.7 m, sewn along their sides, hang by two particles. Left: "
        "at rest, each face "
        "coloured by the largest strain at its corners. Middle: how many edges are strained by how "
        "much. Right: the "
        "strain while it falls into its corners and swings, and while it comes to rest with more "
        "drag.",
        (
            ClothView(
                "at rest",
                x,
                panel.faces,
                azimuth=-70,
                elevation=10,
                values=by_vertex[panel.faces].max(axis=1),
                value_label="strain [%]",
                value_limit=max(4.0, min(tail, 20.0)),
                marks=x[list(panel.pinned)],
            ),
            Chart(
                f"at rest: mean {mean:.2g} %, 99.9 % below {tail:.3g} %",
                "strain [%]",
                "share of edges strained more",
                (
                    Series(
                        np.maximum(np.sort(absolute), 1e-4),
                        1 - np.arange(len(absolute)) / len(absolute),
                    ),
                ),
                limits=(
                    Limit(4.0, "bar at 1/1000", is_vertical=True),
                    Limit(1e-3, "99.9th percentile", is_quiet=True),
                ),
                is_log_x=True,
                is_log_y=True,
                x_range=(1e-3, max(100.0, 1.5 * float(absolute.max()))),
            ),
            Chart(
                "while it swings and settles",
                "time [s]",
                "strain [%]",
                (
                    Series(t, swing[0], "swinging, mean"),
                    Series(t, swing[1], "swinging, 99.9 %", tone=1),
                    Series(np.arange(1, len(rest) + 1) / 60, rest[:, 0], "settling, mean", tone=2),
                    Series(
                        np.arange(1, len(rest) + 1) / 60, rest[:, 1], "settling, 99.9 %", tone=3
                    ),
                ),
                limits=(
                    Limit(1.0, "bar, mean"),
                    Limit(4.0, "bar, 99.9 %"),
                ),
                is_log_y=True,
            ),
        ),
    )
