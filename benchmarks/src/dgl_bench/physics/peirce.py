"""Peirce's cantilever test: bending length of a simulated strip, against the fabric's.

A strip is clamped level and hangs over an edge. In the laboratory it is advanced until the chord
from the edge to its tip is 41.5 degrees below the level; the overhang is then twice the bending
length (ASTM D1388). Here the overhang is chosen, and the bending length follows from the angle of
the chord by the theory of the heavy elastica, which gives 41.49 degrees at that overhang.
"""

from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from dgl_physics.material import ClothMaterial
from dgl_physics.model import ModelBuilder
from dgl_physics.solver import SolverXPBD
from dgl_physics.solver_config import SolverConfig
from dgl_physics.state import State


@dataclass(frozen=True, kw_only=True)
class PeirceResult:
    """Result of the test."""

    angle: float
    """Angle of the chord from clamp to tip under the level [rad]."""
    bending_length: float
    """Measured bending length [m]."""
    expected: float
    """Bending length of the material [m]."""
    positions: np.ndarray
    """Of the strip [m], shape (V, 3): clamped at y = 0, hanging over towards +y, z up."""

    @property
    def error(self) -> float:
        """Relative error of the bending length."""
        return self.bending_length / self.expected - 1.0


def compute_bending_length(stiffness: float, area_density: float, gravity: float = 9.81) -> float:
    """Compute Peirce's bending length c = (B / (w g))^(1/3) [m] of a fabric.

    Args:
        stiffness: Flexural rigidity B per width [N m].
        area_density: Mass per area w [kg/m^2].
        gravity: [m/s^2].

    Source:
        F. T. Peirce: The "Handle" of Cloth as a Measurable Quantity, J. Textile Inst. 21, 1930.
    """
    return (stiffness / (area_density * gravity)) ** (1 / 3)


def compute_chord_angle(overhang: np.ndarray | float, *, steps: int = 100) -> np.ndarray:
    """Compute the angle of the chord of a heavy elastica.

    The angle t of an inextensible strip below the level follows B t'' = -w g (L - s) cos t with
    t(0) = 0 and t'(L) = 0; solved by shooting with fourth-order Runge-Kutta steps.

    Args:
        overhang: L over the bending length, any shape; at most 4.
        steps: Of the integration.

    Returns:
        Angle of the chord under the level [rad], of that shape.
    """
    weight = np.asarray(overhang, dtype=np.float64) ** 3

    def slope(s: float, y: np.ndarray) -> np.ndarray:
        return np.array([y[1], -weight * (1 - s) * np.cos(y[0]), np.cos(y[0]), np.sin(y[0])])

    def shoot(curvature: np.ndarray) -> np.ndarray:
        zero, h = np.zeros_like(weight), 1.0 / steps
        y = np.array([zero, curvature, zero, zero])
        for k in range(steps):
            a = slope(k * h, y)
            b = slope((k + 0.5) * h, y + 0.5 * h * a)
            c = slope((k + 0.5) * h, y + 0.5 * h * b)
            d = slope((k + 1) * h, y + h * c)
            y = y + h / 6 * (a + 2 * b + 2 * c + d)
        return y

    low, high = np.zeros_like(weight), 0.5 * weight  # the moment at the clamp of a level strip
    for _ in range(40):
        middle = 0.5 * (low + high)
        is_high = shoot(middle)[1] > 0
        low, high = np.where(is_high, low, middle), np.where(is_high, middle, high)
    x, z = shoot(low)[2:]
    return np.arctan2(z, x)


@cache
def _tabulate_chord_angles() -> tuple[np.ndarray, np.ndarray]:
    overhangs = np.linspace(0.2, 4.0, 77)
    return compute_chord_angle(overhangs), overhangs


def find_overhang(angle: float) -> float:
    """Find the overhang over the bending length at which the chord has an angle [rad].

    Raises:
        ValueError: If the angle is not that of an overhang between 0.2 and 4 bending lengths.
    """
    angles, overhangs = _tabulate_chord_angles()
    if not angles[0] <= angle <= angles[-1]:
        raise ValueError(f"angle must be in {angles[0]:.3f}..{angles[-1]:.3f}; got {angle:.3f}")
    return float(np.interp(angle, angles, overhangs))


def measure_bending_length(
    material: ClothMaterial,
    *,
    rows: int = 4,
    width: float = 0.025,
    frames: int = 240,
    config: SolverConfig | None = None,
) -> PeirceResult:
    """Simulate the test with an overhang of twice the bending length of the material.

    Args:
        material: Of the strip. Adhesion is left out, drag raised, and the contact thickness kept
            below the distance of particles that share no edge.
        rows: Of triangles that hang over. Their height is the overhang over rows + 1/2.
        width: Of the strip [m].
        frames: Until the strip is looked at.
        config: Of the solver.

    Limitations:
        Hinges hold their curvature over half a row to either side, so the clamp acts half a row
        inside of the last held row; the overhang counts from there.
    """
    expected = compute_bending_length(material.bending_stiffness, material.area_density)
    height = 2.0 * expected / (rows + 0.5)
    edge = height / np.sqrt(0.75)
    vertices, faces = _make_strip(rows + 2, max(round(width / edge), 1), edge, height)
    held = np.flatnonzero(vertices[:, 1] < 2.5 * height)
    vertices[:, 1] -= 1.5 * height
    builder = ModelBuilder()
    builder.add_garment(
        vertices,
        faces,
        rest=vertices[:, :2],
        pinned=held,
        material=replace(material, adhesion=0.0, drag=3.0, thickness=min(material.thickness, edge)),
    )
    model = builder.build()
    # a damped strip creeps to rest: it must not fall asleep before
    config = replace(config or SolverConfig(), sleep_distance=0.0)
    state, solver = State(model), SolverXPBD(model, config)
    for _ in range(frames):
        solver.step(state)
    positions = state.get_positions()[0].astype(np.float64)
    tip = positions[vertices[:, 1] > vertices[:, 1].max() - 1e-6 * expected].mean(axis=0)
    angle = float(np.arctan2(-tip[2], tip[1]))
    return PeirceResult(
        angle=angle,
        bending_length=2.0 * expected / find_overhang(angle),
        expected=expected,
        positions=positions,
    )


def _make_strip(
    rows: int, columns: int, edge: float, height: float
) -> tuple[np.ndarray, np.ndarray]:
    """Equilateral triangles, rows along y: vertices [m], shape (V, 3), and faces, shape (F, 3)."""
    r, c = np.divmod(np.arange((rows + 1) * (columns + 1)), columns + 1)
    vertices = np.column_stack([(c + 0.5 * (r % 2)) * edge, r * height, np.zeros(len(r))])
    a = np.flatnonzero((r < rows) & (c < columns))
    b, d, e = a + 1, a + columns + 1, a + columns + 2
    is_even = (r[a] % 2 == 0)[:, None]
    first = np.where(is_even, np.column_stack([a, b, d]), np.column_stack([a, b, e]))
    second = np.where(is_even, np.column_stack([b, e, d]), np.column_stack([a, e, d]))
    return vertices, np.concatenate([first, second])
