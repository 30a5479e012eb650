# type: ignore  # kernels are in the language of Warp
"""Signed distances of rigid shapes: primitives exactly, meshes from grids."""

import warp as wp

from dgl_physics._kernels.types import Grid

wp.set_module_options({"enable_backward": False, "fast_math": True})

PLANE = wp.constant(0)
SPHERE = wp.constant(1)
CAPSULE = wp.constant(2)
BOX = wp.constant(3)
CYLINDER = wp.constant(4)
GRID = wp.constant(5)  # and above
BLOCK = wp.constant(4)
"""Fine cells along the side of a block."""
HALF_DIAGONAL = wp.constant(0.8661)
"""Half diagonal of a unit cube, rounded up: largest distance from the nearest node."""


@wp.func
def box_distance(size: wp.vec3, p: wp.vec3):
    """Distance and normal of a box with the given half sizes."""
    q = wp.vec3(wp.abs(p[0]) - size[0], wp.abs(p[1]) - size[1], wp.abs(p[2]) - size[2])
    if q[0] > 0.0 or q[1] > 0.0 or q[2] > 0.0:
        o = wp.vec3(wp.max(q[0], 0.0), wp.max(q[1], 0.0), wp.max(q[2], 0.0))
        r = wp.length(o)
        return wp.vec4(
            wp.sign(p[0]) * o[0] / r, wp.sign(p[1]) * o[1] / r, wp.sign(p[2]) * o[2] / r, r
        )
    if q[0] >= q[1] and q[0] >= q[2]:
        return wp.vec4(wp.sign(p[0]), 0.0, 0.0, q[0])
    if q[1] >= q[2]:
        return wp.vec4(0.0, wp.sign(p[1]), 0.0, q[1])
    return wp.vec4(0.0, 0.0, wp.sign(p[2]), q[2])


@wp.func
def cylinder_distance(radius: wp.float32, half_length: wp.float32, p: wp.vec3):
    """Distance and normal of a cylinder along z."""
    r = wp.sqrt(p[0] * p[0] + p[1] * p[1])
    radial = wp.vec3(1.0, 0.0, 0.0)
    if r > 1.0e-9:
        radial = wp.vec3(p[0] / r, p[1] / r, 0.0)
    side = r - radius
    end = wp.abs(p[2]) - half_length
    up = wp.sign(p[2])
    if side > 0.0 and end > 0.0:
        d = wp.sqrt(side * side + end * end)
        n = radial * (side / d)
        return wp.vec4(n[0], n[1], up * end / d, d)
    if side >= end:
        return wp.vec4(radial[0], radial[1], 0.0, side)
    return wp.vec4(0.0, 0.0, up, end)


@wp.func
def grid_distance(grids: wp.array(dtype=Grid), g: wp.int32, p: wp.vec3):
    """Distance and normal by trilinear interpolation, with the gradient of the interpolant.

    Outside the grid's box, where there is no contact, a lower bound of the distance.
    """
    grid = grids[g]
    blocks = grid.blocks
    width = grid.spacing * float(BLOCK)
    half = 0.5 * width * wp.vec3(float(blocks[0]), float(blocks[1]), float(blocks[2]))
    from_lower = p - grid.lower
    hit = box_distance(half, from_lower - half)
    if hit[3] >= 0.0:
        return wp.vec4(hit[0], hit[1], hit[2], hit[3] + grid.reach)
    u = from_lower / width
    # the clamp is for rounding alone: the point is inside the box
    bx = wp.clamp(int(u[0]), 0, blocks[0] - 1)
    by = wp.clamp(int(u[1]), 0, blocks[1] - 1)
    bz = wp.clamp(int(u[2]), 0, blocks[2] - 1)
    f = u - wp.vec3(float(bx), float(by), float(bz))
    first = grid.first_fine[(bx * blocks[1] + by) * blocks[2] + bz]
    sy = blocks[2] + 1
    sx = sy * (blocks[1] + 1)
    if first >= 0:
        width = grid.spacing
        f = f * float(BLOCK)
        cx = wp.clamp(int(f[0]), 0, BLOCK - 1)
        cy = wp.clamp(int(f[1]), 0, BLOCK - 1)
        cz = wp.clamp(int(f[2]), 0, BLOCK - 1)
        f = f - wp.vec3(float(cx), float(cy), float(cz))
        sy = BLOCK + 1
        sx = sy * (BLOCK + 1)
        first = first + cx * sx + cy * sy + cz
    else:
        first = bx * sx + by * sy + bz
    v000 = grid.value[first]
    v001 = grid.value[first + 1]
    v010 = grid.value[first + sy]
    v011 = grid.value[first + sy + 1]
    v100 = grid.value[first + sx]
    v101 = grid.value[first + sx + 1]
    v110 = grid.value[first + sx + sy]
    v111 = grid.value[first + sx + sy + 1]
    v00 = v000 + f[2] * (v001 - v000)
    v01 = v010 + f[2] * (v011 - v010)
    v10 = v100 + f[2] * (v101 - v100)
    v11 = v110 + f[2] * (v111 - v110)
    v0 = v00 + f[1] * (v01 - v00)
    v1 = v10 + f[1] * (v11 - v10)
    z0 = (v001 - v000) + f[1] * ((v011 - v010) - (v001 - v000))
    z1 = (v101 - v100) + f[1] * ((v111 - v110) - (v101 - v100))
    n = wp.vec3(v1 - v0, (v01 - v00) + f[0] * ((v11 - v10) - (v01 - v00)), z0 + f[0] * (z1 - z0))
    length = wp.length(n)
    if length > 1.0e-6 * width:
        n = n / length
    else:
        n = wp.vec3(0.0, 0.0, 1.0)  # the middle of something thin: any way out is as short
    return wp.vec4(n[0], n[1], n[2], v0 + f[0] * (v1 - v0))


@wp.func
def primitive_distance(kind: wp.int32, size: wp.vec3, p: wp.vec3):
    """Outward normal and signed distance of a primitive at a point of its frame."""
    if kind == PLANE:
        return wp.vec4(0.0, 0.0, 1.0, p[2])
    if kind == SPHERE or kind == CAPSULE:
        axis = wp.vec3(0.0, 0.0, wp.clamp(p[2], -size[1], size[1]))
        d = p - axis
        r = wp.length(d)
        n = wp.vec3(1.0, 0.0, 0.0)
        if r > 1.0e-9:
            n = d / r
        return wp.vec4(n[0], n[1], n[2], r - size[0])
    if kind == CYLINDER:
        return cylinder_distance(size[0], size[1], p)
    return box_distance(size, p)


@wp.func
def shape_distance(
    kind: wp.int32, size: wp.vec3, grid: wp.int32, grids: wp.array(dtype=Grid), p: wp.vec3
):
    """Outward normal and signed distance of a shape at a point of its frame."""
    if kind >= GRID:
        return grid_distance(grids, grid, p)
    return primitive_distance(kind, size, p)


@wp.func
def bound_distance(
    kind: wp.int32, size: wp.vec3, grid: wp.int32, grids: wp.array(dtype=Grid), p: wp.vec3
):
    """Lower bound of the distance of a shape at a point of its frame."""
    d = shape_distance(kind, size, grid, grids, p)[3]
    if kind >= GRID:
        # An interpolated distance is wrong by less than the way to the nearest node; and where
        # only the coarse grid is, outside, the surface is farther than the grid's reach.
        slack = HALF_DIAGONAL * grids[grid].spacing
        d = wp.max(d - float(BLOCK) * slack, wp.min(d - slack, grids[grid].reach))
    return d
