# type: ignore  # kernels are in the language of Warp
"""Contact of particles with particles, of the same garment or of another.

A particle is a sphere, large enough that the spheres of a triangle leave hardly a gap for others:
while particles keep apart, layers do. See `dgl_physics.topology.compute_radii`.
"""

import warp as wp

from dgl_physics._kernels.types import SolverLimits

wp.set_module_options({"enable_backward": False, "fast_math": True})

SEARCH_AGAIN = wp.constant(0.5)
"""Share of the margin that a particle may move before its neighbours are searched for again: two
particles that approach each other by this share use up the margin."""
LOFT = wp.constant(0.1)
"""Share of the thickness over which compressed cloth stiffens, with the cube of the depth (van Wyk
1946)."""
CROWDED = wp.constant(0.75)
"""Contacts of a particle are scaled down where their sum of shares exceeds the inverse of this."""
KEPT = wp.constant(0.95)
"""Share of the crowd kept in the next pass, so that contacts do not open and close in turns."""
UNDONE = wp.constant(0.7)
"""Share of an older overlap that is undone in a substep. Up to one half no speed remains when the
overlap ends; more holds pinched cloth better and catches fewer edges, but leaves some speed."""


@wp.func
def find_cell(x: wp.vec3, size: wp.float32, env: wp.int32, count: wp.int32):
    """Hash a cubic cell of an environment to an entry of the table of stirred cells."""
    a = int(wp.floor(x[0] / size)) * 73856093
    b = int(wp.floor(x[1] / size)) * 19349663
    c = int(wp.floor(x[2] / size)) * 83492791
    return ((a ^ b) ^ (c ^ (env * 40960001))) & (count - 1)


@wp.kernel
def mark_stirred(
    interval: wp.float32,
    limits: SolverLimits,
    environment: wp.array(dtype=wp.int32),
    inverse_mass: wp.array(dtype=wp.float32),
    position: wp.array(dtype=wp.vec3),
    velocity: wp.array(dtype=wp.vec3),
    searched_at: wp.array(dtype=wp.vec3),
    stirred: wp.array(dtype=wp.int32),
    restless: wp.array(dtype=wp.int32),
):
    """Mark the cells near particles that will have moved too far by the next search.

    Searching unmarked particles too would change nothing: their lists are complete.
    """
    i = wp.tid()
    x = position[i]
    moved = wp.length(x - searched_at[i]) + interval * wp.length(velocity[i])
    least = limits.neighbour_margin * SEARCH_AGAIN
    if inverse_mass[i] > 0.0 and not (moved < least):  # also where it is not finite
        restless[environment[i]] = 1
        half = 0.5 * limits.cell_size
        for k in range(8):
            corner = wp.vec3(half, half, half)
            if (k & 1) != 0:
                corner[0] = -half
            if (k & 2) != 0:
                corner[1] = -half
            if (k & 4) != 0:
                corner[2] = -half
            cell = find_cell(x + corner, limits.cell_size, environment[i], stirred.shape[0])
            stirred[cell] = 1


@wp.kernel
def find_neighbours(
    grid: wp.uint64,
    limits: SolverLimits,
    environment: wp.array(dtype=wp.int32),
    touch: wp.array(dtype=wp.vec4),
    reach: wp.float32,
    adjacency_start: wp.array(dtype=wp.int32),
    adjacency: wp.array(dtype=wp.int32),
    stirred: wp.array(dtype=wp.int32),
    position: wp.array(dtype=wp.vec3),
    searched_at: wp.array(dtype=wp.vec3),
    neighbours: wp.array(dtype=wp.int32),
    neighbour_count: wp.array(dtype=wp.int32),
    overflow: wp.array(dtype=wp.int32),
):
    """List the particles of higher index that may touch each particle before the next search.

    Particles keep their lists where nothing near them has moved since the last search. Particles
    that the mesh holds apart are left out; those without a radius touch nothing. Lists are sorted
    by index, whatever the order of the grid.
    """
    i = wp.tid()
    env = environment[i]
    x = position[i]
    if stirred[find_cell(x, limits.cell_size, env, stirred.shape[0])] == 0:
        return
    searched_at[i] = x
    count = int(0)
    own = touch[i]
    if own[0] > 0.0:
        start = i * limits.neighbour_capacity
        first = adjacency_start[i]
        last = adjacency_start[i + 1]
        query = wp.hash_grid_query(grid, x, reach, env)
        j = int(0)
        while wp.hash_grid_query_next(query, j):
            if j <= i:
                continue
            other = touch[j]
            far = own[0] + other[0] + wp.max(own[3], other[3]) + limits.neighbour_margin
            if wp.length_sq(x - position[j]) >= far * far or other[0] == 0.0:
                continue
            is_joined = int(0)
            for k in range(first, last):
                if adjacency[k] == j:
                    is_joined = 1
            if is_joined == 1:
                continue
            if count < limits.neighbour_capacity:
                at = int(start + count)
                while at > start and neighbours[at - 1] > j:
                    neighbours[at] = neighbours[at - 1]
                    at -= 1
                neighbours[at] = j
                count += 1
            else:
                wp.atomic_add(overflow, env, 1)
    neighbour_count[i] = count


@wp.kernel
def solve_self_contact(
    dt: wp.float32,
    limits: SolverLimits,
    touch: wp.array(dtype=wp.vec4),
    inverse_mass: wp.array(dtype=wp.float32),
    position: wp.array(dtype=wp.vec3),
    previous: wp.array(dtype=wp.vec3),
    neighbours: wp.array(dtype=wp.int32),
    neighbour_count: wp.array(dtype=wp.int32),
    crowd: wp.array(dtype=wp.float32),
    correction: wp.array(dtype=wp.vec3),
    squeeze_next: wp.array(dtype=wp.vec3),
    crowd_next: wp.array(dtype=wp.float32),
):
    """Keep particles apart, with friction and adhesion.

    All pairs read the same positions and add to both particles' corrections (Jacobi), so the
    result depends on the order only by rounding, and momentum is kept. The approach within this
    substep is undone, and a share of an older overlap; most of the speed that this gives is taken
    back where the overlap ends. The contacts of a particle are scaled down by `crowd`, the sum of
    its shares in them in the last pass. Friction cancels the tangential displacement up to
    Coulomb's limit; adhesion is the paper's spring within a radius.

    `squeeze_next` gets the overlap with the neighbours, along their direction of pressure.
    """
    i = wp.tid()
    n_count = neighbour_count[i]
    if n_count == 0:
        return
    wi = inverse_mass[i]
    own = touch[i]
    x = position[i]
    moved = x - previous[i]
    own_crowd = crowd[i]
    total = wp.vec3(0.0, 0.0, 0.0)
    pressed = wp.vec3(0.0, 0.0, 0.0)
    touching = float(0.0)
    start = i * limits.neighbour_capacity
    for k in range(n_count):
        j = neighbours[start + k]
        wj = inverse_mass[j]
        if wi + wj == 0.0:
            continue
        d = x - position[j]
        other = touch[j]
        thickness = own[0] + other[0]
        reach = thickness + wp.max(own[3], other[3])
        r2 = wp.length_sq(d)
        if r2 >= reach * reach or r2 < 1.0e-16:
            continue
        r = wp.sqrt(r2)
        n = d * (1.0 / r)
        depth = thickness - r
        slip = moved - (position[j] - previous[j])
        along = wp.dot(n, slip)
        before = depth + along  # what overlapped before this substep
        inertia = 1.0 / wp.max(wi + wj, 1.0e-9)
        if depth > 0.0:
            touching += wi * inertia
            wp.atomic_add(crowd_next, j, wj * inertia)
        crowding = wp.max(1.0, CROWDED * wp.max(own_crowd, crowd[j]))
        if depth > 0.0 or before > 0.0:
            before = wp.max(before, 0.0)
            push = wp.clamp(UNDONE * before - along, -before, wp.max(depth, 0.0))
            slip = slip - n * along
            limit = 0.5 * (own[1] + other[1]) * wp.max(push, 0.0)
            length2 = wp.length_sq(slip)
            if length2 > limit * limit:
                slip = slip * (limit / wp.sqrt(length2))
            change = (n * push - slip) * (inertia / crowding)
            total += change * wi
            wp.atomic_sub(correction, j, change * wj)
            if depth > 0.0:
                loft = wp.min(depth / (LOFT * thickness), 1.0)
                press = n * (depth * loft * loft)
                pressed += press
                wp.atomic_sub(squeeze_next, j, press)
        else:
            adhesion = 0.5 * (own[2] + other[2]) * dt * dt
            pull = n * (depth / crowding)
            total += pull * wp.min(adhesion * wi, 0.1)
            wp.atomic_sub(correction, j, pull * wp.min(adhesion * wj, 0.1))
    wp.atomic_add(correction, i, total)
    wp.atomic_add(squeeze_next, i, pressed)
    wp.atomic_add(crowd_next, i, touching)


@wp.kernel
def apply_corrections(
    share: wp.float32,
    correction: wp.array(dtype=wp.vec3),
    squeeze_next: wp.array(dtype=wp.vec3),
    crowd_next: wp.array(dtype=wp.float32),
    position: wp.array(dtype=wp.vec3),
    squeeze: wp.array(dtype=wp.vec3),
    crowd: wp.array(dtype=wp.float32),
):
    """Move the particles by a share of their corrections, and reset the sums."""
    i = wp.tid()
    position[i] = position[i] + share * correction[i]
    squeeze[i] = squeeze_next[i]
    crowd[i] = wp.max(crowd_next[i], KEPT * crowd[i])
    correction[i] = wp.vec3(0.0, 0.0, 0.0)
    squeeze_next[i] = wp.vec3(0.0, 0.0, 0.0)
    crowd_next[i] = 0.0
