"""Elastic solids: the modulus that a bar in tension shows, and a hat that springs back."""

from dataclasses import dataclass

import numpy as np

from dgl_bench.physics.experiment import Bench, Result
from dgl_bench.physics.figures import Bars, Chart, ClothView, Figure, Series
from dgl_bench.physics.hat import measure_hat
from dgl_bench.physics.sheets import make_box
from dgl_bench.rows import Reading
from dgl_physics import ModelBuilder, SolidMaterial, SolverConfig
from dgl_physics.lattice import fill_closed_surface
from dgl_physics.scene import Scene
from dgl_physics.tetrahedra import compute_surface

__all__ = ["Tension", "measure_solids", "stretch_bar"]

CELL = 0.0125
"""Length of the lattice's cubes [m]."""
WIDE, LONG = 2, 14
"""Cubes across and along the bar."""
LARGEST_STRAIN = 0.02
"""At the clamp, where the weight of all of it pulls."""
CASES = ((1e5, 0.0), (1e6, 0.0), (1e8, 0.0), (1e6, 0.3))
"""Young's moduli [Pa] and Poisson's ratios."""


@dataclass(frozen=True, kw_only=True)
class Tension:
    """Measures of a bar that hangs by one end, at its cuts from the lowest to the highest."""

    material: SolidMaterial
    stress: np.ndarray
    """Weight below the cut over the unstrained cross-section [Pa], shape (N,)."""
    strain: np.ndarray
    """Of the layer of cubes that is cut, shape (N,)."""
    vertices: np.ndarray
    """Of its surface at rest [m], shape (V, 3)."""
    faces: np.ndarray
    """Shape (F, 3)."""

    @property
    def modulus(self) -> float:
        """Slope of stress over strain through the origin [Pa], away from the ends by a width."""
        away = slice(WIDE, len(self.strain) - WIDE)
        return float(
            self.stress[away] @ self.strain[away] / (self.strain[away] @ self.strain[away])
        )

    @property
    def error(self) -> float:
        """Relative error of the modulus."""
        return self.modulus / self.material.youngs_modulus - 1.0


def stretch_bar(modulus: float, ratio: float, *, frames: int = 180) -> Tension:
    """Hang a bar by one end in a field so strong that its weight stretches it by 2 % there.

    Every horizontal cut carries the weight below it, which makes each a test in tension of its own,
    with a force that is known whatever the solver does.

    Args:
        modulus: Young's modulus [Pa].
        ratio: Poisson's ratio.
        frames: Until it hangs still.
    """
    size = (WIDE * CELL, WIDE * CELL, LONG * CELL)
    vertices, tets, _ = fill_closed_surface(*make_box(size), LONG)
    layers = np.round((vertices[:, 2] - vertices[:, 2].min()) / CELL).astype(int)
    material = SolidMaterial(
        youngs_modulus=modulus, poisson_ratio=ratio, adhesion=0.0, drag=2.0, damping=0.01
    )
    builder = ModelBuilder()
    builder.add_tetrahedra(vertices, tets, material=material, pinned=np.flatnonzero(layers == LONG))
    field = LARGEST_STRAIN * modulus / (material.density * size[2])
    scene = Scene(builder, SolverConfig(gravity=(0.0, 0.0, -field)))
    scene.step(frames)
    x = scene.x
    heights = np.array([x[layers == k, 2].mean() for k in range(LONG + 1)])
    masses = np.array([scene.mass[layers == k].sum() for k in range(LONG)])
    return Tension(
        material=material,
        stress=field * np.cumsum(masses) / (size[0] * size[1]),
        strain=np.diff(heights) / CELL - 1.0,
        vertices=x,
        faces=compute_surface(tets),
    )


def measure_solids(bench: Bench) -> Result:
    """Hang bars; squeeze a bowl hat onto a head and let go."""
    hat = measure_hat(bench)
    bars = [stretch_bar(modulus, ratio) for modulus, ratio in CASES]
    rows = tuple(
        Reading(
            f"bar in tension, E = {_spell(bar)}, error of E",
            100 * abs(bar.error),
            "%",
            bar="<= 5",
            note=f"measured {bar.modulus:.4g} Pa, strains up to {100 * bar.strain.max():.1f} %",
        )
        for bar in bars
    )
    return Result((*rows, *hat.rows), (_draw(bars), *hat.figures))


def _draw(bars: list[Tension]) -> Figure:
    first = bars[0]
    low, high = first.vertices[:, 2].min(), first.vertices[:, 2].max()
    share = (first.vertices[first.faces][:, :, 2].mean(axis=1) - low) / (high - low)
    cut = np.clip((share * LONG).astype(int), 0, LONG - 1)
    errors = [100 * abs(bar.error) for bar in bars]
    lowest, highest = min(bar.stress[0] for bar in bars), max(bar.stress[-1] for bar in bars)
    theory = 100 * np.array([0.5 * first.strain.min(), LARGEST_STRAIN])
    curves = []
    for tone, bar in enumerate(bars):
        line = theory / 100 * bar.material.youngs_modulus
        curves += [
            Series(theory, line, "" if tone else "F/A = E ε", kind="theory"),
            Series(100 * bar.strain, bar.stress, f"E = {_spell(bar)}", kind="measured", tone=tone),
        ]
    return Figure(
        "tension",
        "A bar hangs by its upper end, so that each cut carries the weight below it. Left: "
        "the bar, coloured "
        "by the strain of its layers. Middle: force over cross-section against strain, at every "
        "cut. Right: the "
        "error of the slope, away from the ends by a width.",
        (
            ClothView(
                f"E = {_spell(first)}",
                first.vertices,
                first.faces,
                elevation=15,
                values=100 * first.strain[cut],
                value_label="strain [%]",
                value_limit=100 * LARGEST_STRAIN,
            ),
            Chart(
                "stress over strain",
                "strain ε [%]",
                "F/A [Pa]",
                curves,
                is_log_x=True,
                is_log_y=True,
                y_range=(0.3 * lowest, 200 * highest),
            ),
            Bars(
                f"at most {max(errors):.2g} % off; the bar is 5 %",
                [_spell(bar) for bar in bars],
                errors,
                "error of E [%]",
            ),
        ),
    )


def _spell(bar: Tension) -> str:
    ratio = bar.material.poisson_ratio
    return f"{bar.material.youngs_modulus / 1e6:g} MPa" + (f", Poisson {ratio:g}" if ratio else "")
