# type: ignore  # kernels are in the language of Warp
"""Bending of a sheet that hardly stretches, one linear constraint for each hinge (XPBD)."""

import warp as wp

from dgl_physics._kernels.damping import compute_damping

wp.set_module_options({"enable_backward": False, "fast_math": True})


@wp.func
def compute_denominator(compliance: wp.float32, w: wp.float32) -> wp.float32:
    """Compute the inverse of a hinge's stiffness within a pass.

    Half of the hinges that share particles with a hinge are solved before it, which relieves it by
    about half of its inverse mass where bending is smooth. With half of its inverse mass in the
    denominator smooth bending has the right stiffness to second order; with all of it, it is too
    soft. Where the substep does not resolve the stiffness, half would be over-relaxation by 2, the
    limit of stability, so all of it is used.
    """
    unresolved = w / (w + compliance)
    return compliance + w * 0.5 * (1.0 + unresolved * unresolved)


@wp.kernel
def solve_bending(
    first: wp.int32,
    dt: wp.float32,
    rate: wp.float32,
    hinges: wp.array(dtype=wp.vec4i),
    weights: wp.array(dtype=wp.vec4),
    response: wp.array(dtype=wp.vec2),
    inverse_mass: wp.array(dtype=wp.float32),
    position: wp.array(dtype=wp.vec3),
    length_before: wp.array(dtype=wp.float32),
):
    """Project the bending constraints of one colour.

    The constraint of a hinge is the vector c = sum_j K_j x_j, whose length is the edge's times the
    angle between the triangles (Bergou et al. 2006); `response` holds its compliance [m/N] and the
    relaxation time of its damping [s]. Damping acts on the change of the length of c alone, so a
    turning sheet is not damped and angular momentum is kept.
    """
    k = first + wp.tid()
    h = hinges[k]
    weight = weights[k]
    a = h[0]
    b = h[1]
    c = h[2]
    d = h[3]
    if inverse_mass[a] + inverse_mass[b] + inverse_mass[c] + inverse_mass[d] == 0.0:
        return
    xa = position[a]
    xb = position[b]
    xc = position[c]
    xd = position[d]
    fa = weight[0] * inverse_mass[a]
    fb = weight[1] * inverse_mass[b]
    fc = weight[2] * inverse_mass[c]
    fd = weight[3] * inverse_mass[d]
    bend = weight[0] * xa + weight[1] * xb + weight[2] * xc + weight[3] * xd
    w = weight[0] * fa + weight[1] * fb + weight[2] * fc + weight[3] * fd
    length = wp.length(bend)
    compliance = response[k][0] / (dt * dt)
    s = length / compute_denominator(compliance, w)
    s += compute_damping(length_before[k], length, rate * response[k][1], compliance, w)
    length_before[k] = length
    bend = bend * (-s / wp.max(length, 1.0e-12))
    position[a] = xa + bend * fa
    position[b] = xb + bend * fb
    position[c] = xc + bend * fc
    position[d] = xd + bend * fd
