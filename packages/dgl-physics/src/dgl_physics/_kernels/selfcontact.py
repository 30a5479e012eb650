"""Contact of particles with particles, of the same garment or of another.

A particle stands for a disc of the surface around it. Two discs that face each other keep the
thickness of the cloth between their planes, on the sides on which they were when the frame began:
layers lie on each other as smooth sheets do, and what is pushed through within a frame comes back.
"""

# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false, reportIndexIssue=false
# pyright: reportOperatorIssue=false, reportArgumentType=false, reportCallIssue=false
import warp as wp

from dgl_physics._kernels.types import Limits, Material

wp.set_module_options({"enable_backward": False, "fast_math": True})

SEARCH_AGAIN = wp.constant(0.333)
"""Share of the margin that a particle may move before its environment is searched again."""
SOFT = wp.constant(0.125)
"""Share of the thickness that cloth is compressed by without resistance."""
COVER = wp.constant(1.333)
"""Makes the weights of the discs that a particle lies on add up to about 1."""
CROWDED = wp.constant(0.6)
"""Contacts count less where their weights add up to more than the inverse of this."""
GIVEN_UP = wp.constant(0.5)
"""Discs that are through each other by this share of the thickness stay so, as they would knot;
not where fingers squeeze them."""
UNDONE = wp.constant(0.5)
"""Share of an older overlap that is undone in a substep."""
ABOVE_OTHER = wp.constant(1)
"""Bit of a contact's side: the particle is on the outer side of its neighbour's disc."""
BELOW_OTHER = wp.constant(2)
"""Bit of a contact's side: the neighbour is on the outer side of the particle's disc."""


@wp.kernel
def compute_normals(
    ring_start: wp.array(dtype=wp.int32),
    ring: wp.array(dtype=wp.vec2i),
    position: wp.array(dtype=wp.vec3),
    normal: wp.array(dtype=wp.vec3),
):
    """Compute the unit normal of the surface at each particle, weighted by the areas around it."""
    i = wp.tid()
    x = position[i]
    total = wp.vec3(0.0, 0.0, 0.0)
    for k in range(ring_start[i], ring_start[i + 1]):
        total += wp.cross(position[ring[k][0]] - x, position[ring[k][1]] - x)
    normal[i] = wp.normalize(total)


@wp.func
def find_side(over_i: wp.float32, over_j: wp.float32):
    """Sides of two discs as they are now, from the vector from j to i along the normals of both."""
    side = int(0)
    if over_j > 0.0:
        side += ABOVE_OTHER
    if over_i < 0.0:
        side += BELOW_OTHER
    return side


@wp.func
def find_cell(x: wp.vec3, size: wp.float32, env: wp.int32, count: wp.int32):
    """Entry of the table of stirred places, for a cubic cell of an environment."""
    a = int(wp.floor(x[0] / size)) * 73856093
    b = int(wp.floor(x[1] / size)) * 19349663
    c = int(wp.floor(x[2] / size)) * 83492791
    return ((a ^ b) ^ (c ^ (env * 40960001))) & (count - 1)


@wp.kernel
def mark_stirred(
    limits: Limits,
    environment: wp.array(dtype=wp.int32),
    inverse_mass: wp.array(dtype=wp.float32),
    position: wp.array(dtype=wp.vec3),
    searched_at: wp.array(dtype=wp.vec3),
    stirred: wp.array(dtype=wp.int32),
):
    """Mark the cells that a particle is near to that has moved since its last search."""
    i = wp.tid()
    x = position[i]
    moved = wp.length_sq(x - searched_at[i])
    least = limits.neighbour_margin * SEARCH_AGAIN
    if inverse_mass[i] > 0.0 and moved >= least * least:
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
    limits: Limits,
    environment: wp.array(dtype=wp.int32),
    garment: wp.array(dtype=wp.int32),
    materials: wp.array(dtype=Material),
    adjacency_start: wp.array(dtype=wp.int32),
    adjacency: wp.array(dtype=wp.int32),
    is_touching: wp.array(dtype=wp.int32),
    stirred: wp.array(dtype=wp.int32),
    position: wp.array(dtype=wp.vec3),
    normal: wp.array(dtype=wp.vec3),
    searched_at: wp.array(dtype=wp.vec3),
    neighbours: wp.array(dtype=wp.int32),
    sides: wp.array(dtype=wp.int32),
    neighbour_count: wp.array(dtype=wp.int32),
    overflow: wp.array(dtype=wp.int32),
):
    """List the particles that may touch each particle before the next search.

    Particles keep their lists where neither they nor others near them have moved since they were
    searched for. Particles that share an edge of the mesh are left out: the edge holds them apart. Neighbours
    that stay keep their sides. A list is in the order of indices, whatever the order in which the
    grid gives them.
    """
    i = wp.tid()
    env = environment[i]
    x = position[i]
    if stirred[find_cell(x, limits.cell_size, env, stirred.shape[0])] == 0:
        return
    searched_at[i] = x
    m = materials[garment[i]]
    radius = m.thickness + m.adhesion_radius + limits.neighbour_margin
    start = i * limits.neighbour_capacity
    count = int(0)
    known = wp.uint64(0)  # a bit for each remainder of a known index: most others are seen at once
    for k in range(neighbour_count[i]):
        j = neighbours[start + k]
        if wp.length_sq(position[j] - x) < radius * radius:
            neighbours[start + count] = j
            sides[start + count] = sides[start + k]
            known = known | (wp.uint64(1) << wp.uint64(j & 63))
            count += 1
    first = adjacency_start[i]
    last = adjacency_start[i + 1]
    if last > first and is_touching[i] == 1:  # padding has no edges
        n = normal[i]
        query = wp.hash_grid_query(grid, x, radius, env)
        j = int(0)
        while wp.hash_grid_query_next(query, j):
            d = x - position[j]
            if j != i and wp.length_sq(d) < radius * radius and is_touching[j] == 1:
                is_listed = int(0)
                for k in range(first, last):
                    if adjacency[k] == j:
                        is_listed = 1
                if (known & (wp.uint64(1) << wp.uint64(j & 63))) != wp.uint64(0):
                    for k in range(count):
                        if neighbours[start + k] == j:
                            is_listed = 1
                if is_listed == 0:
                    if count < limits.neighbour_capacity:
                        at = int(start + count)
                        while at > start and neighbours[at - 1] > j:
                            neighbours[at] = neighbours[at - 1]
                            sides[at] = sides[at - 1]
                            at -= 1
                        neighbours[at] = j
                        sides[at] = find_side(wp.dot(n, d), wp.dot(normal[j], d))
                        count += 1
                    else:
                        wp.atomic_add(overflow, env, 1)
    neighbour_count[i] = count


@wp.kernel
def solve_self_contact(
    dt: wp.float32,
    is_new: wp.int32,
    limits: Limits,
    garment: wp.array(dtype=wp.int32),
    materials: wp.array(dtype=Material),
    inverse_mass: wp.array(dtype=wp.float32),
    is_stuck: wp.array(dtype=wp.int32),
    position: wp.array(dtype=wp.vec3),
    previous: wp.array(dtype=wp.vec3),
    normal: wp.array(dtype=wp.vec3),
    neighbours: wp.array(dtype=wp.int32),
    sides: wp.array(dtype=wp.int32),
    neighbour_count: wp.array(dtype=wp.int32),
    crowd: wp.array(dtype=wp.float32),
    correction: wp.array(dtype=wp.vec3),
    squeeze: wp.array(dtype=wp.vec3),
    crowd_next: wp.array(dtype=wp.float32),
):
    """Keep discs that face each other apart; rub and hold those that touch.

    All particles read the same positions and write their own correction (Jacobi), so the result
    depends on no order, and both of a pair find the same numbers: momentum is kept. What a pair
    approached in this substep is undone, of an older overlap a share, at no more and no less than
    that speed, so that layers part without a throw. Where a
    particle has many contacts each counts less, by `crowd`, the number of them in the substep
    before. Friction cancels the tangential displacement of the substep up to Coulomb's limit;
    adhesion is the paper's spring within a radius.

    With `is_new` the discs' sides are those of now: at the start of a frame, so that a state says all.

    `squeeze` gets the overlap with the neighbours, along the direction in which they press.
    """
    i = wp.tid()
    n_count = neighbour_count[i]
    wi = inverse_mass[i]
    total = wp.vec3(0.0, 0.0, 0.0)
    pressed = wp.vec3(0.0, 0.0, 0.0)
    weights = float(0.0)
    if n_count > 0:
        g = garment[i]
        m = materials[g]
        thickness = m.thickness
        x = position[i]
        moved = x - previous[i]
        ni = normal[i]
        start = i * limits.neighbour_capacity
        for k in range(n_count):
            j = neighbours[start + k]
            d = x - position[j]
            r2 = wp.length_sq(d)
            nj = normal[j]
            over_j = wp.dot(nj, d)
            over_i = wp.dot(ni, d)
            if garment[j] != g:
                thickness = 0.5 * (m.thickness + materials[garment[j]].thickness)
            else:
                thickness = m.thickness
            wide = thickness * thickness
            side = sides[start + k]
            if is_new == 1:
                side = find_side(over_i, over_j)
                sides[start + k] = side
            if r2 - wp.max(over_j * over_j, over_i * over_i) >= wide or r2 < 1.0e-16:
                now = find_side(over_i, over_j)
                if now != side:
                    sides[start + k] = now
            else:
                reach = thickness + m.adhesion_radius
                # Each disc counts as it faces the other: an edge on a face has the face's normal.
                least = 0.05 * wp.sqrt(r2)
                facing_j = wp.abs(over_j) + least
                facing_i = wp.abs(over_i) + least
                if (side & ABOVE_OTHER) == 0:
                    facing_j = -facing_j
                if (side & BELOW_OTHER) == 0:
                    facing_i = -facing_i
                n = wp.normalize(nj * facing_j - ni * facing_i)
                apart = wp.dot(n, d)
                across = (r2 - apart * apart) / wide
                is_lost = apart < -GIVEN_UP * thickness and is_stuck[i] == 0 and is_stuck[j] == 0
                if across >= 1.0 or is_lost:
                    now = find_side(over_i, over_j)
                    if now != side:
                        sides[start + k] = now
                elif apart < reach:
                    weight = COVER * (1.0 - across)
                    weights += weight
                    weight = weight / wp.max(1.0, CROWDED * wp.max(crowd[i], crowd[j]))
                    share = wi / wp.max(wi + inverse_mass[j], 1.0e-9)
                    if apart >= 0.0 and r2 < 0.25 * wide:
                        # whatever the discs say, no two particles nearer than half of the thickness
                        r = wp.sqrt(r2)
                        total += d * (0.5 * share * (0.5 * thickness - r) / r)
                    depth = thickness - apart
                    slip = moved - (position[j] - previous[j])
                    along = wp.dot(n, slip)
                    before = wp.max(depth + along, 0.0)  # what overlapped before this substep
                    if depth > 0.0 or before > 0.0:
                        undone = UNDONE * before
                        if apart < 0.0:
                            undone = wp.min(undone, limits.separation_speed * dt)
                        push = wp.clamp(undone - along, -before, wp.max(depth, 0.0))
                        total += n * (share * push * weight)
                        pressed += n * (wp.max(depth - SOFT * thickness, 0.0) * weight)
                        slip = slip - n * along
                        length = wp.length(slip)
                        limit = m.particle_friction * wp.max(push, 0.0)
                        if length > limit:
                            slip = slip * (limit / length)
                        total -= slip * (share * weight)
                    else:
                        pull = wp.min(m.particle_adhesion * wi * dt * dt, 0.5) * depth
                        total += n * (pull * weight)
    correction[i] = total
    squeeze[i] = pressed
    crowd_next[i] = weights


@wp.kernel
def apply_corrections(
    correction: wp.array(dtype=wp.vec3),
    crowd_next: wp.array(dtype=wp.float32),
    position: wp.array(dtype=wp.vec3),
    crowd: wp.array(dtype=wp.float32),
):
    """Move the particles by their corrections."""
    i = wp.tid()
    position[i] = position[i] + correction[i]
    crowd[i] = crowd_next[i]
