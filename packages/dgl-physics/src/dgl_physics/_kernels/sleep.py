# type: ignore  # kernels are in the language of Warp
"""Sleep of environments whose cloth is at rest, until something may touch it."""

import warp as wp

from dgl_physics._kernels.types import ShapeTable, SolverLimits

wp.set_module_options({"enable_backward": False, "fast_math": True})


@wp.kernel
def find_touched(
    particles_per_env: wp.int32,
    limits: SolverLimits,
    shapes: ShapeTable,
    active: wp.array2d(dtype=wp.int32),
    near: wp.array(dtype=wp.int32),
    near_count: wp.array(dtype=wp.int32),
    is_touched: wp.array(dtype=wp.int32),
):
    """Find the environments in which cloth may touch a body that can move in the coming frame."""
    i = wp.tid()
    e = i // particles_per_env
    for c in range(near_count[i]):
        if shapes.is_moving[active[e, near[i * limits.near_capacity + c]]] == 1:
            is_touched[e] = 1


@wp.kernel
def count_still_frames(
    limits: SolverLimits,
    free_count: wp.array(dtype=wp.float32),
    is_touched: wp.array(dtype=wp.int32),
    motion: wp.array(dtype=wp.float32),
    still: wp.array(dtype=wp.int32),
):
    """Count the frames for which an environment's cloth has been still, and reset the motion."""
    e = wp.tid()
    count = still[e] + 1
    farthest = limits.sleep_distance
    # also where it is not finite
    if is_touched[e] == 1 or not (motion[e] < farthest * farthest * free_count[e]):
        count = 0
    still[e] = wp.min(count, limits.sleep_frames)
    is_touched[e] = 0
    motion[e] = 0.0


@wp.kernel
def lay_down(
    limits: SolverLimits,
    environment: wp.array(dtype=wp.int32),
    still: wp.array(dtype=wp.int32),
    held: wp.array(dtype=wp.int32),
    inverse_mass: wp.array(dtype=wp.float32),
    position: wp.array(dtype=wp.vec3),
    velocity: wp.array(dtype=wp.vec3),
    mobility: wp.array(dtype=wp.float32),
    anchor: wp.array(dtype=wp.vec3),
):
    """Remove speed and inverse mass of sleeping particles for this frame.

    Held ones lose their inverse mass alone.
    `anchor` holds their positions when they were last moving.
    """
    i = wp.tid()
    w = inverse_mass[i]
    count = still[environment[i]]
    if count == 0:
        anchor[i] = position[i]
    if count >= limits.sleep_frames:
        w = 0.0
        velocity[i] = wp.vec3(0.0, 0.0, 0.0)
    if held[i] != 0:
        w = 0.0
    mobility[i] = w


@wp.kernel
def clear_impulses(
    limits: SolverLimits,
    still: wp.array(dtype=wp.int32),
    impulse: wp.array2d(dtype=wp.spatial_vector),
):
    """Clear the impulses of a frame; sleeping cloth keeps those of its last frame."""
    e, s = wp.tid()
    if still[e] < limits.sleep_frames:
        impulse[e, s] = wp.spatial_vector()


@wp.kernel
def ease_press(
    rise: wp.float32,
    limits: SolverLimits,
    still: wp.array(dtype=wp.int32),
    pressed: wp.array2d(dtype=wp.spatial_vector),
    press: wp.array2d(dtype=wp.spatial_vector),
):
    """Limit the rise of the press on a shape to `rise` [N s] a frame; it falls at once."""
    e, s = wp.tid()
    if still[e] < limits.sleep_frames:
        wanted = pressed[e, s]
        size = wp.length(wp.spatial_top(wanted))
        held = wp.length(wp.spatial_top(press[e, s])) + rise
        if size > held:
            wanted = wanted * (held / size)
        press[e, s] = wanted
        pressed[e, s] = wp.spatial_vector()


@wp.kernel
def add_motion(
    environment: wp.array(dtype=wp.int32),
    anchor: wp.array(dtype=wp.vec3),
    position: wp.array(dtype=wp.vec3),
    motion: wp.array(dtype=wp.float32),
):
    """Add up the squared distances of the particles from their anchors [m^2]."""
    i = wp.tid()
    wp.atomic_add(motion, environment[i], wp.length_sq(position[i] - anchor[i]))
