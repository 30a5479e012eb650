# type: ignore  # kernels are in the language of Warp
"""Contact of the middles of edges with rigid shapes, which stops shapes thinner than a triangle."""

import warp as wp

from dgl_physics._kernels.hit import find_drift, find_hit
from dgl_physics._kernels.types import ParticleMaterial, ShapeTable, SolverLimits

wp.set_module_options({"enable_backward": False, "fast_math": True})

REST_SHARE = wp.constant(0.25)
"""Share of the rest offset at which the middle of an edge rests. Over a finger the middle of a
12 mm edge lies 1.4 mm lower than its ends, and must stay there."""


@wp.func
def is_listed(near: wp.array(dtype=wp.int32), first: wp.int32, count: wp.int32, k: wp.int32):
    """Find the shape `k` in the list of `count` shapes that begins at `first`; 1 or 0."""
    found = int(0)
    for c in range(count):
        if near[first + c] == k:
            found = 1
    return found


@wp.func
def solve_edge(
    i: wp.int32,
    j: wp.int32,
    dt: wp.float32,
    particles_per_env: wp.int32,
    limits: SolverLimits,
    shapes: ShapeTable,
    m: ParticleMaterial,
    inverse_mass: wp.array(dtype=wp.float32),
    active: wp.array2d(dtype=wp.int32),
    pose_before: wp.array2d(dtype=wp.transform),
    pose_now: wp.array2d(dtype=wp.transform),
    near: wp.array(dtype=wp.int32),
    near_bodies: wp.array(dtype=wp.int32),
    previous: wp.array(dtype=wp.vec3),
    position: wp.array(dtype=wp.vec3),
    impulse: wp.array2d(dtype=wp.spatial_vector),
):
    """Push the middle of the edge `i`, `j` out of the shapes near its ends, one after another."""
    w = inverse_mass[i] + inverse_mass[j]
    if w == 0.0 or m.is_solid == 1:
        return
    e = i // particles_per_env
    pair = wp.vec2i(i, j)
    for end in range(2):
        particle = pair[end]
        for c in range(near_bodies[particle]):
            k = near[particle * limits.near_capacity + c]
            is_again = int(0)
            if end == 1:
                is_again = is_listed(near, i * limits.near_capacity, near_bodies[i], k)
            if is_again == 0:
                s = active[e, k]
                middle = 0.5 * (position[i] + position[j])
                hit = find_hit(shapes, s, pose_now[e, k], middle)
                depth = REST_SHARE * m.rest_offset - hit.distance
                if depth > 0.0:
                    n = hit.normal
                    drift = find_drift(shapes, s, pose_before[e, k], hit)
                    slip = (middle - 0.5 * (previous[i] + previous[j])) - drift
                    along = wp.dot(n, slip)
                    slip = slip - n * along
                    length = wp.length(slip)
                    limit = m.friction * shapes.friction[s] * depth
                    if length > limit:
                        slip = slip * (limit / length)
                    # the middle moves by the half of what both ends move by together
                    share = (n * depth - slip) * (2.0 / w)
                    position[i] = position[i] + share * inverse_mass[i]
                    position[j] = position[j] + share * inverse_mass[j]
                    old = depth - wp.max(-along, 0.0) - limits.separation_speed * dt
                    if old > 0.0:
                        moved = n * (old * 2.0 / w)
                        previous[i] = previous[i] + moved * inverse_mass[i]
                        previous[j] = previous[j] + moved * inverse_mass[j]
                    if shapes.is_measured[s] == 1:
                        given = share * (-2.0 / dt)
                        wp.atomic_add(
                            impulse, e, s, wp.spatial_vector(given, wp.cross(hit.surface, given))
                        )


@wp.kernel
def solve_edge_contact(
    first: wp.int32,
    dt: wp.float32,
    particles_per_env: wp.int32,
    limits: SolverLimits,
    shapes: ShapeTable,
    pairs: wp.array(dtype=wp.vec2i),
    garment: wp.array(dtype=wp.int32),
    materials: wp.array(dtype=ParticleMaterial),
    inverse_mass: wp.array(dtype=wp.float32),
    active: wp.array2d(dtype=wp.int32),
    pose_before: wp.array2d(dtype=wp.transform),
    pose_now: wp.array2d(dtype=wp.transform),
    near: wp.array(dtype=wp.int32),
    near_bodies: wp.array(dtype=wp.int32),
    previous: wp.array(dtype=wp.vec3),
    position: wp.array(dtype=wp.vec3),
    impulse: wp.array2d(dtype=wp.spatial_vector),
):
    """Resolve the contact of the middles of the edges of one colour, with Coulomb friction.

    An edge meets the shapes near one of its ends, except planes, which its ends meet first. An
    older overlap beyond `separation_speed` moves `previous` too, so that it gives no velocity.
    """
    pair = pairs[first + wp.tid()]
    i = pair[0]
    j = pair[1]
    if near_bodies[i] + near_bodies[j] > 0:
        solve_edge(
            i, j, dt, particles_per_env, limits, shapes, materials[garment[i]], inverse_mass,
            active, pose_before, pose_now, near, near_bodies, previous, position, impulse,
        )  # fmt: skip


@wp.kernel
def list_near_edges(
    pairs: wp.array(dtype=wp.vec2i),
    near_bodies: wp.array(dtype=wp.int32),
    listed: wp.array(dtype=wp.int32),
    listed_count: wp.array(dtype=wp.int32),
):
    """List the edges with an end near a shape other than a plane, in one thread (CPU)."""
    count = int(0)
    for edge in range(pairs.shape[0]):
        pair = pairs[edge]
        if near_bodies[pair[0]] + near_bodies[pair[1]] > 0:
            listed[count] = edge
            count += 1
    listed_count[0] = count


@wp.kernel
def solve_listed_edges(
    listed: wp.array(dtype=wp.int32),
    listed_count: wp.array(dtype=wp.int32),
    dt: wp.float32,
    particles_per_env: wp.int32,
    limits: SolverLimits,
    shapes: ShapeTable,
    pairs: wp.array(dtype=wp.vec2i),
    garment: wp.array(dtype=wp.int32),
    materials: wp.array(dtype=ParticleMaterial),
    inverse_mass: wp.array(dtype=wp.float32),
    active: wp.array2d(dtype=wp.int32),
    pose_before: wp.array2d(dtype=wp.transform),
    pose_now: wp.array2d(dtype=wp.transform),
    near: wp.array(dtype=wp.int32),
    near_bodies: wp.array(dtype=wp.int32),
    previous: wp.array(dtype=wp.vec3),
    position: wp.array(dtype=wp.vec3),
    impulse: wp.array2d(dtype=wp.spatial_vector),
):
    """Resolve the contact of the edges of `list_near_edges`, in one thread (CPU)."""
    for k in range(listed_count[0]):
        pair = pairs[listed[k]]
        i = pair[0]
        j = pair[1]
        solve_edge(
            i, j, dt, particles_per_env, limits, shapes, materials[garment[i]], inverse_mass,
            active, pose_before, pose_now, near, near_bodies, previous, position, impulse,
        )  # fmt: skip
