# type: ignore  # kernels are in the language of Warp
"""Exact signed distances of a triangle mesh at the nodes of a grid."""

import warp as wp

wp.set_module_options({"enable_backward": False})

FAR = wp.constant(1.0e4)
"""More than the extent of any mesh [m]."""
ROOM = wp.constant(1.001)
"""Factor that allows for rounding."""


@wp.func
def measure(mesh: wp.uint64, p: wp.vec3, most: wp.float32):
    """Compute the unsigned distance of a point, which must be at most `most`."""
    q = wp.mesh_query_point_no_sign(mesh, p, most)
    return wp.length(wp.mesh_eval_position(mesh, q.face, q.u, q.v) - p)


@wp.func
def find_sign(mesh: wp.uint64, p: wp.vec3):
    """Find the sign of a distance by the winding number, which allows overlapping parts."""
    return wp.mesh_query_point_sign_winding_number(mesh, p, FAR, 2.0, 0.5).sign


@wp.kernel
def sample_boxes(
    mesh: wp.uint64,
    lower: wp.array(dtype=wp.vec3),
    nodes: wp.vec3i,
    spacing: wp.float32,
    is_sheet: wp.int32,
    value: wp.array(dtype=wp.float32),
):
    """Fill boxes of nodes, one thread a box.

    A node is at most one spacing farther from the surface than its neighbour. Their sign is the
    same where one of them is farther from the surface than from the other; elsewhere it is the
    winding number's, which costs ten times as much as the distance.
    """
    box = wp.tid()
    sy = nodes[2]
    sx = nodes[1] * nodes[2]
    start = box * nodes[0] * sx
    for x in range(nodes[0]):
        for y in range(nodes[1]):
            for z in range(nodes[2]):
                i = start + x * sx + y * sy + z
                p = lower[box] + spacing * wp.vec3(float(x), float(y), float(z))
                # neighbours among the nodes before, or the node itself where there is none
                back_z = wp.where(z > 0, i - 1, i)
                back_y = wp.where(y > 0, i - sy, i)
                back_x = wp.where(x > 0, i - sx, i)
                most = float(FAR)
                for k in range(3):
                    j = wp.where(k == 0, back_z, wp.where(k == 1, back_y, back_x))
                    if j != i:
                        most = wp.min(most, wp.abs(value[j]) + ROOM * spacing)
                d = measure(mesh, p, most)
                sign = float(0.0)
                if is_sheet == 1:
                    sign = 1.0
                for k in range(3):
                    j = wp.where(k == 0, back_z, wp.where(k == 1, back_y, back_x))
                    if sign == 0.0 and j != i:
                        if wp.max(d, wp.abs(value[j])) > ROOM * spacing:
                            sign = wp.where(value[j] < 0.0, -1.0, 1.0)
                if sign == 0.0:
                    sign = find_sign(mesh, p)
                value[i] = sign * d
