"""A felt bowl hat that a plate squeezes onto a head that is too wide for it, and lets go."""

import time
from dataclasses import dataclass, field

import numpy as np

from dgl_bench.physics.experiment import Bench, Result
from dgl_bench.physics.figures import Chart, ClothView, Figure, Limit, Series, ShownSolid
from dgl_bench.physics.sheets import join, make_bowl, make_box
from dgl_bench.rows import Reading
from dgl_physics import ModelBuilder, Shape, SolidMaterial
from dgl_physics.scene import Scene

__all__ = ["HatRecord", "Moment", "measure_change", "measure_hat", "press_hat"]

RADIUS, WALL, RINGS = 0.09, 0.004, 11
"""Outer radius and thickness of the felt [m]; 11 rings are edges of 8 to 14 mm."""
MASS = 0.075
"""Of the hat [kg]."""
FELT = SolidMaterial(
    youngs_modulus=3e5,
    rest_offset=0.003,
    density=MASS / (2 / 3 * np.pi * (RADIUS**3 - (RADIUS - WALL) ** 3)),
)
HEAD = RADIUS - WALL
"""Radius of the head [m]; with the rest offset it is 3 mm wider than the hat inside."""
PLATE = 0.01
"""Half of the plate's thickness [m]."""
GAP = 0.002
"""Left between the top of the hat, if it touched the head, and the plate [m]."""
SPEED = 0.1
"""Of the plate [m/s]."""
AWAY = -10.0
"""Height to which the head is taken away [m]."""
BAR = 3.0
"""On the largest change of shape after release [mm]."""


@dataclass(frozen=True, kw_only=True)
class Moment:
    """State of the hat at one moment."""

    name: str
    frame: int
    vertices: np.ndarray
    """[m], shape (V, 3)."""
    change: np.ndarray
    """Distance of each particle to the rest shape [mm], shape (V,)."""
    plate: float
    """Height of the plate's middle [m]."""


@dataclass(frozen=True, kw_only=True)
class HatRecord:
    """Record of the hat."""

    faces: np.ndarray
    """Shape (F, 3)."""
    weight: float
    """[N]."""
    moments: list[Moment] = field(default_factory=list)
    """Worn, pressed, released, and taken off."""
    path: list[tuple[float, float, float]] = field(default_factory=list)
    """Mean and largest change of shape [mm], and force on the head [N], in each frame."""
    seconds: list[float] = field(default_factory=list)
    """That each frame took [s]."""


def measure_change(positions: np.ndarray, rest: np.ndarray) -> np.ndarray:
    """Measure the distances to the rest shape after the best rigid motion [m], shape (V,).

    Source: W. Kabsch: A solution for the best rotation to relate two sets of vectors, 1976.
    """
    a, b = positions - positions.mean(axis=0), rest - rest.mean(axis=0)
    u, _, vt = np.linalg.svd(a.T @ b)
    mirror = np.diag([1.0, 1.0, np.linalg.det(u @ vt)])
    return np.linalg.norm(a @ (u @ mirror @ vt) - b, axis=1)


def press_hat(material: SolidMaterial = FELT, *, rings: int = RINGS) -> HatRecord:
    """Put the hat on and let it rest for 1 s, press it, hold for 0.5 s, let go and wait for 1 s.

    Then the head is taken away, so that what friction on it still holds comes back as well.

    Args:
        material: Of the hat.
        rings: Of its mesh.
    """
    vertices, faces = make_bowl(RADIUS, rings)
    reach = HEAD + material.rest_offset
    above = np.sqrt(reach**2 - (RADIUS - WALL) ** 2) + 0.005  # where the rim meets the head
    builder = ModelBuilder()
    builder.add_solid(np.add(vertices, [0, 0, above]), faces, material=material, thickness=WALL)
    head = builder.add_shape(Shape(kind="sphere", size=(HEAD, 0, 0)), body=builder.add_body("head"))
    plate = builder.add_body("plate")
    builder.add_shape(Shape(kind="box", size=(0.15, 0.15, PLATE)), body=plate)
    scene = Scene(builder)
    rest = scene.x
    record = HatRecord(faces=scene.faces, weight=9.81 * float(scene.mass.sum()))
    low = reach + WALL + material.rest_offset + PLATE + GAP
    high = above + RADIUS + material.rest_offset + PLATE + 0.01
    travel = round((high - low) / SPEED * 60)
    down = np.linspace(high, low, travel + 1)[1:]
    up = np.linspace(low, high, travel + 1)[1:]
    for name, heights, at in (
        ("worn", np.full(60, high), 0.0),
        ("pressed", np.append(down, np.full(30, low)), 0.0),
        ("released", np.append(up, np.full(60, high)), 0.0),
        ("taken off", np.full(30, high), AWAY),
    ):
        if name in ("worn", "taken off"):
            scene.move(_make_poses(at, high), is_jump=True)
        for height in heights:
            scene.move(_make_poses(at, height))
            started = time.perf_counter()
            scene.step()
            record.seconds.append(time.perf_counter() - started)
            change = 1e3 * measure_change(scene.x, rest)
            force = -60 * float(scene.state.impulse.numpy()[0, head, 2])
            record.path.append((float(change.mean()), float(change.max()), force))
        record.moments.append(
            Moment(
                name=name,
                frame=len(record.path),
                vertices=scene.x,
                change=1e3 * measure_change(scene.x, rest),
                plate=float(heights[-1]),
            )
        )
    return record


def measure_hat(bench: Bench) -> Result:
    """Squeeze the hat onto the head and let go."""
    del bench
    record = press_hat()
    worn, pressed, released, off = record.moments
    squeezed, left = (record.path[m.frame - 1][2] for m in (pressed, released))
    rows = (
        Reading(
            "bowl hat under the plate, largest change of shape",
            float(pressed.change.max()),
            "mm",
            note=f"mean {pressed.change.mean():.2f} mm, {squeezed:.1f} N on the head",
        ),
        Reading(
            "bowl hat 1 s after release, largest change of shape",
            float(released.change.max()),
            "mm",
            bar=f"<= {BAR:g}",
            note="distance to the rest shape after the best rigid motion, still on the head; "
            f"{worn.change.max():.2f} mm before the plate came, {off.change.max():.2f} mm without "
            "the head",
        ),
        Reading(
            "bowl hat 1 s after release, mean change of shape",
            float(released.change.mean()),
            "mm",
            note=f"{left:.3f} N on the head for a weight of {record.weight:.3f} N",
        ),
        Reading(
            "bowl hat, frame",
            1e3 * float(np.mean(record.seconds[2:])),
            "ms",
            note=f"mean of all, {len(pressed.vertices)} particles",
        ),
    )
    return Result(rows, (_draw_moments(record), _draw_path(record)))


def _make_poses(head: float, plate: float) -> np.ndarray:
    """Poses of both at heights [m], shape (2, 7)."""
    return np.array([[0.0, 0.0, z, 1.0, 0.0, 0.0, 0.0] for z in (head, plate)])


def _draw_moments(record: HatRecord) -> Figure:
    plate, plate_faces = make_box((0.2, 0.2, 2 * PLATE))
    half, half_faces = make_bowl(HEAD, 12)
    sphere, sphere_faces = join([(half, half_faces), (-half, half_faces[:, ::-1])])
    head = ShownSolid(sphere, sphere_faces)
    return Figure(
        "hat",
        "A bowl hat of felt is put on a head that is 3 mm too wide, pressed by a plate, "
        "and let go. Colour: "
        "how far each place is from the rest shape after the best rigid motion.",
        tuple(
            ClothView(
                f"{m.name}: at most {m.change.max():.1f} mm",
                m.vertices,
                record.faces,
                azimuth=-90,
                elevation=5,
                values=m.change[record.faces].max(axis=1),
                value_label="change of shape [mm]",
                value_limit=max(BAR, float(record.moments[1].change.max())),
                solids=(
                    head,
                    ShownSolid(np.add(plate, [0.0, 0.0, m.plate]), plate_faces),
                ),
            )
            for m in record.moments[:3]
        ),
    )


def _draw_path(record: HatRecord) -> Figure:
    mean, largest, force = np.array(record.path).T
    t = np.arange(1, len(mean) + 1) / 60
    begins = [m.frame / 60 for m in record.moments]
    events = [
        Limit(begin, label, is_vertical=True, is_quiet=True)
        for begin, label in zip(begins, ("plate down", "plate up", "head away"), strict=False)
    ]
    released = record.moments[2]
    return Figure(
        "hat_path",
        "The same hat over time. Left: its change of shape; friction on the head keeps a "
        "part of it until "
        "the head is taken away. Right: the force on the head.",
        (
            Chart(
                f"released: at most {released.change.max():.2f} mm",
                "time [s]",
                "change of shape [mm]",
                (
                    Series(t, largest, "largest"),
                    Series(t, mean, "mean", tone=1),
                ),
                limits=(Limit(BAR, "bar"), *events),
            ),
            Chart(
                f"{force[released.frame - 1]:.3f} N of {record.weight:.3f} N",
                "time [s]",
                "force on the head [N]",
                (
                    Series(t, np.full(len(t), record.weight), "weight", kind="theory"),
                    Series(t, force, "measured"),
                ),
                limits=events,
            ),
        ),
    )
