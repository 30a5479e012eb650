# type: ignore  # kernels are in the language of Warp
"""Where the surface of a moving shape is nearest to a point, and how it moves there."""

import warp as wp

from dgl_physics._kernels.distance import shape_distance
from dgl_physics._kernels.types import ShapeTable

wp.set_module_options({"enable_backward": False, "fast_math": True})


@wp.struct
class Hit:
    """The place of a shape's surface that is nearest to a point."""

    distance: wp.float32
    """Signed: below 0 for a point inside [m]."""
    normal: wp.vec3
    """Outwards, world frame."""
    surface: wp.vec3
    """The place, world frame [m]."""
    local: wp.vec3
    """The place in the shape's frame [m]."""


@wp.func
def find_hit(shapes: ShapeTable, s: wp.int32, pose: wp.transform, x: wp.vec3) -> Hit:
    """Find the place of the shape `s` at `pose` that is nearest to `x`."""
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
    """Displacement of the place since the shape was at `pose_before` [m]; exactly 0 on a shape that stands."""
    drift = wp.vec3(0.0, 0.0, 0.0)
    if shapes.is_moving[s] == 1:
        drift = hit.surface - wp.transform_point(pose_before, hit.local)
    return drift
