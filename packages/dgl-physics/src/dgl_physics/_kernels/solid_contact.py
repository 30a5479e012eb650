"""Contact of elastic solids with rigid shapes, within the implicit step.

A push on one particle of a stiff solid moves its surroundings as well, so pushing particles apart
one by one after the step, as for cloth, is much too soft and not stable. Here all contacts of a
solid are solved together, with the inverse of the step's matrix as their compliance.
"""

# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false, reportIndexIssue=false
# pyright: reportOperatorIssue=false, reportArgumentType=false, reportCallIssue=false
import warp as wp

from dgl_physics._kernels.hit import find_drift, find_hit
from dgl_physics._kernels.solid import Bodies
from dgl_physics._kernels.types import Limits, Material, ShapeTable

wp.set_module_options({"enable_backward": False, "fast_math": True})

MARGIN = wp.constant(0.002)
"""Gap below which a contact may be reached by what the others push [m]."""

PRECISION = wp.constant(3.0e-8)
"""Sweeps end when no contact moves by more than this [m]."""


@wp.struct
class Touches:
    """What each row touches: the nearest shape, or none."""

    shape: wp.array(dtype=wp.int32)
    """Shape, or -1."""
    normal: wp.array(dtype=wp.vec3)
    gap: wp.array(dtype=wp.float32)
    slip: wp.array(dtype=wp.vec3)
    """Tangential displacement relative to the surface without contact [m]."""
    surface: wp.array(dtype=wp.vec3)
    friction: wp.array(dtype=wp.float32)


@wp.kernel
def add_adhesion(
    dt: wp.float32,
    particles_per_env: wp.int32,
    limits: Limits,
    shapes: ShapeTable,
    garment: wp.array(dtype=wp.int32),
    materials: wp.array(dtype=Material),
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
    dt: wp.float32,
    particles_per_env: wp.int32,
    limits: Limits,
    shapes: ShapeTable,
    garment: wp.array(dtype=wp.int32),
    materials: wp.array(dtype=Material),
    inverse_mass: wp.array(dtype=wp.float32),
    active: wp.array2d(dtype=wp.int32),
    pose_before: wp.array2d(dtype=wp.transform),
    pose_now: wp.array2d(dtype=wp.transform),
    near: wp.array(dtype=wp.int32),
    near_count: wp.array(dtype=wp.int32),
    previous: wp.array(dtype=wp.vec3),
    position: wp.array(dtype=wp.vec3),
    particle: wp.array(dtype=wp.int32),
    fall: wp.array(dtype=wp.vec3),
    step: wp.array(dtype=wp.vec3),
    touches: Touches,
):
    """Find the nearest shape of each row where the step without contact would bring it."""
    r = wp.tid()
    i = particle[r]
    touches.shape[r] = -1
    if inverse_mass[i] == 0.0:
        return
    e = i // particles_per_env
    m = materials[garment[i]]
    x = position[i] - fall[r] + step[r]
    least = float(MARGIN)
    for c in range(near_count[i]):
        k = near[i * limits.near_capacity + c]
        s = active[e, k]
        hit = find_hit(shapes, s, pose_now[e, k], x)
        gap = hit.distance - m.rest_offset
        if gap < least:
            least = gap
            n = hit.normal
            slip = (x - previous[i]) - find_drift(shapes, s, pose_before[e, k], hit)
            touches.shape[r] = s
            touches.normal[r] = n
            # an overlap from before is left no faster than at the separation speed
            start = gap - wp.dot(n, slip)
            touches.gap[r] = gap - wp.min(0.0, start + limits.separation_speed * dt)
            touches.slip[r] = slip - n * wp.dot(n, slip)
            touches.surface[r] = hit.surface
            touches.friction[r] = m.friction * shapes.friction[s]


@wp.kernel
def solve_touches(
    dt: wp.float32,
    iterations: wp.int32,
    bodies: Bodies,
    shapes: ShapeTable,
    environment: wp.array(dtype=wp.int32),
    particle: wp.array(dtype=wp.int32),
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
    impulse: wp.array2d(dtype=wp.spatial_vector),
):
    """Projected Gauss-Seidel over the contacts of a solid, one thread a solid.

    A push [kg m] is an impulse times dt; the compliance of two rows is an entry of the inverse
    [1/kg], the same in all directions. Coulomb's limit as for cloth: all slip is taken out, up to
    friction times the normal push.
    """
    b = wp.tid()
    first = bodies.first_row[b]
    n_rows = bodies.row_count[b]
    base = bodies.inverse_start[b]
    count = int(0)
    for k in range(n_rows):
        push[first + k] = wp.vec3(0.0, 0.0, 0.0)
        moved[first + k] = wp.vec3(0.0, 0.0, 0.0)
        if touches.shape[first + k] >= 0:
            listed[first + count] = k
            count += 1
    inertia = inverse_inertia[b]
    answer = turning[b]
    for c in range(count):
        r = first + listed[first + c]
        n = touches.normal[r]
        g = bodies.inverse[base + listed[first + c] * (n_rows + 1)]
        total = float(0.0)
        for axis in range(3):
            e = wp.vec3(0.0, 0.0, 0.0)
            e[axis] = 1.0
            t = inertia * wp.cross(arm[r], e)
            t_less = t - inertia * (wp.cross(lever[r], e) - answer * t)
            total += g + wp.dot(e, wp.cross(t_less, arm[r]) - wp.cross(t, lever[r]))
        t = inertia * wp.cross(arm[r], n)
        t_less = t - inertia * (wp.cross(lever[r], n) - answer * t)
        normal = g + wp.dot(n, wp.cross(t_less, arm[r]) - wp.cross(t, lever[r]))
        # sideways the larger of two values counts: three quarters of their sum is safe
        own[r] = wp.vec2(1.0 / normal, 1.0 / wp.max(0.75 * (total - normal), 0.1 * normal))
    is_pushed = int(0)
    for _sweep in range(iterations):
        largest = float(0.0)
        for c in range(count):
            k = listed[first + c]
            r = first + k
            n = touches.normal[r]
            p = push[r]
            u = moved[r]
            outwards = wp.dot(n, u)
            along = wp.dot(n, p)
            up = wp.max(0.0, along - (touches.gap[r] + outwards) * own[r][0])
            side = (p - n * along) - (touches.slip[r] + u - n * outwards) * own[r][1]
            length = wp.length(side)
            limit = touches.friction[r] * up
            if length > limit:
                side = side * (limit / length)
            change = n * up + side - p
            size = wp.length(change)
            if size > 0.0:
                largest = wp.max(largest, size / own[r][0])
                push[r] = p + change
                turn = inertia * wp.cross(arm[r], change)
                less = turn - inertia * (wp.cross(lever[r], change) - answer * turn)
                at = base + k * n_rows
                for d in range(count):
                    to = first + listed[first + d]
                    moved[to] = (
                        moved[to]
                        + change * bodies.inverse[at + listed[first + d]]
                        - wp.cross(turn, lever[to])
                        + wp.cross(less, arm[to])
                    )
                is_pushed = 1
        if largest < PRECISION:
            break
    contact_count[b] = is_pushed
    if is_pushed == 1:
        for c in range(count):
            r = first + listed[first + c]
            s = touches.shape[r]
            if shapes.is_measured[s] == 1:
                j = push[r] / -dt
                wp.atomic_add(
                    impulse,
                    environment[particle[r]],
                    s,
                    wp.spatial_vector(j, wp.cross(touches.surface[r], j)),
                )
