# type: ignore  # kernels are in the language of Warp
"""Contact of elastic solids with rigid shapes, within the implicit step.

A push on one particle of a stiff solid moves its surroundings as well, so pushing particles one by
one after the step, as for cloth, is much too soft and unstable. All contacts of a solid are solved
together, with the inverse of the step's matrix as their compliance.
"""

import warp as wp

from dgl_physics._kernels.edge_contact import REST_SHARE
from dgl_physics._kernels.hit import find_drift, find_hit
from dgl_physics._kernels.solid import Bodies
from dgl_physics._kernels.types import ParticleMaterial, ShapeTable, SolverLimits

wp.set_module_options({"enable_backward": False, "fast_math": True})

MARGIN = wp.constant(0.002)
"""Gap below which the pushes of other contacts may close a contact [m]."""

EDGE_MARGIN = wp.constant(0.0005)
"""The same for the middles of edges [m]; smaller, because there are many of them."""

PRECISION = wp.constant(3.0e-8)
"""Sweeps end when no contact moves by more than this [m]."""


@wp.struct
class Touches:
    """The nearest shape of each contact point, if any.

    Points are the rows, followed by the middles of the surface's edges, which stop shapes that are
    thinner than a triangle.
    """

    ends: wp.array(dtype=wp.vec2i)
    """The two rows that a point lies midway between; twice the same for a row's own point."""
    shape: wp.array(dtype=wp.int32)
    """Shape, or -1."""
    normal: wp.array(dtype=wp.vec3)
    gap: wp.array(dtype=wp.float32)
    slip: wp.array(dtype=wp.vec3)
    """Tangential displacement relative to the surface without contact [m]."""
    surface: wp.array(dtype=wp.vec3)
    friction: wp.array(dtype=wp.float32)
    arm: wp.array(dtype=wp.vec3)
    """From the centre of mass of a free solid [m]."""
    lever: wp.array(dtype=wp.vec3)
    """Response of the factor to mass times arm."""
    row_count: wp.int32
    """Points that are rows."""


@wp.kernel
def add_adhesion(
    dt: wp.float32,
    particles_per_env: wp.int32,
    limits: SolverLimits,
    shapes: ShapeTable,
    garment: wp.array(dtype=wp.int32),
    materials: wp.array(dtype=ParticleMaterial),
    inverse_mass: wp.array(dtype=wp.float32),
    active: wp.array2d(dtype=wp.int32),
    pose_now: wp.array2d(dtype=wp.transform),
    near: wp.array(dtype=wp.int32),
    near_count: wp.array(dtype=wp.int32),
    particle: wp.array(dtype=wp.int32),
    trial: wp.array(dtype=wp.vec3),
    step: wp.array(dtype=wp.vec3),
    impulse: wp.array2d(dtype=wp.spatial_vector),
):
    """Add the paper's spring towards near surfaces to the right side of the step."""
    r = wp.tid()
    i = particle[r]
    if inverse_mass[i] == 0.0:
        return
    e = i // particles_per_env
    m = materials[garment[i]]
    x = trial[r]
    for c in range(near_count[i]):
        k = near[i * limits.near_capacity + c]
        s = active[e, k]
        hit = find_hit(shapes, s, pose_now[e, k], x)
        gap = hit.distance - m.rest_offset
        if gap > 0.0 and gap < m.adhesion_radius:
            n = hit.normal
            j = n * (m.adhesion * gap * dt)
            step[r] = step[r] - j * dt
            if shapes.is_measured[s] == 1:
                wp.atomic_add(impulse, e, s, wp.spatial_vector(j, wp.cross(hit.surface, j)))


@wp.kernel
def find_touches(
    first: wp.int32,
    dt: wp.float32,
    particles_per_env: wp.int32,
    limits: SolverLimits,
    shapes: ShapeTable,
    garment: wp.array(dtype=wp.int32),
    materials: wp.array(dtype=ParticleMaterial),
    inverse_mass: wp.array(dtype=wp.float32),
    active: wp.array2d(dtype=wp.int32),
    pose_before: wp.array2d(dtype=wp.transform),
    pose_now: wp.array2d(dtype=wp.transform),
    near: wp.array(dtype=wp.int32),
    near_count: wp.array(dtype=wp.int32),
    previous: wp.array(dtype=wp.vec3),
    position: wp.array(dtype=wp.vec3),
    near_bodies: wp.array(dtype=wp.int32),
    particle: wp.array(dtype=wp.int32),
    fall: wp.array(dtype=wp.vec3),
    step: wp.array(dtype=wp.vec3),
    touches: Touches,
):
    """Find the nearest shape of each point where the step without contact would bring it.

    The middle of an edge meets the shapes near one of its ends, except planes, which its ends meet
    first, and shapes that both ends are pressed to. So rows come before edges: `first` is 0 for
    rows and their number for edges.
    """
    p = first + wp.tid()
    r = touches.ends[p][0]
    other = touches.ends[p][1]
    i = particle[r]
    j = particle[other]
    touches.shape[p] = -1
    if inverse_mass[i] + inverse_mass[j] == 0.0:
        return
    e = i // particles_per_env
    m = materials[garment[i]]
    is_edge = r != other
    x = 0.5 * (position[i] - fall[r] + step[r] + position[j] - fall[other] + step[other])
    before = 0.5 * (previous[i] + previous[j])
    rest = m.rest_offset
    least = float(MARGIN)
    if is_edge:
        rest = REST_SHARE * m.rest_offset
        least = float(EDGE_MARGIN)
    for end in range(2):
        at = i
        count = near_count[i]
        if is_edge:
            count = near_bodies[i]
        if end == 1:
            at = j
            count = near_bodies[j]
            if not is_edge:
                count = 0
        for c in range(count):
            k = near[at * limits.near_capacity + c]
            s = active[e, k]
            if is_edge and touches.shape[r] == s and touches.shape[other] == s:
                if touches.gap[r] <= 0.0 and touches.gap[other] <= 0.0:
                    continue
            hit = find_hit(shapes, s, pose_now[e, k], x)
            gap = hit.distance - rest
            if gap < least:
                least = gap
                n = hit.normal
                slip = (x - before) - find_drift(shapes, s, pose_before[e, k], hit)
                touches.shape[p] = s
                touches.normal[p] = n
                # an older overlap opens no faster than at the separation speed
                start = gap - wp.dot(n, slip)
                touches.gap[p] = gap - wp.min(0.0, start + limits.separation_speed * dt)
                touches.slip[p] = slip - n * wp.dot(n, slip)
                touches.surface[p] = hit.surface
                touches.friction[p] = m.friction * shapes.friction[s]


@wp.func
def get_compliance(
    bodies: Bodies,
    base: wp.int32,
    n_rows: wp.int32,
    first: wp.int32,
    one: wp.vec2i,
    other: wp.vec2i,
):
    """Compute the displacement of one point by a unit push on another [1/kg]."""
    a = base + (one[0] - first) * n_rows - first
    if one[0] == one[1] and other[0] == other[1]:
        return bodies.inverse[a + other[0]]
    b = base + (one[1] - first) * n_rows - first
    return 0.25 * (
        bodies.inverse[a + other[0]]
        + bodies.inverse[a + other[1]]
        + bodies.inverse[b + other[0]]
        + bodies.inverse[b + other[1]]
    )


@wp.kernel
def solve_touches(
    dt: wp.float32,
    iterations: wp.int32,
    bodies: Bodies,
    shapes: ShapeTable,
    environment: wp.array(dtype=wp.int32),
    particle: wp.array(dtype=wp.int32),
    first_edge: wp.array(dtype=wp.int32),
    edge_count: wp.array(dtype=wp.int32),
    arm: wp.array(dtype=wp.vec3),
    lever: wp.array(dtype=wp.vec3),
    inverse_inertia: wp.array(dtype=wp.mat33),
    turning: wp.array(dtype=wp.mat33),
    touches: Touches,
    own: wp.array(dtype=wp.vec2),
    listed: wp.array(dtype=wp.int32),
    contact_count: wp.array(dtype=wp.int32),
    push: wp.array(dtype=wp.vec3),
    moved: wp.array(dtype=wp.vec3),
    row_push: wp.array(dtype=wp.vec3),
    impulse: wp.array2d(dtype=wp.spatial_vector),
):
    """Solve the contacts of a solid by projected Gauss-Seidel, one thread a solid.

    A push [kg m] is an impulse times dt. The compliance of two points [1/kg] is an entry of the
    inverse, or the mean of four, the same in all directions. As for cloth, all slip is removed, up
    to friction times the normal push.
    """
    b = wp.tid()
    first = bodies.first_row[b]
    n_rows = bodies.row_count[b]
    base = bodies.inverse_start[b]
    edges = first_edge[b]
    # a solid's part of the list has room for all its rows and edges
    at_list = first + edges - touches.row_count
    count = int(0)
    for k in range(n_rows + edge_count[b]):
        p = first + k
        if k < n_rows:
            row_push[p] = wp.vec3(0.0, 0.0, 0.0)
        else:
            p = edges + k - n_rows
        if touches.shape[p] >= 0:
            listed[at_list + count] = p
            count += 1
    inertia = inverse_inertia[b]
    answer = turning[b]
    for c in range(count):
        p = listed[at_list + c]
        push[p] = wp.vec3(0.0, 0.0, 0.0)
        moved[p] = wp.vec3(0.0, 0.0, 0.0)
        ends = touches.ends[p]
        arm_p = 0.5 * (arm[ends[0]] + arm[ends[1]])
        lever_p = 0.5 * (lever[ends[0]] + lever[ends[1]])
        touches.arm[p] = arm_p
        touches.lever[p] = lever_p
        n = touches.normal[p]
        g = get_compliance(bodies, base, n_rows, first, ends, ends)
        total = float(0.0)
        for axis in range(3):
            e = wp.vec3(0.0, 0.0, 0.0)
            e[axis] = 1.0
            t = inertia * wp.cross(arm_p, e)
            t_less = t - inertia * (wp.cross(lever_p, e) - answer * t)
            total += g + wp.dot(e, wp.cross(t_less, arm_p) - wp.cross(t, lever_p))
        t = inertia * wp.cross(arm_p, n)
        t_less = t - inertia * (wp.cross(lever_p, n) - answer * t)
        normal = g + wp.dot(n, wp.cross(t_less, arm_p) - wp.cross(t, lever_p))
        # sideways the larger of two values counts: three quarters of their sum is safe
        own[p] = wp.vec2(1.0 / normal, 1.0 / wp.max(0.75 * (total - normal), 0.1 * normal))
    is_pushed = int(0)
    for _sweep in range(iterations):
        largest = float(0.0)
        for c in range(count):
            p = listed[at_list + c]
            n = touches.normal[p]
            old = push[p]
            u = moved[p]
            outwards = wp.dot(n, u)
            along = wp.dot(n, old)
            up = wp.max(0.0, along - (touches.gap[p] + outwards) * own[p][0])
            side = (old - n * along) - (touches.slip[p] + u - n * outwards) * own[p][1]
            length = wp.length(side)
            limit = touches.friction[p] * up
            if length > limit:
                side = side * (limit / length)
            change = n * up + side - old
            size = wp.length(change)
            if size > 0.0:
                largest = wp.max(largest, size / own[p][0])
                push[p] = old + change
                turn = inertia * wp.cross(touches.arm[p], change)
                less = turn - inertia * (wp.cross(touches.lever[p], change) - answer * turn)
                ends = touches.ends[p]
                for d in range(count):
                    to = listed[at_list + d]
                    moved[to] = (
                        moved[to]
                        + change
                        * get_compliance(bodies, base, n_rows, first, ends, touches.ends[to])
                        - wp.cross(turn, touches.lever[to])
                        + wp.cross(less, touches.arm[to])
                    )
                is_pushed = 1
        if largest < PRECISION:
            break
    contact_count[b] = is_pushed
    if is_pushed == 1:
        for c in range(count):
            p = listed[at_list + c]
            ends = touches.ends[p]
            row_push[ends[0]] = row_push[ends[0]] + 0.5 * push[p]
            row_push[ends[1]] = row_push[ends[1]] + 0.5 * push[p]
            s = touches.shape[p]
            if shapes.is_measured[s] == 1:
                j = push[p] / -dt
                wp.atomic_add(
                    impulse,
                    environment[particle[ends[0]]],
                    s,
                    wp.spatial_vector(j, wp.cross(touches.surface[p], j)),
                )
