# type: ignore  # kernels are in the language of Warp
"""Yarns along warp and weft, one constraint each in every triangle (XPBD)."""

import warp as wp

from dgl_physics._kernels.damping import compute_damping

wp.set_module_options({"enable_backward": False, "fast_math": True})


@wp.kernel
def solve_yarns(
    first: wp.int32,
    dt: wp.float32,
    rate: wp.float32,
    triangles: wp.array(dtype=wp.vec4i),
    gradients: wp.array(dtype=wp.vec4),
    response: wp.array(dtype=wp.vec2),
    inverse_mass: wp.array(dtype=wp.float32),
    position: wp.array(dtype=wp.vec3),
    length_before: wp.array(dtype=wp.vec2),
):
    """Project the weft and then the warp yarns of the triangles of one colour.

    A yarn is a unit vector of the flat rest as the triangle has deformed it; its length is one at
    rest. `gradients` holds its change with the second and third corner [1/m], for weft and warp,
    and `response` the compliance [1/(N m)] and the relaxation time of the damping [s].
    """
    k = first + wp.tid()
    t = triangles[k]
    g = gradients[k]
    a = t[0]
    b = t[1]
    c = t[2]
    wa = inverse_mass[a]
    wb = inverse_mass[b]
    wc = inverse_mass[c]
    if wa + wb + wc == 0.0:
        return
    xa = position[a]
    xb = position[b]
    xc = position[c]
    compliance = response[k][0] / (dt * dt)
    steps = rate * response[k][1]
    before = length_before[k]

    ga = -(g[0] + g[1])
    w = wa * ga * ga + wb * g[0] * g[0] + wc * g[1] * g[1]
    yarn = (xb - xa) * g[0] + (xc - xa) * g[1]
    weft = wp.length(yarn)
    s = (weft - 1.0) / (compliance + w) + compute_damping(before[0], weft, steps, compliance, w)
    yarn = yarn * (-s / wp.max(weft, 1.0e-6))
    xa += yarn * (wa * ga)
    xb += yarn * (wb * g[0])
    xc += yarn * (wc * g[1])

    ga = -(g[2] + g[3])
    w = wa * ga * ga + wb * g[2] * g[2] + wc * g[3] * g[3]
    yarn = (xb - xa) * g[2] + (xc - xa) * g[3]
    warp = wp.length(yarn)
    s = (warp - 1.0) / (compliance + w) + compute_damping(before[1], warp, steps, compliance, w)
    yarn = yarn * (-s / wp.max(warp, 1.0e-6))
    position[a] = xa + yarn * (wa * ga)
    position[b] = xb + yarn * (wb * g[2])
    position[c] = xc + yarn * (wc * g[3])
    length_before[k] = wp.vec2(weft, warp)
