"""States of a garment: flat, dropped, folded, flung, hanging."""

import zlib
from collections.abc import Callable

import numpy as np

from dgl_assets import Garment
from dgl_collect.gam_data.motions import FOLDS, PAIRS, make_arc, make_fling
from dgl_collect.gam_data.simulation import SPEED, GarmentSimulation, find_grip
from dgl_physics import FABRICS, PhysicsError, Shape, get_fabric

__all__ = ["HANGING", "make_rng", "make_states"]

HANGING = ("hung_one", "hung_two", "over_bar")
"""States that do not lie on the ground."""
CALM, HANG = 120, 200
"""Longest times to become calm, lying and hanging [1/60 s]."""
_REST = 0.005  # height of the lowest point of a lying garment [m]
_ROUGHNESS = 5e-4  # noise of upright cloth [m]
_BAR, _BAR_HEIGHT = 0.02, 1.6  # radius, and height above the ground [m]


def make_rng(seed: int, garment_id: str, subject: str) -> np.random.Generator:
    """Make a random generator of one subject of one garment, independent of others."""
    return np.random.default_rng([seed, *(zlib.crc32(s.encode()) for s in (garment_id, subject))])


def make_states(garment: Garment, seed: int, *, is_flat: bool = False) -> dict[str, np.ndarray]:
    """Simulate a garment's states.

    Args:
        garment: A garment of the catalogue.
        seed: Seed of all draws, together with the garment's name.
        is_flat: Make the flat state only.

    Returns:
        Positions [m], each of shape (V, 3), float64, z up, by name. "flat" is first, the garment as
        made; all others lie on the ground z = 0 or hang above it.

    Raises:
        PhysicsError: If a state cannot be simulated; the message names it.
    """
    states = {"flat": garment.vertices.astype(np.float64)}
    if is_flat:
        return states
    make = _SHELL if garment.wall_thickness is not None else _CLOTH
    fabric = None
    if garment.wall_thickness is None:
        names = sorted(FABRICS)
        fabric = get_fabric(names[make_rng(seed, garment.name, "fabric").integers(len(names))])
    simulation = GarmentSimulation(garment, fabric)
    for name, function in make.items():
        rng = make_rng(seed, garment.name, name)
        try:
            kind, positions = function(simulation, states, rng)
        except PhysicsError as err:
            raise PhysicsError(f"{name}: {type(err).__name__}: {err}") from err
        states[kind] = positions
    return states


def _drop(
    name: str, tilts: tuple[float, float], heights: tuple[float, float]
) -> Callable[..., tuple[str, np.ndarray]]:
    def make(simulation, states, rng):
        tilted = _tilt(states["flat"], rng, np.radians(rng.uniform(*tilts)))
        return name, simulation.settle(_lift(tilted, rng.uniform(*heights)), frames=CALM)

    return make


def _hang_one(simulation: GarmentSimulation, states: dict, rng: np.random.Generator):
    garment = simulation.garment
    grip = find_grip(garment, list(garment.landmarks)[rng.integers(len(garment.landmarks))])
    start = _lift(_roughen(_make_upright(states["flat"], [grip]), rng), 0.5)
    return "hung_one", simulation.settle(start, frames=HANG, pinned=grip)


def _drop_hung(simulation: GarmentSimulation, states: dict, rng: np.random.Generator):
    # cloth that falls exactly upright is compressed instead of buckling
    leaning = _tilt(_roughen(states["hung_one"], rng), rng, np.radians(rng.uniform(15.0, 40.0)))
    start = _lift(leaning, rng.uniform(0.02, 0.2))
    return "crumpled_1", simulation.settle(start, frames=CALM)


def _hang_two(simulation: GarmentSimulation, states: dict, rng: np.random.Generator):
    garment = simulation.garment
    pairs = PAIRS[garment.category]
    grips = [find_grip(garment, name) for name in pairs[rng.integers(len(pairs))]]
    start = _make_upright(states["flat"], grips)
    start = _lift(_roughen(start, rng), 0.5)
    apart = np.array([start[grip].mean(axis=0) for grip in grips])
    nearer = (apart.mean(axis=0) - apart) * rng.uniform(0.05, 0.4)
    paths = np.linspace(0.0, 1.0, 31)[:, None, None] * nearer
    moved = simulation.carry(start, grips, paths)
    return "hung_two", simulation.settle(moved, frames=HANG, pinned=np.concatenate(grips))


def _fold(simulation: GarmentSimulation, states: dict, rng: np.random.Generator):
    garment = simulation.garment
    folds = FOLDS[garment.category]
    fold = folds[rng.integers(len(folds))]
    side = ("left", "right")[rng.integers(2)]
    grips = [find_grip(garment, name.format(side=side)) for name in fold.grips]
    start = _lift(states["flat"], _REST)
    held = np.array([start[grip].mean(axis=0) for grip in grips])
    end = np.mean([start[garment.landmarks[name.format(side=side)]] for name in fold.hinge], axis=0)
    middle = held.mean(axis=0)
    hinge = middle + rng.uniform(fold.nearest, 1.0) * (end - middle)
    turn = np.radians(rng.uniform(-25.0, 25.0) if len(grips) == 1 else rng.uniform(-8.0, 8.0))
    moved = simulation.carry(start, grips, make_arc(held, hinge, turn, speed=SPEED))
    return fold.state, simulation.settle(moved, frames=CALM)


def _fling(simulation: GarmentSimulation, states: dict, rng: np.random.Generator):
    garment = simulation.garment
    grips = [find_grip(garment, name) for name in PAIRS[garment.category][0]]
    held = np.concatenate(grips)
    start = _lift(_roughen(_make_upright(states["flat"], grips), rng), 0.05)
    height = float(start[held, 2].mean())
    path = make_fling(height, height - 0.05, forward=rng.uniform(0.3, 0.6))
    moved = simulation.carry(start, grips, np.repeat(path, 2, axis=1))
    return "flung", simulation.settle(moved, frames=CALM)


def _hang_over(simulation: GarmentSimulation, states: dict, rng: np.random.Generator):
    flat = states["flat"]
    turn = np.radians(rng.choice([0.0, 90.0]) + rng.uniform(-20.0, 20.0))
    start = _turn(flat - flat.mean(axis=0), np.array([0.0, 0.0, 1.0]), turn)
    start[:, 1] += rng.uniform(-0.1, 0.1) * np.ptp(start[:, 1])
    bar = Shape(
        kind="capsule",
        size=(_BAR, 1.0, 0.0),
        pose=np.array([0.0, 0.0, _BAR_HEIGHT, np.sqrt(0.5), 0.0, np.sqrt(0.5), 0.0]),
        friction=3.0,
    )
    start = _lift(start, _BAR_HEIGHT + _BAR + 0.02)
    end = simulation.settle(start, frames=HANG, shapes=(bar,))
    if end[:, 2].max() < _BAR_HEIGHT:
        raise PhysicsError("it slid off the bar")
    return "over_bar", end


def _press(simulation: GarmentSimulation, states: dict, rng: np.random.Generator):
    return "pressed", simulation.press(_lift(states["flat"], _REST), rng.uniform(0.05, 0.2))


_CLOTH: dict[str, Callable[..., tuple[str, np.ndarray]]] = {
    "dropped": _drop("dropped", (5.0, 30.0), (0.03, 0.25)),
    "crumpled_0": _drop("crumpled_0", (60.0, 90.0), (0.03, 0.2)),
    "hung_one": _hang_one,
    "crumpled_1": _drop_hung,
    "hung_two": _hang_two,
    "folded": _fold,
    "flung": _fling,
    "over_bar": _hang_over,
}
_SHELL: dict[str, Callable[..., tuple[str, np.ndarray]]] = {
    "tilted_0": _drop("tilted_0", (10.0, 40.0), (0.01, 0.05)),
    "tilted_1": _drop("tilted_1", (60.0, 120.0), (0.01, 0.05)),
    "pressed": _press,
}


def _lift(positions: np.ndarray, height: float) -> np.ndarray:
    """Move vertically until the lowest point is at a height [m]."""
    return positions + np.array([0.0, 0.0, height - positions[:, 2].min()])


def _roughen(positions: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Add noise, so that upright cloth is in no exact plane and can buckle."""
    return positions + rng.normal(0.0, _ROUGHNESS, positions.shape)


def _turn(positions: np.ndarray, axis: np.ndarray, angle: float) -> np.ndarray:
    """Turn about an axis through the origin [rad]."""
    from scipy.spatial.transform import Rotation

    return Rotation.from_rotvec(angle * axis).apply(positions)


def _tilt(positions: np.ndarray, rng: np.random.Generator, angle: float) -> np.ndarray:
    """Tilt about a horizontal axis of any direction."""
    azimuth = rng.uniform(0.0, 2 * np.pi)
    return _turn(positions, np.array([np.cos(azimuth), np.sin(azimuth), 0.0]), angle)


def _make_upright(flat: np.ndarray, grips: list[np.ndarray]) -> np.ndarray:
    """Turn a flat garment until one grip is on top or two are level; its front faces -y."""
    centre = (flat.min(axis=0) + flat.max(axis=0)) / 2
    held = np.array([flat[grip].mean(axis=0) for grip in grips])
    up = (held.mean(axis=0) - centre)[:2]
    if len(held) == 2:
        across = (held[1] - held[0])[:2]
        level = np.array([-across[1], across[0]])
        up = level if level @ up >= 0 else -level
    # a grip in the middle keeps the garment as it lies, neck up
    angle = np.pi / 2 - np.arctan2(up[1], up[0]) if np.linalg.norm(up) > 0.02 else 0.0
    turned = _turn(flat - centre, np.array([0.0, 0.0, 1.0]), angle)
    return np.column_stack([turned[:, 0], -turned[:, 2], turned[:, 1]])
