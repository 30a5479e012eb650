# type: ignore  # kernels are in the language of Warp
"""Integration of particles and distance constraints (XPBD)."""

import warp as wp

from dgl_physics._kernels.damping import compute_damping
from dgl_physics._kernels.types import ParticleMaterial

wp.set_module_options({"enable_backward": False, "fast_math": True})


TORN_STRETCH = wp.constant(3.0)
"""Stretch beyond which an edge slips out of every grip."""


@wp.kernel
def integrate(
    gravity: wp.vec3,
    gravity_scale: wp.array(dtype=wp.float32),
    dt: wp.float32,
    environment: wp.array(dtype=wp.int32),
    garment: wp.array(dtype=wp.int32),
    materials: wp.array(dtype=ParticleMaterial),
    inverse_mass: wp.array(dtype=wp.float32),
    position: wp.array(dtype=wp.vec3),
    velocity: wp.array(dtype=wp.vec3),
    previous: wp.array(dtype=wp.vec3),
):
    """Advance particles freely by one substep and remember where they came from."""
    i = wp.tid()
    x = position[i]
    previous[i] = x
    if inverse_mass[i] == 0.0:
        return
    v = velocity[i] + gravity * (gravity_scale[environment[i]] * dt)
    v = v / (1.0 + materials[garment[i]].drag * dt)
    velocity[i] = v
    position[i] = x + v * dt


@wp.kernel
def solve_distances(
    first: wp.int32,
    inverse_dt2: wp.float32,
    pairs: wp.array(dtype=wp.vec2i),
    rest_length: wp.array(dtype=wp.float32),
    compliance: wp.array(dtype=wp.float32),
    inverse_mass: wp.array(dtype=wp.float32),
    position: wp.array(dtype=wp.vec3),
    damping_rate: wp.float32,
    garment: wp.array(dtype=wp.int32),
    materials: wp.array(dtype=ParticleMaterial),
    length_before: wp.array(dtype=wp.float32),
    is_torn: wp.array(dtype=wp.int32),
):
    """Project the distance constraints of one colour (Macklin et al. 2016, XPBD, eq. 18).

    One iteration per substep, so the multiplier starts at zero and need not be stored
    (Macklin et al. 2019, Small Steps). A negative `damping_rate` switches damping off and leaves
    `length_before` alone. Particles of an edge beyond `TORN_STRETCH` are marked in `is_torn`.
    """
    c = first + wp.tid()
    i = pairs[c][0]
    j = pairs[c][1]
    wi = inverse_mass[i]
    wj = inverse_mass[j]
    d = position[i] - position[j]
    length = wp.length(d)
    w = wi + wj
    if w > 0.0 and length > 1.0e-9:
        soft = compliance[c] * inverse_dt2
        s = (rest_length[c] - length) / (w + soft)
        if damping_rate >= 0.0:
            steps = damping_rate * materials[garment[i]].stretch_damping
            s -= compute_damping(length_before[c], length, steps, soft, w)
            length_before[c] = length
        if length > TORN_STRETCH * rest_length[c]:
            is_torn[i] = 1
            is_torn[j] = 1
        s = s / length
        position[i] = position[i] + d * (s * wi)
        position[j] = position[j] - d * (s * wj)
