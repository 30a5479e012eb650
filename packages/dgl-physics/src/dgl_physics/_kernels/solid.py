# type: ignore  # kernels are in the language of Warp
"""Elastic solids: one implicit step of tetrahedral stable neo-Hookean elements.

Solids have rows of their own: a row for each particle, in the order of the factor.
"""

import warp as wp

from dgl_physics._kernels.types import ParticleMaterial

wp.set_module_options({"enable_backward": False, "fast_math": True})


@wp.struct
class Elements:
    """Tetrahedra of all solids."""

    rows: wp.array(dtype=wp.vec4i)
    inverse_shape: wp.array(dtype=wp.mat33)
    """Inverse of the rest shape's edge matrix [1/m]."""
    volume: wp.array(dtype=wp.float32)
    moduli: wp.array(dtype=wp.vec2)
    """Coefficients mu and lambda of the energy [Pa], see `compute_element_forces`."""


@wp.struct
class Bodies:
    """Solids, and the rows of the factors that they share."""

    first_row: wp.array(dtype=wp.int32)
    row_count: wp.array(dtype=wp.int32)
    factor_row: wp.array(dtype=wp.int32)
    is_free: wp.array(dtype=wp.int32)
    """1 if no particle is pinned, so that angular momentum is kept."""
    entry_start: wp.array(dtype=wp.int32)
    """Of each row of a factor, its first entry."""
    column_start: wp.array(dtype=wp.int32)
    entries: wp.array(dtype=wp.float32)
    """Rows from their first non-zero column on; the last entry is one over the diagonal's."""
    inverse_start: wp.array(dtype=wp.int32)
    """First entry of each solid's inverse."""
    inverse: wp.array(dtype=wp.float32)
    """Dense inverses, row by row [1/kg]."""


@wp.kernel
def predict(
    gravity: wp.vec3,
    gravity_scale: wp.array(dtype=wp.float32),
    dt: wp.float32,
    particle: wp.array(dtype=wp.int32),
    damping: wp.array(dtype=wp.float32),
    environment: wp.array(dtype=wp.int32),
    garment: wp.array(dtype=wp.int32),
    materials: wp.array(dtype=ParticleMaterial),
    inverse_mass: wp.array(dtype=wp.float32),
    position: wp.array(dtype=wp.vec3),
    velocity: wp.array(dtype=wp.vec3),
    trial: wp.array(dtype=wp.vec3),
    fall: wp.array(dtype=wp.vec3),
):
    """Predict the positions at which elastic forces are evaluated.

    They leave out gravity of this substep, because forces balance without it at rest. They are
    ahead by the damping's time constant, which gives stiffness-proportional damping.
    """
    r = wp.tid()
    i = particle[r]
    x = position[i]
    g = wp.vec3(0.0, 0.0, 0.0)
    if inverse_mass[i] > 0.0:
        g = gravity * (
            gravity_scale[environment[i]] * dt * wp.exp(-materials[garment[i]].drag * dt)
        )
        x = x - g * dt + (velocity[i] - g) * damping[r]
    trial[r] = x
    fall[r] = g * dt


@wp.kernel
def compute_element_forces(
    elements: Elements,
    trial: wp.array(dtype=wp.vec3),
    forces: wp.array(dtype=wp.mat33),
):
    """Compute the forces of an element on its corners 1, 2, 3, as columns [N].

    Energy mu/2 (|F|^2 - 3) + lambda/2 (J - a)^2 - mu/2 log(|F|^2 + 1) with a = 1 + 3/4 mu/lambda
    (Smith, de Goes and Kim 2018, Stable Neo-Hookean Flesh Simulation, eq. 14). It is finite for
    every F, also inverted ones. Without the logarithm an element of small Poisson's ratio that is
    squeezed to a point would stay there.
    """
    t = wp.tid()
    k = elements.rows[t]
    a = trial[k[0]]
    f = (
        wp.matrix_from_cols(trial[k[1]] - a, trial[k[2]] - a, trial[k[3]] - a)
        * elements.inverse_shape[t]
    )
    c0 = wp.vec3(f[0, 0], f[1, 0], f[2, 0])
    c1 = wp.vec3(f[0, 1], f[1, 1], f[2, 1])
    c2 = wp.vec3(f[0, 2], f[1, 2], f[2, 2])
    cofactor = wp.matrix_from_cols(wp.cross(c1, c2), wp.cross(c2, c0), wp.cross(c0, c1))
    volume_ratio = wp.dot(c0, wp.cross(c1, c2))
    m = elements.moduli[t]
    # Beyond twofold stretch the stiffness against change of volume exceeds that of the factor,
    # with the square of the cofactor: bound it.
    bound = 1.0 / wp.max(1.0, wp.ddot(cofactor, cofactor) / 12.0)
    pressure = (m[1] * (volume_ratio - 1.0) - 0.75 * m[0]) * bound
    stress = (m[0] * (1.0 - 1.0 / (wp.ddot(f, f) + 1.0))) * f + pressure * cofactor
    forces[t] = (-elements.volume[t] * stress) * wp.transpose(elements.inverse_shape[t])


@wp.kernel
def gather_forces(
    dt: wp.float32,
    incident_start: wp.array(dtype=wp.int32),
    incident: wp.array(dtype=wp.int32),
    mass: wp.array(dtype=wp.float32),
    fall: wp.array(dtype=wp.vec3),
    forces: wp.array(dtype=wp.mat33),
    step: wp.array(dtype=wp.vec3),
):
    """Compute the right side: mass times fall plus dt^2 times elastic force.

    Each row gathers its own terms, so the sum has the same order everywhere.
    """
    r = wp.tid()
    total = wp.vec3(0.0, 0.0, 0.0)
    m = mass[r]
    if m > 0.0:  # a pinned row is not moved
        for k in range(incident_start[r], incident_start[r + 1]):
            f = forces[incident[k] // 4]
            corner = incident[k] % 4
            if corner == 0:
                total -= wp.vec3(
                    f[0, 0] + f[0, 1] + f[0, 2],
                    f[1, 0] + f[1, 1] + f[1, 2],
                    f[2, 0] + f[2, 1] + f[2, 2],
                )
            else:
                total += wp.vec3(f[0, corner - 1], f[1, corner - 1], f[2, corner - 1])
        total = total * (dt * dt) + fall[r] * m
    step[r] = total


@wp.kernel
def find_levers(
    bodies: Bodies,
    particle: wp.array(dtype=wp.int32),
    mass: wp.array(dtype=wp.float32),
    previous: wp.array(dtype=wp.vec3),
    arm: wp.array(dtype=wp.vec3),
    lever: wp.array(dtype=wp.vec3),
):
    """Compute arms from the centre of mass of free solids [m], and mass times arm.

    Taken at the beginning of the substep: the angular momentum after it is the sum of m x0 x v.
    """
    b = wp.tid()
    first = bodies.first_row[b]
    count = bodies.row_count[b]
    centre = wp.vec3(0.0, 0.0, 0.0)
    total = float(0.0)
    for k in range(first, first + count):
        centre += previous[particle[k]] * mass[k]
        total += mass[k]
    if total > 0.0:
        centre = centre / total
    for k in range(first, first + count):
        if bodies.is_free[b] == 1:
            arm[k] = previous[particle[k]] - centre
        else:
            arm[k] = wp.vec3(0.0, 0.0, 0.0)
        lever[k] = arm[k] * mass[k]


@wp.kernel
def substitute(
    bodies: Bodies,
    contact_count: wp.array(dtype=wp.int32),
    is_for_contact: wp.int32,
    vector: wp.array(dtype=wp.vec3),
):
    """Solve with the factor in place, one thread a solid.

    For contact, solids without contacts are left out: their right side is zero.
    """
    b = wp.tid()
    if is_for_contact == 1 and contact_count[b] == 0:
        return
    first = bodies.first_row[b]
    count = bodies.row_count[b]
    base = bodies.factor_row[b]
    for k in range(count):
        column = bodies.column_start[base + k]
        at = bodies.entry_start[base + k]
        y = vector[first + k]
        for j in range(k - column):
            y -= bodies.entries[at + j] * vector[first + column + j]
        vector[first + k] = y * bodies.entries[at + k - column]
    for kk in range(count):
        k = count - 1 - kk
        column = bodies.column_start[base + k]
        at = bodies.entry_start[base + k]
        y = vector[first + k] * bodies.entries[at + k - column]
        vector[first + k] = y
        for j in range(k - column):
            vector[first + column + j] = vector[first + column + j] - bodies.entries[at + j] * y


@wp.kernel
def level_step(
    bodies: Bodies,
    mass: wp.array(dtype=wp.float32),
    arm: wp.array(dtype=wp.vec3),
    lever: wp.array(dtype=wp.vec3),
    inverse_inertia: wp.array(dtype=wp.mat33),
    turning: wp.array(dtype=wp.mat33),
    step: wp.array(dtype=wp.vec3),
):
    """Remove the rotation from the step of free solids: weight and elasticity cause none.

    The rotation that adhesion causes is neglected. The factor would give rotations the inertia of
    a stretch, so they are split off with the true inertia. `turning` maps a rotation to the
    angular momentum of the factor's response to it.
    """
    b = wp.tid()
    zero = wp.mat33(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    inertia = wp.mat33(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    answer = wp.mat33(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    one = wp.identity(n=3, dtype=float)
    momentum = wp.vec3(0.0, 0.0, 0.0)
    inverse_inertia[b] = zero
    turning[b] = zero
    if bodies.is_free[b] == 0:
        return
    first = bodies.first_row[b]
    last = first + bodies.row_count[b]
    for k in range(first, last):
        d = arm[k]
        g = lever[k]
        m = mass[k]
        inertia += (wp.dot(d, d) * one - wp.outer(d, d)) * m
        answer += (wp.dot(d, g) * one - wp.outer(g, d)) * m
        momentum += wp.cross(d, step[k]) * m
    inertia = wp.inverse(inertia)
    inverse_inertia[b] = inertia
    turning[b] = answer
    turn = inertia * momentum
    for k in range(first, last):
        step[k] = step[k] - wp.cross(turn, arm[k])


@wp.kernel
def move_bodies(
    bodies: Bodies,
    particle: wp.array(dtype=wp.int32),
    mass: wp.array(dtype=wp.float32),
    inverse_mass: wp.array(dtype=wp.float32),
    arm: wp.array(dtype=wp.vec3),
    lever: wp.array(dtype=wp.vec3),
    inverse_inertia: wp.array(dtype=wp.mat33),
    fall: wp.array(dtype=wp.vec3),
    step: wp.array(dtype=wp.vec3),
    contact_count: wp.array(dtype=wp.int32),
    push: wp.array(dtype=wp.vec3),
    shift: wp.array(dtype=wp.vec3),
    position: wp.array(dtype=wp.vec3),
):
    """Move the particles by the step and by the shift of contact.

    Pinned and sleeping particles, which have no inverse mass, stay.
    """
    b = wp.tid()
    first = bodies.first_row[b]
    last = first + bodies.row_count[b]
    is_touched = contact_count[b] > 0
    turn = wp.vec3(0.0, 0.0, 0.0)
    excess = wp.vec3(0.0, 0.0, 0.0)
    if is_touched:
        for k in range(first, last):
            turn += wp.cross(arm[k], push[k])
        turn = inverse_inertia[b] * turn
        for k in range(first, last):
            rest = shift[k] - wp.cross(turn, lever[k])
            shift[k] = rest
            excess += wp.cross(arm[k], rest) * mass[k]
        excess = inverse_inertia[b] * excess
    for k in range(first, last):
        if inverse_mass[particle[k]] > 0.0:
            d = step[k] - fall[k]
            if is_touched:
                d += shift[k] + wp.cross(turn - excess, arm[k])
            position[particle[k]] = position[particle[k]] + d
