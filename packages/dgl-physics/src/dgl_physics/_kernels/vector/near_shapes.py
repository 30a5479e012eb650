# type: ignore  # kernels are in the language of Warp
"""Twin of `_kernels.rigid.find_near_shapes`."""

import warp as wp

from dgl_physics._kernels.distance import PLANE
from dgl_physics._kernels.rigid import bound_gap, find_reach, list_near_shape
from dgl_physics._kernels.types import ParticleMaterial, ShapeTable, SolverLimits
from dgl_physics._kernels.vector.lanes import LANES

wp.set_module_options({"enable_backward": False})


@wp.func_native(
    LANES
    + """
// Rows of x, y, z and reach of all particles. The found list is written before them.
int total = position.shape[0];
float* x = (float*)(scratch.data + total + 8);
float* y = x + total + 8;
float* z = y + total + 8;
float* reach = z + total + 8;
int begin = e * particles_per_env, end = begin + particles_per_env;
wp::vec4 ball = swept.data[e * swept.shape[1] + k];
int found = 0;
for (int i = begin; i < end; i += 8) {
    f8 dx = lane::load(x + i) - ball[0], dy = lane::load(y + i) - ball[1];
    f8 dz = lane::load(z + i) - ball[2];
    f8 far = (lane::load(reach + i) + ball[3]) * 1.0001f;
    int bits = lane::bits((dx * dx + dy * dy + dz * dz < far * far) & (far > 0.0f));
    if (i + 8 > end) bits &= (1 << (end - i)) - 1;
    i8 own = i + (i8){0, 1, 2, 3, 4, 5, 6, 7};
    lane::store(scratch.data + found, lane::compress(own, bits));
    found += __builtin_popcount(bits);
}
return found;
"""
)
def find_close(
    e: wp.int32,
    k: wp.int32,
    particles_per_env: wp.int32,
    position: wp.array(dtype=wp.vec3),
    swept: wp.array2d(dtype=wp.vec4),
    scratch: wp.array(dtype=wp.int32),
) -> wp.int32:
    """List at least the particles whose reach meets the swept sphere of an active shape."""
    ...


@wp.func_native(
    """
int total = position.shape[0];
float* x = (float*)(scratch.data + total + 8);
int row = total + 8;
x[i] = position.data[i][0];
x[i + row] = position.data[i][1];
x[i + 2 * row] = position.data[i][2];
x[i + 3 * row] = reach;
"""
)
def set_place(
    i: wp.int32,
    position: wp.array(dtype=wp.vec3),
    reach: wp.float32,
    scratch: wp.array(dtype=wp.int32),
):
    """Write a row for `find_close`."""
    ...


@wp.func_native(
    """
int total = position.shape[0];
return ((float*)(scratch.data + total + 8))[i + 3 * (total + 8)];
"""
)
def get_reach(
    i: wp.int32, position: wp.array(dtype=wp.vec3), scratch: wp.array(dtype=wp.int32)
) -> wp.float32:
    """Read the reach written by `set_place`."""
    ...


@wp.kernel
def find_near_shapes(
    count: wp.int32,
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
    scratch: wp.array(dtype=wp.int32),
):
    """Test all particles against one shape after another; its sphere excludes most of them."""
    for i in range(count):
        near_count[i] = 0
        near_bodies[i] = 0
        reach = float(-1.0e9)
        if inverse_mass[i] > 0.0:
            reach = find_reach(dt, garment, materials, velocity, i)
        set_place(i, position, reach, scratch)
    for e in range(active.shape[0]):
        for k in range(active_count[e]):
            is_plane = shapes.kind[active[e, k]] == PLANE
            found = particles_per_env
            if not is_plane:
                found = find_close(e, k, particles_per_env, position, swept, scratch)
            for c in range(found):
                i = e * particles_per_env + c
                if not is_plane:
                    i = scratch[c]
                reach = get_reach(i, position, scratch)
                gap = bound_gap(
                    shapes, active, middle, swept, pose_start, body_end, e, k, position[i], reach
                )  # fmt: skip
                if gap < reach:
                    list_near_shape(
                        limits, shapes, active, near, near_count, near_bodies, overflow, e, k, i
                    )  # fmt: skip
