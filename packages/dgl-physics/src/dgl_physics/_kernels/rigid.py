# type: ignore  # kernels are in the language of Warp
"""Contact of particles with rigid shapes, and the velocity update that follows it."""

import warp as wp

from dgl_physics._kernels.distance import PLANE, SPHERE, bound_distance
from dgl_physics._kernels.hit import find_drift, find_hit
from dgl_physics._kernels.types import ParticleMaterial, ShapeTable, SolverLimits

wp.set_module_options({"enable_backward": False, "fast_math": True})


@wp.kernel
def bound_cloth(
    particles_per_env: wp.int32,
    inverse_mass: wp.array(dtype=wp.float32),
    position: wp.array(dtype=wp.vec3),
    lower: wp.array(dtype=wp.vec3),
    upper: wp.array(dtype=wp.vec3),
):
    """Compute the bounding box of each environment's particles."""
    i = wp.tid()
    if inverse_mass[i] > 0.0:
        env = i // particles_per_env
        wp.atomic_min(lower, env, position[i])
        wp.atomic_max(upper, env, position[i])


@wp.kernel
def reset_bounds(lower: wp.array(dtype=wp.vec3), upper: wp.array(dtype=wp.vec3)):
    """Make the boxes empty."""
    e = wp.tid()
    lower[e] = wp.vec3(1.0e6, 1.0e6, 1.0e6)
    upper[e] = wp.vec3(-1.0e6, -1.0e6, -1.0e6)


@wp.func
def interpolate_pose(start: wp.transform, end: wp.transform, fraction: wp.float32):
    """Interpolate between two poses."""
    p = wp.lerp(wp.transform_get_translation(start), wp.transform_get_translation(end), fraction)
    q0 = wp.transform_get_rotation(start)
    q1 = wp.transform_get_rotation(end)
    if wp.dot(q0, q1) < 0.0:
        q1 = -q1
    return wp.transform(p, wp.normalize(q0 * (1.0 - fraction) + q1 * fraction))


@wp.kernel
def select_shapes(
    margin: wp.float32,
    shapes: ShapeTable,
    body_start: wp.array2d(dtype=wp.transform),
    body_end: wp.array2d(dtype=wp.transform),
    lower: wp.array(dtype=wp.vec3),
    upper: wp.array(dtype=wp.vec3),
    active: wp.array2d(dtype=wp.int32),
    active_count: wp.array(dtype=wp.int32),
    middle: wp.array2d(dtype=wp.transform),
    swept: wp.array2d(dtype=wp.vec4),
):
    """List the shapes whose swept sphere meets the cloth's box, one thread an environment.

    `middle` gets the shape's pose in the middle of the frame, and `swept` the centre and radius of
    a sphere that contains it during the whole frame: its bounding radius plus the largest distance
    that any of its points moves from the middle pose. Planes come last, so that contact with the
    ground is solved last.
    """
    e = wp.tid()
    count = int(0)
    low = lower[e]
    high = upper[e]
    total = shapes.kind.shape[0]
    for s in range(total):
        if shapes.kind[s] != PLANE:
            b = shapes.body[s]
            start = body_start[e, b]
            end = body_end[e, b]
            body = interpolate_pose(start, end, 0.5)
            pose = body * shapes.pose[s]
            # Cosine of half of the frame's rotation. From the middle of the frame to either end
            # the body turns by that half, and a point moves by its lever times the chord.
            cosine = wp.abs(
                wp.dot(wp.transform_get_rotation(start), wp.transform_get_rotation(end))
            )
            lever = wp.length(wp.transform_get_translation(shapes.pose[s])) + shapes.radius[s]
            moved = 0.5 * wp.length(
                wp.transform_get_translation(end) - wp.transform_get_translation(start)
            ) + lever * wp.sqrt(wp.max(2.0 * (1.0 - cosine), 0.0))
            centre = wp.transform_get_translation(pose)
            r = shapes.radius[s] + moved + margin
            inside = int(1)
            for k in range(3):
                if centre[k] - r > high[k] or centre[k] + r < low[k]:
                    inside = 0
            if inside == 1:
                middle[e, count] = pose
                radius = shapes.radius[s] + moved
                swept[e, count] = wp.vec4(centre[0], centre[1], centre[2], radius)
                active[e, count] = s
                count += 1
    for s in range(total):
        if shapes.kind[s] == PLANE:
            active[e, count] = s
            count += 1
    active_count[e] = count


@wp.kernel
def pose_shapes(
    fraction: wp.float32,
    shapes: ShapeTable,
    body_start: wp.array2d(dtype=wp.transform),
    body_end: wp.array2d(dtype=wp.transform),
    active: wp.array2d(dtype=wp.int32),
    active_count: wp.array(dtype=wp.int32),
    pose_before: wp.array2d(dtype=wp.transform),
    pose_now: wp.array2d(dtype=wp.transform),
):
    """Pose the active shapes at a fraction of the frame; the last pose becomes `pose_before`."""
    e, k = wp.tid()
    if k >= active_count[e]:
        return
    s = active[e, k]
    b = shapes.body[s]
    start = body_start[e, b]
    end = body_end[e, b]
    pose = interpolate_pose(start, end, fraction) * shapes.pose[s]
    if fraction == 0.0:
        pose_before[e, k] = pose
    else:
        pose_before[e, k] = pose_now[e, k]
    pose_now[e, k] = pose


@wp.func
def find_reach(
    dt: wp.float32,
    garment: wp.array(dtype=wp.int32),
    materials: wp.array(dtype=ParticleMaterial),
    velocity: wp.array(dtype=wp.vec3),
    i: wp.int32,
):
    """Compute the distance [m] within which a particle may touch a surface in this frame."""
    m = materials[garment[i]]
    # 0.3 m/s more than now: gravity and pulls act within the frame
    return m.rest_offset + m.adhesion_radius + (wp.length(velocity[i]) + 0.3) * dt


@wp.func
def bound_gap(
    shapes: ShapeTable,
    active: wp.array2d(dtype=wp.int32),
    middle: wp.array2d(dtype=wp.transform),
    swept: wp.array2d(dtype=wp.vec4),
    pose_start: wp.array2d(dtype=wp.transform),
    body_end: wp.array2d(dtype=wp.transform),
    e: wp.int32,
    k: wp.int32,
    x: wp.vec3,
    reach: wp.float32,
):
    """Bound the distance of a point from an active shape during this frame from below."""
    s = active[e, k]
    if shapes.kind[s] == PLANE:
        end = body_end[e, shapes.body[s]] * shapes.pose[s]
        return wp.min(
            wp.transform_point(wp.transform_inverse(pose_start[e, k]), x)[2],
            wp.transform_point(wp.transform_inverse(end), x)[2],
        )
    ball = swept[e, k]
    arm = x - wp.vec3(ball[0], ball[1], ball[2])
    gap = wp.length(arm) - ball[3]
    if gap < reach and shapes.kind[s] != SPHERE:
        local = wp.quat_rotate_inv(wp.transform_get_rotation(middle[e, k]), arm)
        gap = bound_distance(shapes.kind[s], shapes.size[s], shapes.grid[s], shapes.grids, local)
        gap = gap - (ball[3] - shapes.radius[s])
    return gap


@wp.func
def list_near_shape(
    limits: SolverLimits,
    shapes: ShapeTable,
    active: wp.array2d(dtype=wp.int32),
    near: wp.array(dtype=wp.int32),
    near_count: wp.array(dtype=wp.int32),
    near_bodies: wp.array(dtype=wp.int32),
    overflow: wp.array(dtype=wp.int32),
    e: wp.int32,
    k: wp.int32,
    i: wp.int32,
):
    """Add an active shape to the list of the particle `i`."""
    if near_count[i] < limits.near_capacity:
        near[i * limits.near_capacity + near_count[i]] = k
        near_count[i] = near_count[i] + 1
        if shapes.kind[active[e, k]] != PLANE:
            near_bodies[i] = near_bodies[i] + 1
    else:
        wp.atomic_add(overflow, e, 1)


@wp.kernel
def find_near_shapes(
    dt: wp.float32,
    particles_per_env: wp.int32,
    limits: SolverLimits,
    shapes: ShapeTable,
    garment: wp.array(dtype=wp.int32),
    materials: wp.array(dtype=ParticleMaterial),
    active: wp.array2d(dtype=wp.int32),
    active_count: wp.array(dtype=wp.int32),
    middle: wp.array2d(dtype=wp.transform),
    swept: wp.array2d(dtype=wp.vec4),
    pose_start: wp.array2d(dtype=wp.transform),
    body_end: wp.array2d(dtype=wp.transform),
    inverse_mass: wp.array(dtype=wp.float32),
    position: wp.array(dtype=wp.vec3),
    velocity: wp.array(dtype=wp.vec3),
    near: wp.array(dtype=wp.int32),
    near_count: wp.array(dtype=wp.int32),
    near_bodies: wp.array(dtype=wp.int32),
    overflow: wp.array(dtype=wp.int32),
):
    """List the active shapes that each particle may touch within the coming frame.

    Planes come last, as in `active`: the first `near_bodies` shapes of a particle are no planes.

    Planes are tested at the start and the end of the frame. Other shapes are tested at the middle
    of the frame, by their swept sphere and then by their surface.
    """
    i = wp.tid()
    near_count[i] = 0
    near_bodies[i] = 0
    if inverse_mass[i] > 0.0:
        e = i // particles_per_env
        x = position[i]
        reach = find_reach(dt, garment, materials, velocity, i)
        for k in range(active_count[e]):
            gap = bound_gap(
                shapes, active, middle, swept, pose_start, body_end, e, k, x, reach
            )  # fmt: skip
            if gap < reach:
                list_near_shape(
                    limits, shapes, active, near, near_count, near_bodies, overflow, e, k, i
                )  # fmt: skip


@wp.func
def resolve_rigid_contact(
    i: wp.int32,
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
    near_bodies: wp.array(dtype=wp.int32),
    previous: wp.array(dtype=wp.vec3),
    squeeze: wp.array(dtype=wp.vec3),
    position: wp.array(dtype=wp.vec3),
    velocity: wp.array(dtype=wp.vec3),
    impulse: wp.array2d(dtype=wp.spatial_vector),
    press: wp.array2d(dtype=wp.spatial_vector),
    is_stuck: wp.array(dtype=wp.int32),
    tension: wp.array(dtype=wp.vec3),
    is_torn: wp.array(dtype=wp.int32),
):
    """Resolve the rigid contact of the particle `i`; see `solve_rigid_contact`."""
    slips = is_torn[i] == 1
    is_torn[i] = 0
    w = inverse_mass[i]
    if w == 0.0:
        return
    e = i // particles_per_env
    before = previous[i]
    predicted = before + velocity[i] * dt
    pushed = wp.vec3(0.0, 0.0, 0.0)
    surface_velocity = wp.vec3(0.0, 0.0, 0.0)
    x = position[i]
    m = materials[garment[i]]
    stuck = int(0)
    for c in range(near_count[i]):
        k = near[i * limits.near_capacity + c]
        s = active[e, k]
        hit = find_hit(shapes, s, pose_now[e, k], x)
        gap = hit.distance - m.rest_offset
        if gap < m.adhesion_radius and m.is_solid == 0:
            n = hit.normal
            drift = find_drift(shapes, s, pose_before[e, k], hit)
            slip = (x - before) - drift
            slip = slip - n * wp.dot(n, slip)
            push = float(0.0)
            support = float(0.0)
            if gap < 0.0:
                push = -gap
                support = push
                pushed = n
                surface_velocity = drift / dt
            else:
                push = -wp.min(m.adhesion * w * dt * dt, 1.0) * gap
                support = -push
            x = x + n * push
            # The tension found by the coarse level presses, lifts or drags the particle. Friction
            # must hold it; it moves nothing by itself.
            pull = tension[i]
            along = wp.dot(n, pull)
            pressed = float(0.0)
            if push > 0.0:
                pressed = -wp.min(wp.dot(n, squeeze[i]), 0.0) * (m.stiffening * dt * dt)
                support = wp.max(support - along, 0.0) + pressed
            wanted = slip + pull - n * along
            length = wp.length(wanted)
            limit = m.friction * shapes.friction[s] * support
            if slips:
                limit = 0.0
            reaction = n * push - pull
            if length > limit:
                slip = slip * wp.min(limit / length, 1.0)
                reaction = n * push
            elif push > 0.0:
                stuck = 1
            x = x - slip
            if shapes.is_measured[s] == 1:
                j = (slip - reaction) / (w * dt)
                wp.atomic_add(impulse, e, s, wp.spatial_vector(j, wp.cross(hit.surface, j)))
                if pressed > 0.0:
                    j = n * (-pressed / (w * dt))
                    wp.atomic_add(press, e, s, wp.spatial_vector(j, wp.cross(hit.surface, j)))
    # From the correction rather than from x - before: rounding would bias a small velocity.
    v = velocity[i] + (x - predicted) / dt
    # Overlap from before this substep must not throw the particle off a surface.
    leaving = wp.dot(v - surface_velocity, pushed) - limits.separation_speed
    if leaving > 0.0:
        v = v - pushed * leaving
    speed = wp.length(v)
    if speed > limits.max_speed:
        v = v * (limits.max_speed / speed)
    position[i] = x
    velocity[i] = v
    is_stuck[i] = stuck


@wp.kernel
def solve_rigid_contact(
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
    near_bodies: wp.array(dtype=wp.int32),
    previous: wp.array(dtype=wp.vec3),
    squeeze: wp.array(dtype=wp.vec3),
    position: wp.array(dtype=wp.vec3),
    velocity: wp.array(dtype=wp.vec3),
    impulse: wp.array2d(dtype=wp.spatial_vector),
    press: wp.array2d(dtype=wp.spatial_vector),
    is_stuck: wp.array(dtype=wp.int32),
    tension: wp.array(dtype=wp.vec3),
    is_torn: wp.array(dtype=wp.int32),
):
    """Resolve rigid contact, and update the velocity.

    Contact comes last in the substep, so that a sticking particle has exactly no tangential
    displacement relative to the surface: no creep. The impulse on the shape, and its moment about
    the world's origin, are added to `impulse`. The pressure of squeezed cloth is added to `press`;
    it does not move the particle, which presses on another shape with its other side. Particles
    marked in `is_torn` have no friction, and lose the mark.
    """
    resolve_rigid_contact(
        wp.tid(), dt, particles_per_env, limits, shapes, garment, materials, inverse_mass, active,
        pose_before, pose_now, near, near_count, near_bodies, previous, squeeze, position, velocity,
        impulse, press, is_stuck, tension, is_torn,
    )  # fmt: skip


@wp.kernel
def measure_penetration(
    particles_per_env: wp.int32,
    limits: SolverLimits,
    shapes: ShapeTable,
    active: wp.array2d(dtype=wp.int32),
    pose_now: wp.array2d(dtype=wp.transform),
    near: wp.array(dtype=wp.int32),
    near_count: wp.array(dtype=wp.int32),
    position: wp.array(dtype=wp.vec3),
    deepest: wp.array(dtype=wp.float32),
):
    """Find the largest depth of a particle's centre inside a shape, by environment."""
    i = wp.tid()
    e = i // particles_per_env
    for c in range(near_count[i]):
        k = near[i * limits.near_capacity + c]
        s = active[e, k]
        wp.atomic_max(deepest, e, -find_hit(shapes, s, pose_now[e, k], position[i]).distance)
