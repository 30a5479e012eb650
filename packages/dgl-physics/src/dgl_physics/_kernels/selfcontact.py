"""Contact of particles with particles, of the same garment or of another."""

# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false, reportIndexIssue=false
# pyright: reportOperatorIssue=false
import warp as wp

from dgl_physics._kernels.types import Limits, Material

wp.set_module_options({"enable_backward": False, "fast_math": True})

SEARCH_AGAIN = wp.constant(0.333)
"""Share of the margin that a particle may move before its environment is searched again."""


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
    displacement: wp.array(dtype=wp.float32),
    position: wp.array(dtype=wp.vec3),
    searched_at: wp.array(dtype=wp.vec3),
    neighbours: wp.array(dtype=wp.int32),
    neighbour_count: wp.array(dtype=wp.int32),
    overflow: wp.array(dtype=wp.int32),
):
    """List the particles that may touch each particle before the next search.

    Environments whose particles have hardly moved since their last search keep their lists.
    Particles that share an edge of the mesh are left out: the edge holds them apart. A list is in
    the order of indices, whatever the order in which the grid gives them.
    """
    i = wp.tid()
    env = environment[i]
    if displacement[env] < limits.neighbour_margin * SEARCH_AGAIN:
        return
    x = position[i]
    searched_at[i] = x
    m = materials[garment[i]]
    radius = m.thickness + m.adhesion_radius + limits.neighbour_margin
    first = adjacency_start[i]
    last = adjacency_start[i + 1]
    count = int(0)
    if last > first and is_touching[i] == 1:  # padding has no edges
        query = wp.hash_grid_query(grid, x, radius, env)
        j = int(0)
        while wp.hash_grid_query_next(query, j):
            is_near = wp.length_sq(position[j] - x) < radius * radius
            if j != i and is_near and is_touching[j] == 1:
                is_joined = int(0)
                for k in range(first, last):
                    if adjacency[k] == j:
                        is_joined = 1
                if is_joined == 0:
                    if count < limits.neighbour_capacity:
                        at = int(i * limits.neighbour_capacity + count)
                        start = int(i * limits.neighbour_capacity)
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
    limits: Limits,
    garment: wp.array(dtype=wp.int32),
    materials: wp.array(dtype=Material),
    inverse_mass: wp.array(dtype=wp.float32),
    position: wp.array(dtype=wp.vec3),
    previous: wp.array(dtype=wp.vec3),
    neighbours: wp.array(dtype=wp.int32),
    neighbour_count: wp.array(dtype=wp.int32),
    correction: wp.array(dtype=wp.vec3),
    carry: wp.array(dtype=wp.vec3),
):
    """Push apart particles closer than the thickness; rub and hold those that touch.

    All particles read the same positions and write their own correction (Jacobi), averaged over
    the contacts, so the result depends on no order. The whole overlap is undone, but a pair gets
    no more velocity from it than the separation speed: the rest is a change of place alone, kept
    in `carry` and left out of the velocity, so that contact does not throw particles apart.
    Friction cancels the tangential displacement of the substep up to Coulomb's limit; adhesion
    is the paper's spring within a radius.
    """
    i = wp.tid()
    n_count = neighbour_count[i]
    wi = inverse_mass[i]
    total = wp.vec3(0.0, 0.0, 0.0)
    carried = wp.vec3(0.0, 0.0, 0.0)
    hits = float(0.0)
    if n_count > 0 and wi > 0.0:
        m = materials[garment[i]]
        x = position[i]
        moved = x - previous[i]
        reach = m.thickness + m.adhesion_radius
        for k in range(n_count):
            j = neighbours[i * limits.neighbour_capacity + k]
            d = x - position[j]
            r2 = wp.length_sq(d)
            if r2 < reach * reach and r2 > 1.0e-16:
                r = wp.sqrt(r2)
                n = d / r
                share = wi / (wi + inverse_mass[j])
                depth = m.thickness - r
                if depth > 0.0:
                    slip = moved - (position[j] - previous[j])
                    along = wp.dot(n, slip)
                    kept = wp.clamp(limits.separation_speed * dt - along, 0.0, depth)
                    total += n * (share * depth)
                    carried += n * (share * (depth - kept))
                    slip = slip - n * along
                    length = wp.length(slip)
                    limit = m.particle_friction * depth
                    if length > limit:
                        slip = slip * (limit / length)
                    total -= slip * share
                    hits += 1.0
                else:
                    pull = wp.min(m.particle_adhesion * wi * dt * dt, 0.5) * depth
                    total += n * pull
    # Half the number of contacts: their mean converges slowly, their sum overshoots.
    scale = 1.0 / wp.max(1.0, hits * 0.5)
    correction[i] = total * scale
    carry[i] = carried * scale


@wp.kernel
def apply_corrections(
    correction: wp.array(dtype=wp.vec3),
    position: wp.array(dtype=wp.vec3),
):
    """Move the particles by their corrections."""
    i = wp.tid()
    position[i] = position[i] + correction[i]
