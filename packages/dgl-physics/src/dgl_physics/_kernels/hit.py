# type: ignore  # kernels are in the language of Warp
"""Nearest point on the surface of a moving shape, and its displacement."""

import warp as wp

from dgl_physics._kernels.distance import shape_distance
from dgl_physics._kernels.types import ShapeTable

wp.set_module_options({"enable_backward": False, "fast_math": True})


@wp.struct
class Hit:
    """The point of a shape's surface that is nearest to a given point."""

    distance: wp.float32
    """Signed distance [m], negative inside."""
    normal: wp.vec3
    """Outward unit normal, world frame."""
    surface: wp.vec3
    """World frame [m]."""
    local: wp.vec3
    """Frame of the shape [m]."""


@wp.func
def find_hit(shapes: ShapeTable, s: wp.int32, pose: wp.transform, x: wp.vec3) -> Hit:
    """Find the surface point of the shape `s` at `pose` that is nearest to `x`."""
    q = wp.transform_get_rotation(pose)
    at = wp.quat_rotate_inv(q, x - wp.transform_get_translation(pose))
    found = shape_distance(shapes.kind[s], shapes.size[s], shapes.grid[s], shapes.grids, at)
    normal = wp.vec3(found[0], found[1], found[2])
    hit = Hit()
    hit.distance = found[3]
    hit.normal = wp.quat_rotate(q, normal)
    hit.surface = x - hit.normal * found[3]
    hit.local = at - normal * found[3]
    return hit


@wp.func
def find_drift(shapes: ShapeTable, s: wp.int32, pose_before: wp.transform, hit: Hit):
    """Compute the displacement of a surface point since `pose_before` [m]; 0 for fixed shapes."""
    drift = wp.vec3(0.0, 0.0, 0.0)
    if shapes.is_moving[s] == 1:
        drift = hit.surface - wp.transform_point(pose_before, hit.local)
    return drift
