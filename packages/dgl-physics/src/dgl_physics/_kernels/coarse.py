# type: ignore  # kernels are in the language of Warp
"""The coarse level: patches of cloth whose centres have a largest distance."""

import warp as wp

wp.set_module_options({"enable_backward": False, "fast_math": True})


@wp.func
def weigh(
    k: wp.int32,
    node_particle: wp.array(dtype=wp.int32),
    node_weight: wp.array(dtype=wp.float32),
    inverse_mass: wp.array(dtype=wp.float32),
    is_stuck: wp.array(dtype=wp.int32),
    position: wp.array(dtype=wp.vec3),
):
    """Compute a particle's share of its node's centre, and the same share if it is held."""
    i = node_particle[k]
    x = position[i]
    is_held = float(0.0)
    if is_stuck[i] != 0 or inverse_mass[i] == 0.0:
        is_held = 1.0
    return node_weight[k] * wp.vec4(x[0], x[1], x[2], is_held)


@wp.kernel
def gather_nodes(
    node_start: wp.array(dtype=wp.int32),
    node_particle: wp.array(dtype=wp.int32),
    node_weight: wp.array(dtype=wp.float32),
    node_inverse_mass: wp.array(dtype=wp.float32),
    inverse_mass: wp.array(dtype=wp.float32),
    is_stuck: wp.array(dtype=wp.int32),
    position: wp.array(dtype=wp.vec3),
    centre: wp.array(dtype=wp.vec3),
    centre_before: wp.array(dtype=wp.vec3),
    mobility: wp.array(dtype=wp.float32),
    held: wp.array(dtype=wp.float32),
    reaction: wp.array(dtype=wp.vec3),
):
    """Compute the nodes' centres of mass; a node with a particle that is held does not move.

    `held` gets the share of the held particles in the centre. Sums have four parts, as in the
    vector code.
    """
    c = wp.tid()
    k = node_start[c]
    last = node_start[c + 1]
    s0 = wp.vec4(0.0, 0.0, 0.0, 0.0)
    s1 = wp.vec4(0.0, 0.0, 0.0, 0.0)
    s2 = wp.vec4(0.0, 0.0, 0.0, 0.0)
    s3 = wp.vec4(0.0, 0.0, 0.0, 0.0)
    while k + 4 <= last:
        s0 += weigh(k, node_particle, node_weight, inverse_mass, is_stuck, position)
        s1 += weigh(k + 1, node_particle, node_weight, inverse_mass, is_stuck, position)
        s2 += weigh(k + 2, node_particle, node_weight, inverse_mass, is_stuck, position)
        s3 += weigh(k + 3, node_particle, node_weight, inverse_mass, is_stuck, position)
        k += 4
    while k < last:
        s0 += weigh(k, node_particle, node_weight, inverse_mass, is_stuck, position)
        k += 1
    total = (s0 + s1) + (s2 + s3)
    held[c] = total[3]
    w = node_inverse_mass[c]
    if total[3] > 0.0:
        w = 0.0
    mobility[c] = w
    reaction[c] = wp.vec3(0.0, 0.0, 0.0)
    centre[c] = wp.vec3(total[0], total[1], total[2])
    centre_before[c] = wp.vec3(total[0], total[1], total[2])


@wp.kernel
def solve_limits(
    first: wp.int32,
    pairs: wp.array(dtype=wp.vec2i),
    limit: wp.array(dtype=wp.float32),
    mobility: wp.array(dtype=wp.float32),
    centre: wp.array(dtype=wp.vec3),
    reaction: wp.array(dtype=wp.vec3),
):
    """Bring nodes that are too far from each other to their largest distance.

    The pull on a held node goes to `reaction`, mass times displacement [kg m].
    """
    c = first + wp.tid()
    i = pairs[c][0]
    j = pairs[c][1]
    wi = mobility[i]
    wj = mobility[j]
    w = wi + wj
    if w > 0.0:
        d = centre[i] - centre[j]
        length = wp.length(d)
        if length > limit[c]:
            pull = d * ((limit[c] - length) / (length * w))
            centre[i] = centre[i] + pull * wi
            centre[j] = centre[j] - pull * wj
            if wi == 0.0:
                reaction[i] = reaction[i] + pull
            if wj == 0.0:
                reaction[j] = reaction[j] - pull


@wp.kernel
def move_with_nodes(
    farthest: wp.float32,
    nodes: wp.array(dtype=wp.vec4i),
    weights: wp.array(dtype=wp.vec4),
    node_inverse_mass: wp.array(dtype=wp.float32),
    inverse_mass: wp.array(dtype=wp.float32),
    is_stuck: wp.array(dtype=wp.int32),
    centre: wp.array(dtype=wp.vec3),
    centre_before: wp.array(dtype=wp.vec3),
    held: wp.array(dtype=wp.float32),
    reaction: wp.array(dtype=wp.vec3),
    position: wp.array(dtype=wp.vec3),
    tension: wp.array(dtype=wp.vec3),
):
    """Move the particles by the weighted displacements of their nodes.

    Held particles stay; the pull on them goes to `tension`, as the displacement that it would have
    given to them alone.
    """
    i = wp.tid()
    tension[i] = wp.vec3(0.0, 0.0, 0.0)
    if inverse_mass[i] == 0.0:
        return
    moved = wp.vec3(0.0, 0.0, 0.0)
    if is_stuck[i] != 0:
        for k in range(4):
            c = nodes[i][k]
            if c >= 0:
                # its share of the held mass is weight / inverse mass; times the latter
                moved += reaction[c] * (weights[i][k] * node_inverse_mass[c] / held[c])
        tension[i] = moved
        return
    for k in range(4):
        c = nodes[i][k]
        if c >= 0:
            moved += weights[i][k] * (centre[c] - centre_before[c])
    # Limits that cannot be met must not throw particles.
    length = wp.length(moved)
    if length > farthest:
        moved = moved * (farthest / length)
    position[i] = position[i] + moved
