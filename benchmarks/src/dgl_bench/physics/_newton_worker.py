"""Hangs a panel in Newton; run by the interpreter that has it.

Needs Newton, Warp and NumPy and nothing else. Arguments: the panel (npz), the number of frames, the
solver ("xpbd" or "vbd"), and the numbers of its substeps and iterations. Writes one line of JSON.
"""

# Newton is an optional extra.
# pyright: reportMissingImports=false, reportAttributeAccessIssue=false
import json
import sys
import time

import newton
import numpy as np
import warp as wp

XPBD_STIFFNESS = 0.02
"""Of a spring [N/m], times the square of the substeps: 2 N/m at ten. Newton's XPBD adds up the
corrections that a
particle gets from its springs, so stiff ones blow up: on this mesh twice as stiff ones do, with any
damping."""

VBD_MARGIN = 0.003
"""Distance at which triangles touch [m]. Theirs need not be as thick as our spheres, and a margin
near the length of the edges costs ten times as much."""


def main() -> None:
    """Simulate, time and measure."""
    path, kind = sys.argv[1], sys.argv[3]
    frames, substeps, iterations = (int(sys.argv[k]) for k in (2, 4, 5))
    panel = np.load(path)
    with wp.ScopedDevice("cpu"):
        result = _hang(panel, frames, kind, substeps, iterations)
    json.dump({"version": newton.__version__, **result}, sys.stdout)


def _hang(panel: dict, frames: int, kind: str, substeps: int, iterations: int) -> dict:
    builder = newton.ModelBuilder()
    vertices, faces = panel["vertices"], panel["faces"]
    stiffness, thickness = float(panel["stretch_stiffness"]), float(panel["thickness"])
    springs = {"tri_ke": 0.0, "tri_ka": 0.0, "tri_kd": 0.0}
    triangles = {"tri_ke": stiffness, "tri_ka": stiffness, "tri_kd": 1e-2}
    builder.add_cloth_mesh(
        pos=wp.vec3(0.0, 0.0, 0.0),
        rot=wp.quat_identity(),
        scale=1.0,
        vel=wp.vec3(0.0, 0.0, 0.0),
        vertices=[wp.vec3(*v) for v in vertices.tolist()],
        indices=faces.ravel().tolist(),
        density=float(panel["area_density"]),
        edge_ke=1e-3,
        edge_kd=0.0,
        particle_radius=thickness / 2,
        **(springs if kind == "xpbd" else triangles),
    )
    for i in panel["pinned"].tolist():
        builder.particle_mass[i] = 0.0
        builder.particle_flags[i] &= ~int(newton.ParticleFlags.ACTIVE)
    if kind == "xpbd":
        for i, j in panel["edges"].tolist():
            builder.add_spring(i, j, ke=XPBD_STIFFNESS * substeps**2, kd=0.0, control=0.0)
    else:
        builder.color(include_bending=True)
    model = builder.finalize()
    if kind == "xpbd":
        solver = newton.solvers.SolverXPBD(model, iterations=iterations)
    else:
        solver = newton.solvers.SolverVBD(
            model,
            iterations=iterations,
            particle_enable_self_contact=True,
            particle_self_contact_margin=VBD_MARGIN,
            particle_self_contact_gap=VBD_MARGIN / 2,
            particle_rest_shape_contact_exclusion_radius=1.5 * VBD_MARGIN,
        )
    states, control = [model.state(), model.state()], model.control()
    dt = 1 / 60 / substeps

    def simulate() -> None:
        for _ in range(substeps):
            states[0].clear_forces()
            solver.step(states[0], states[1], control, None, dt)
            states.reverse()

    start = [wp.clone(states[0].particle_q), wp.clone(states[0].particle_qd)]
    simulate()  # compiles
    for state in states:
        state.particle_q.assign(start[0])
        state.particle_qd.assign(start[1])
    with wp.ScopedCapture() as capture:
        simulate()
    graph = capture.graph
    assert graph is not None
    for state in states:
        state.particle_q.assign(start[0])
        state.particle_qd.assign(start[1])
    edges = panel["edges"]
    rest = np.linalg.norm(vertices[edges[:, 0]] - vertices[edges[:, 1]], axis=1)
    seconds, means, tails = [], [], []
    for _ in range(frames):
        started = time.process_time()
        wp.capture_launch(graph)
        seconds.append(time.process_time() - started)
        ends = states[0].particle_q.numpy()[edges].astype(float)
        strain = 100 * np.abs(np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1) / rest - 1)
        means.append(float(strain.mean()))
        tails.append(float(np.percentile(strain, 99.9)))
    is_finite = bool(np.isfinite(states[0].particle_q.numpy()).all())
    return {
        "is_finite": is_finite,
        "seconds": seconds,
        "means": [m if np.isfinite(m) else None for m in means],
        "tails": [t if np.isfinite(t) else None for t in tails],
    }


if __name__ == "__main__":
    main()
