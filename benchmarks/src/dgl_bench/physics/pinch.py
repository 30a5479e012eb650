"""A pinch between two fingers: what holds, what falls, and what one finger lifts."""

from dataclasses import dataclass

import numpy as np

from dgl_bench.physics.experiment import Bench, Result
from dgl_bench.physics.figures import Chart, ClothView, Figure, Limit, Series
from dgl_bench.physics.sheets import make_capsule, make_sheet
from dgl_bench.rows import Reading
from dgl_physics import ClothMaterial, ModelBuilder, Shape
from dgl_physics.scene import Scene

__all__ = ["measure_pinch"]

EDGE = 0.0125
RADIUS, HALF_LENGTH = 0.01, 0.015
"""Of a fingertip [m]."""
LYING = np.array([0, 0, 0, np.sqrt(0.5), 0, np.sqrt(0.5), 0])  # axis along x
FINGER = Shape(kind="capsule", size=(RADIUS, HALF_LENGTH, 0.0), pose=LYING)
SQUEEZE = 0.002
"""Distance that the fingers close beyond touching [m]."""
LIFT, LIFT_SPEED = 0.5, 0.6
HOLD_FRAMES = 600
FALLEN = 0.1
"""Cloth that slips so far during the lift has fallen [m]."""
DROPPED = 2.0
"""Cloth that is wholly so far below the fingers has fallen, and is not followed further [m]."""
SHAKE, SHAKE_RATE = 0.01, 2.0
"""Amplitude [m] and frequency [Hz] of the shaking; whole periods fit into the hold."""


@dataclass(frozen=True, kw_only=True)
class Pinch:
    """Outcome of a pinch."""

    slip: np.ndarray
    """Displacement of each pinched particle relative to the fingers since the end of the lift [m],
    shape (T, N)."""
    lifted_slip: float
    """Largest slip during the lift [m]."""
    top: float
    """Height of the highest particle above the fingers' start at the end [m]."""
    vertices: np.ndarray
    """[m], shape (V, 3), at the end."""
    faces: np.ndarray
    fingers: np.ndarray
    """Middle of each finger at the end [m], shape (2, 3)."""
    grams: float


def pinch(material: ClothMaterial) -> Pinch:
    """Close two fingers on hanging cloth of two layers, lift it, and hold it while it is shaken."""
    vertices, faces = make_sheet(0.1, 0.15, EDGE)
    vertices = vertices[:, [0, 2, 1]]
    vertices[:, 2] += 0.03 - vertices[:, 2].max()  # the fingers close 3 cm below its top
    builder = ModelBuilder()
    for side in (-0.5, 0.5):
        builder.add_garment(
            np.add(vertices, [0, side * material.thickness, 0]), faces, material=material
        )
    for name in ("left", "right"):
        builder.add_shape(FINGER, body=builder.add_body(name))
    scene = Scene(builder)
    closed = 0.5 * material.thickness + material.rest_offset + RADIUS - SQUEEZE

    def move(at: np.ndarray, opening: float = 0.0, *, is_jump: bool = False) -> None:
        poses = [[at[0], at[1] + s * (closed + opening), at[2], 1, 0, 0, 0] for s in (-1, 1)]
        scene.move(np.array(poses), is_jump=is_jump)
        scene.step()

    scene.state.set_gravity_scale(0.0)  # until the fingers have closed: nothing else holds it
    for k in range(16):
        move(np.zeros(3), 0.01 * (1 - k / 15), is_jump=k == 0)
    scene.state.set_gravity_scale(1.0)
    x = scene.x
    inner = np.flatnonzero((np.abs(x[:, 0]) < HALF_LENGTH + 0.005) & (np.abs(x[:, 2]) < 0.007))
    grip = x[inner]
    at = np.zeros(3)
    # a quarter of a second to speed up and to slow down
    path = _ease(LIFT, LIFT_SPEED)
    for z in path:
        at = np.array([0.0, 0.0, z])
        move(at)
    start = scene.x[inner] - at
    slips = []
    for frame in range(1, HOLD_FRAMES + 1):
        wave = SHAKE * np.sin(2 * np.pi * SHAKE_RATE * frame / 60)
        at = np.array([wave, 0.5 * wave, LIFT + 0.5 * wave])
        move(at)
        slips.append(np.linalg.norm(scene.x[inner] - at - start, axis=1))
        if scene.x[:, 2].max() < at[2] - DROPPED:
            break
    return Pinch(
        slip=np.array(slips),
        lifted_slip=float(np.linalg.norm(start - grip, axis=1).max()),
        top=float(scene.x[:, 2].max()),
        vertices=scene.x,
        faces=scene.faces,
        fingers=np.array([np.add(at, [0, s * closed, 0]) for s in (-1, 1)]),
        grams=1e3 * float(scene.mass.sum()),
    )


def _ease(distance: float, speed: float) -> np.ndarray:
    """Heights of a lift that gains and loses its speed within a quarter of a second each."""
    ramp = np.arange(1, 16) / 16
    steady = round((distance / speed - 16 / 60) * 60)
    rate = np.concatenate([ramp, np.ones(max(steady + 1, 1)), ramp[::-1]])
    return distance * np.cumsum(rate) / rate.sum()


def press(material: ClothMaterial) -> float:
    """Press one finger on flat cloth and raise it; return the largest rise of a particle [m]."""
    vertices, faces = make_sheet(0.2, 0.2, EDGE)
    vertices[:, 2] = material.rest_offset
    builder = ModelBuilder()
    builder.add_garment(vertices, faces, material=material)
    builder.add_ground()
    builder.add_shape(FINGER, body=builder.add_body("finger"))
    scene = Scene(builder)
    low = 2 * material.rest_offset + RADIUS - 0.002
    for k in range(81):
        z = low + 0.05 * max(0, 10 - k) / 10 + 0.5 * max(0, k - 30) / 50
        scene.move(np.array([[0, 0, z, 1, 0, 0, 0]]), is_jump=k == 0)
        scene.step()
    return float((scene.x - vertices)[:, 2].max())


def measure_pinch(bench: Bench) -> Result:
    """Lift and hold with the default material, without friction, and with one finger."""
    del bench
    held = pinch(ClothMaterial())
    slippery = pinch(ClothMaterial(friction=0.0, adhesion=0.0))
    original = pinch(ClothMaterial(friction=25.0))
    risen = 1e3 * press(ClothMaterial())
    creep = 1e3 * float(held.slip.max())
    note = f"{held.grams:.1f} g on {held.slip.shape[1]} particles, two capsules, default material"
    fate = ""
    if held.lifted_slip > FALLEN:
        fate = "it fell during the lift; "
    elif held.top < LIFT - 0.2:
        fate = f"it fell, {len(held.slip) / 60:.1f} s after the lift; "
    rows = (
        Reading(
            "pinch, creep in 10 s of shaking",
            None if held.lifted_slip > FALLEN else creep,
            "mm",
            bar="<= 2",
            note=f"{note}; {fate}largest, ±{1e3 * SHAKE:g} mm at {SHAKE_RATE:g} Hz",
        ),
        Reading(
            "pinch, slip while lifted by 0.5 m",
            1e3 * held.lifted_slip,
            "mm",
            note=f"at {LIFT_SPEED} m/s",
        ),
        Reading(
            "pinch, creep at the original's friction of 25", 1e3 * float(original.slip.max()), "mm"
        ),
        Reading(
            "pinch without friction and adhesion, fallen below where it was held",
            LIFT - slippery.top,
            "m",
            bar=">= 0.5",
        ),
        Reading("one finger from above, lifts by", risen, "mm", bar="<= 3"),
    )
    runs = {"default material": held, "friction 25": original, "no friction": slippery}
    curves = [
        Series(
            np.arange(1, len(p.slip) + 1) / 60,
            np.maximum(1e3 * p.slip.max(axis=1), 1e-4),
            label,
            tone=tone,
        )
        for tone, (label, p) in enumerate(runs.items())
        if p.lifted_slip <= FALLEN
    ]
    panels: list = []
    for label, p in runs.items():
        if p.top > LIFT - 0.1 and not panels:
            tips = [np.array([HALF_LENGTH * s, 0, 0]) for s in (-1, 1)]
            panels.append(
                ClothView(
                    f"held for 10 s, {label}",
                    p.vertices,
                    p.faces,
                    azimuth=-35,
                    elevation=15,
                    solids=[make_capsule(f + tips[0], f + tips[1], RADIUS) for f in p.fingers],
                )
            )
    panels.append(
        Chart(
            "default material falls during the lift"
            if held.lifted_slip > FALLEN
            else f"creep {creep:.2g} mm in 10 s of shaking",
            "time since the lift [s]",
            "largest slip [mm]",
            curves,
            limits=(Limit(2.0, "bar"),),
            is_log_y=True,
        )
    )
    figure = Figure(
        "pinch",
        f"Two capsules of {2e3 * RADIUS:g} mm pinch {held.grams:.0f} g of two-layer cloth, "
        "lift it by 0.5 m "
        "and shake it: how far particles between the fingers have moved relative to them.",
        panels,
    )
    return Result(rows, (figure,))
