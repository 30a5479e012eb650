"""Peirce's cantilever test: whether strips bend under their weight as their fabrics do."""

import numpy as np

from dgl_bench.physics.experiment import Bench, Result
from dgl_bench.physics.figures import Bars, Chart, Figure, Series
from dgl_bench.physics.peirce import PeirceResult, measure_bending_length
from dgl_bench.rows import Reading
from dgl_physics import FABRICS

__all__ = ["compute_elastica", "measure_fabrics"]

ROWS = 4
"""Of triangles that hang over: edges of 8 to 10 mm, somewhat finer than the catalogue's
garments."""


def measure_fabrics(bench: Bench) -> Result:
    """Clamp a strip of each fabric, let it hang over by twice its bending length."""
    del bench
    strips = {name: measure_bending_length(FABRICS[name], rows=ROWS) for name in FABRICS}
    rows = tuple(
        Reading(
            f"bending length of {_spell(name)}, error",
            100 * abs(strip.error),
            "%",
            bar="<= 20",
            note=f"{1e3 * strip.bending_length:.2f} mm for {1e3 * strip.expected:.2f} mm; the "
            "chord is "
            f"{np.degrees(strip.angle):.1f}° below the level",
        )
        for name, strip in strips.items()
    )
    return Result(rows, (_draw(strips),))


def compute_elastica(overhang: float, *, points: int = 101) -> np.ndarray:
    """Compute the shape of an inextensible strip that is clamped level and bends under its weight.

    Its angle t below the level follows B t'' = -w g (L - s) cos t, t(0) = 0, t'(L) = 0; by Newton's
    iteration on second differences, with the weight raised in steps.

    Args:
        overhang: L over the bending length; at most 4.
        points: Along the strip.

    Returns:
        Out and up from the clamp, over the bending length, shape (points, 2).
    """
    n = points - 1
    h, s = 1.0 / n, np.linspace(0.0, 1.0, points)
    weight = overhang**3 * (1.0 - s)
    second = np.diag(np.full(n, -2.0)) + np.diag(np.ones(n - 1), 1) + np.diag(np.ones(n - 1), -1)
    second[-1, -2] = 2.0  # the mirror image beyond the free end, where t' = 0
    second /= h * h
    t = np.zeros(n)
    for share in np.linspace(
        0.05, 1.0, 20
    ):  # little by little, as heavy strips have other shapes too
        load = share * weight[1:]
        for _ in range(6):
            residual = second @ t + load * np.cos(t)
            t -= np.linalg.solve(second - np.diag(load * np.sin(t)), residual)
    middle = 0.5 * (np.concatenate([[0.0], t[:-1]]) + t)
    steps = overhang * h * np.column_stack([np.cos(middle), -np.sin(middle)])
    return np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])


def _draw(strips: dict[str, PeirceResult]) -> Figure:
    shape = compute_elastica(2.0)
    curves = []
    for tone, (name, strip) in enumerate(strips.items()):
        theory = 1e3 * strip.expected * shape
        rows = 1e3 * strip.positions.reshape(ROWS + 3, -1, 3).mean(axis=1)
        curves += [
            Series(theory[:, 0], theory[:, 1], "" if tone else "elastica", kind="theory"),
            Series(rows[:, 1], rows[:, 2], _spell(name), kind="measured", tone=tone),
        ]
    errors = [100 * abs(strip.error) for strip in strips.values()]
    return Figure(
        "fabrics",
        "Strips clamped level at 0 hang over by twice the bending length of their fabric. "
        "Left: rows of "
        "particles against the heavy elastica of that fabric, an inextensible strip that bends "
        "under its weight. "
        "Right: the bending length that the chord from the clamp to the tip stands for; theory is "
        "the cube "
        "root of rigidity over weight. Silk and polyester bend alike.",
        (
            Chart("how the strips hang", "out [mm]", "up [mm]", curves),
            Bars(
                f"at most {max(errors):.1f} % off; the bar is 20 %",
                [_spell(name) for name in strips],
                [1e3 * strip.bending_length for strip in strips.values()],
                "bending length [mm]",
                expected=[1e3 * strip.expected for strip in strips.values()],
            ),
        ),
    )


def _spell(name: str) -> str:
    return name.replace("_", " ")
