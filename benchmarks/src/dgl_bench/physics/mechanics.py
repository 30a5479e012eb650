"""Mechanics of cloth in free fall, on a slope, and against a free body."""

import numpy as np

from dgl_bench.physics.experiment import Bench, Result
from dgl_bench.physics.figures import Chart, Figure, Limit, Series
from dgl_bench.physics.sheets import make_sheet
from dgl_bench.rows import Reading
from dgl_physics import ClothMaterial, ModelBuilder, SolverConfig
from dgl_physics.scene import Scene

__all__ = ["measure_free_fall", "measure_incline", "measure_momentum"]

G = 9.81
EDGE = 0.0125
SMOOTH = ClothMaterial(drag=0.0, adhesion=0.0)


def measure_free_fall(bench: Bench) -> Result:
    """Drop a sheet for a second without drag."""
    del bench
    builder = ModelBuilder()
    builder.add_garment(*make_sheet(0.2, 0.2, EDGE), material=SMOOTH)
    scene = Scene(builder)
    fallen, spread = [0.0], [0.0]
    for _ in range(60):
        scene.step()
        fallen.append(-float(scene.x[:, 2].mean()))
        spread.append(float(np.ptp(scene.x[:, 2])))
    t = np.arange(61) / 60
    theory = 0.5 * G * t**2
    error = 100 * np.abs(np.array(fallen[1:]) / theory[1:] - 1)
    step = 1 / 60 / scene.solver.config.substeps
    euler = 100 * step / t[1:]
    row = Reading(
        "free fall of 1 s, error of the distance",
        float(error[-1]),
        "%",
        bar="<= 0.5",
        note=f"{fallen[-1]:.4f} m for {theory[-1]:.4f} m; symplectic Euler is off by h/t = "
        f"{euler[-1]:.3f} %",
    )
    figure = Figure(
        "free_fall",
        "A sheet falls without drag. Left: the distance against ½gt². Right: the relative "
        "error; "
        "what is left is that of the integrator, h/t for substeps of length h.",
        (
            Chart(
                f"{fallen[-1]:.3f} m in 1 s",
                "time [s]",
                "distance [m]",
                (
                    Series(t, theory, "½gt²", kind="theory"),
                    Series(t[::4], fallen[::4], "measured", kind="measured"),
                ),
            ),
            Chart(
                f"error after 1 s: {error[-1]:.2f} %",
                "time [s]",
                "error [%]",
                (
                    Series(t[1:], euler, "symplectic Euler, h/t", kind="theory"),
                    Series(t[1::4], error[::4], "measured", kind="measured"),
                ),
                limits=(Limit(0.5, "bar at 1 s: 0.5 %"),),
                is_log_y=True,
            ),
        ),
    )
    return Result((row,), (figure,))


SLOPES = (0.5, 0.8, 0.95, 1.05, 1.2, 1.5, 2.0)
"""tan θ of the slopes, relative to the friction coefficient."""


def measure_incline(bench: Bench) -> Result:
    """Put a patch on slopes on both sides of the friction angle."""
    del bench
    mu = 0.5
    slides = {ratio: _slide(ratio * mu, mu) for ratio in SLOPES}
    theory = {r: _compute_acceleration(r * mu, mu) for r in SLOPES}
    crept = 1e3 * abs(float(slides[0.8][0][-1]))
    acceleration = slides[1.2][1]
    error = 100 * abs(acceleration / theory[1.2] - 1)
    rows = (
        Reading("slope of 0.8 μ, slip in 2 s", crept, "mm", bar="<= 0.1"),
        Reading(
            "slope of 1.2 μ, error of the acceleration",
            error,
            "%",
            bar="<= 10",
            note=f"{acceleration:.4f} m/s² for {theory[1.2]:.4f} m/s², μ = {mu}",
        ),
    )
    fine = np.linspace(0.4, 2.1, 200)
    t = np.arange(121) / 60
    figure = Figure(
        "incline",
        "A patch of 10 cm on slopes. Left: its acceleration against g (sin θ - μ cos θ), "
        "which is zero "
        "where friction holds. Right: how far it has slid; below μ it does not creep.",
        (
            Chart(
                f"at 1.2 μ: {error:.1f} % off",
                "tan θ / μ",
                "acceleration [m/s²]",
                (
                    Series(
                        fine,
                        [_compute_acceleration(r * mu, mu) for r in fine],
                        "theory",
                        kind="theory",
                    ),
                    Series(SLOPES, [slides[r][1] for r in SLOPES], "measured", kind="measured"),
                ),
            ),
            Chart(
                f"at 0.8 μ: slips {crept:.3f} mm in 2 s",
                "time [s]",
                "slid [m]",
                [
                    Series(t, np.maximum(slides[r][0], 1e-8), f"{r:g} μ", tone=k)
                    for k, r in enumerate((0.8, 0.95, 1.05, 1.2))
                ],
                limits=(Limit(1e-4, "sticks: below 0.1 mm"),),
                is_log_y=True,
            ),
        ),
    )
    return Result(rows, (figure,))


def _compute_acceleration(slope: float, mu: float) -> float:
    theta = np.arctan(slope)
    return max(0.0, G * float(np.sin(theta) - mu * np.cos(theta)))


def _slide(slope: float, mu: float) -> tuple[np.ndarray, float]:
    """Let a patch go on a slope: distance [m] in each frame of 2 s, and acceleration [m/s²].

    Gravity is turned and not the ground, which is the same and keeps positions small.
    """
    theta = np.arctan(slope)
    gravity = (G * float(np.sin(theta)), 0.0, -G * float(np.cos(theta)))
    material = ClothMaterial(friction=mu, drag=0.0, adhesion=0.0)
    vertices, faces = make_sheet(0.1, 0.1, EDGE)
    vertices[:, 2] = material.rest_offset
    builder = ModelBuilder()
    builder.add_garment(vertices, faces, material=material)
    builder.add_ground()
    scene = Scene(builder, SolverConfig(gravity=gravity))
    path = [0.0]
    for _ in range(120):
        scene.step()
        path.append(float((scene.x - vertices)[:, 0].mean()))
    t = np.arange(121) / 60
    late = slice(30, 90)  # a parabola through a second of it
    return np.array(path), 2 * float(np.polyfit(t[late], path[late], 2)[0])


def measure_momentum(bench: Bench) -> Result:
    """Momentum of cloth that flaps in free space, and of cloth that meets a free body."""
    drift, angular, times = _flap(bench.seed)
    rows = [
        Reading(
            "free cloth, change of linear momentum",
            float(drift.max()),
            "",
            bar="<= 1e-4",
            note="relative, largest of 2 s of a flapping sheet without gravity",
        ),
        Reading(
            "free cloth, change of angular momentum",
            float(angular.max()),
            "",
            note="relative, the same",
        ),
    ]
    t, cloth, box, given = _meet_box()
    scale = np.abs(cloth[0]).max()
    whole = np.linalg.norm(cloth + box + given - cloth[0], axis=1) / scale
    # the impulse of a frame, as cloth lost it and as it was reported for the body
    lost = cloth[:-1] - cloth[1:]
    told = np.diff(given + box, axis=0)
    exchanged = np.linalg.norm(lost, axis=1).sum()
    mismatch = float(np.linalg.norm(lost - told, axis=1).sum() / exchanged)
    rows += [
        Reading(
            "two-way contact, impulses on cloth and body do not cancel by",
            mismatch,
            "",
            bar="<= 1e-3",
            note="relative, summed over the frames of a sheet that hits a free box of SAPIEN",
        ),
        Reading(
            "two-way contact, change of the whole momentum",
            float(whole.max()),
            "",
            bar="<= 1e-3",
            note="relative to what the sheet brought",
        ),
    ]
    figure = Figure(
        "momentum",
        "Left: linear and angular momentum of a sheet that flaps in free space, relative "
        "change. Right: a "
        "sheet hits a free box of SAPIEN without gravity; what one loses, the other has a frame "
        "later.",
        (
            Chart(
                f"free cloth: {drift.max():.1e}",
                "time [s]",
                "relative change",
                (
                    Series(times, np.maximum(drift, 1e-9), "linear"),
                    Series(times, np.maximum(angular, 1e-9), "angular", tone=1),
                ),
                limits=(Limit(1e-4, "bar, linear"),),
                is_log_y=True,
            ),
            Chart(
                f"cloth against a box: {mismatch:.1e}",
                "time [s]",
                "momentum down [mN s]",
                (
                    Series(t, -1e3 * cloth[:, 2], "cloth"),
                    Series(t, -1e3 * (box + given)[:, 2], "box", tone=1),
                    Series(t, -1e3 * (cloth + box + given)[:, 2], "together", kind="theory"),
                ),
            ),
        ),
    )
    return Result(rows, (figure,))


def _flap(seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Relative changes of linear and angular momentum over 2 s, and the times."""
    vertices, faces = make_sheet(0.2, 0.2, EDGE)
    builder = ModelBuilder()
    builder.add_garment(vertices, faces, material=SMOOTH)
    scene = Scene(builder, SolverConfig(gravity=(0.0, 0.0, 0.0)))
    velocities = np.random.default_rng(seed).normal(0, 0.3, vertices.shape)
    velocities += np.add(np.cross([0.0, 0.0, 2.0], vertices), [0.1, -0.2, 0.3])
    scene.state.set_particles(vertices[None], velocities[None])
    mass = scene.mass[:, None]
    linear, angular = [], []
    for _ in range(121):
        linear.append((mass * scene.v).sum(axis=0))
        angular.append((mass * np.cross(scene.x, scene.v)).sum(axis=0))
        scene.step()

    def change(values: list[np.ndarray]) -> np.ndarray:
        return np.linalg.norm(np.array(values) - values[0], axis=1) / np.linalg.norm(values[0])

    return change(linear), change(angular), np.arange(121) / 60


def _meet_box() -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Throw a sheet at 0.5 m/s down on a free box without gravity.

    Returns:
        Times [s]; momentum of the cloth, of the box, and what the box is yet to receive [N s],
        shape (T, 3).
    """
    import sapien

    from dgl_physics.sapien_bridge import SapienCloth

    scene = sapien.Scene([sapien.physx.PhysxCpuSystem()])
    scene.set_timestep(1 / 60)
    actor = scene.create_actor_builder()
    actor.add_box_collision(half_size=(0.06, 0.06, 0.03), density=100.0)
    box = actor.build(name="box")
    body = box.find_component_by_type(sapien.physx.PhysxRigidDynamicComponent)
    assert isinstance(body, sapien.physx.PhysxRigidDynamicComponent)
    body.disable_gravity = True
    body.linear_damping = body.angular_damping = 0.0
    vertices, faces = make_sheet(0.2, 0.2, EDGE)
    vertices[:, 2] += 0.05
    cloth = SapienCloth([scene], config=SolverConfig(gravity=(0.0, 0.0, 0.0)), max_force=1e9)
    cloth.add_garment(vertices, faces, material=SMOOTH)
    cloth.build()
    assert cloth.model is not None
    speed = np.tile([0.0, 0.0, -0.5], (1, len(vertices), 1))
    cloth.state.set_particles(vertices[None], speed)
    mass = 1.0 / cloth.model.inverse_mass.numpy().astype(np.float64)[:, None]
    dt = cloth.config.dt
    record = []
    for _ in range(91):
        record.append(
            (
                (mass * cloth.state.get_velocities()[0]).sum(axis=0),
                body.mass * np.asarray(body.linear_velocity, dtype=float),
                dt * cloth.get_forces()[0, 0, :3].astype(float),
            )
        )
        cloth.apply_forces()
        scene.step()
        cloth.step()
    parts = np.array(record)  # (T, 3, 3)
    return np.arange(91) * dt, parts[:, 0], parts[:, 1], parts[:, 2]
