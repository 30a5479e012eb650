# type: ignore  # kernels are in the language of Warp
"""Projection of vertices, rasterisation of triangles, positions of pixels.

A pixel holds one 64-bit key: its inverse depth in the upper bits, the number of its triangle,
counted from 1, in the lower ones. The largest key is seen, in whatever order triangles come.
"""

import warp as wp

from dgl_physics.drawing._kernels.types import Camera, Geometry, Looks

wp.set_module_options({"enable_backward": False, "fast_math": True})

_EDGE = wp.constant(-1.0e-5)  # weights down to this are inside: neighbours leave no crack
_FLAT = wp.constant(1.0e-20)  # volume below which a triangle is seen from its edge
_SHORT = wp.constant(3.0)  # rows up to this are gone through pixel by pixel


@wp.kernel
def place_vertices(
    camera: Camera, first: wp.int32, poses: wp.array(dtype=wp.transform), geometry: Geometry
):
    """Bring vertices from `first` on into the picture."""
    i = first + wp.tid()
    pose = poses[geometry.body[i]]
    geometry.normal[i] = wp.transform_vector(pose, geometry.local_normal[i])
    x = wp.transform_point(pose, geometry.local[i])
    c = camera.rotation * (x - camera.position)
    geometry.projected[i] = wp.vec3(
        camera.focal * c[0] + camera.centre_x * c[2],
        camera.focal * c[1] + camera.centre_y * c[2],
        c[2],
    )


@wp.kernel
def draw_triangles(
    camera: Camera,
    first: wp.int32,
    geometry: Geometry,
    looks: Looks,
    keys: wp.array(dtype=wp.uint64),
):
    """Enter triangles from `first` on in the keys of the pixels they cover.

    Homogeneous coordinates need no clipping (Olano and Greer 1997). Their origin is a corner of the
    triangle's rectangle, which keeps small triangles exact.
    """
    t = first + wp.tid()
    corners = geometry.triangles[t]
    a = geometry.projected[corners[0]]
    b = geometry.projected[corners[1]]
    c = geometry.projected[corners[2]]
    near = camera.near
    if a[2] < near and b[2] < near and c[2] < near:
        return
    shows_back = looks.materials[geometry.material[t]].inside_shade > 0.0
    x0 = wp.int32(0)
    y0 = wp.int32(0)
    x1 = camera.width - 1
    y1 = camera.height - 1
    if a[2] >= near and b[2] >= near and c[2] >= near:
        ax = a[0] / a[2]
        ay = a[1] / a[2]
        bx = b[0] / b[2]
        by = b[1] / b[2]
        cx = c[0] / c[2]
        cy = c[1] / c[2]
        # most triangles end here: they show their back, or lie between the centres of pixels
        if (bx - ax) * (cy - ay) > (by - ay) * (cx - ax) and not shows_back:
            return
        x0 = _get_first(wp.min(ax, wp.min(bx, cx)), camera.width)
        x1 = _get_last(wp.max(ax, wp.max(bx, cx)), camera.width)
        y0 = _get_first(wp.min(ay, wp.min(by, cy)), camera.height)
        y1 = _get_last(wp.max(ay, wp.max(by, cy)), camera.height)
    if x0 > x1 or y0 > y1:
        return
    origin = wp.vec3(wp.float32(x0) + 0.5, wp.float32(y0) + 0.5, 0.0)
    a = a - origin * a[2]
    b = b - origin * b[2]
    c = c - origin * c[2]
    # The weight of a corner over the depth is linear in the picture: slopes, value at the origin.
    ea = wp.cross(b, c)
    eb = wp.cross(c, a)
    ec = wp.cross(a, b)
    volume = wp.dot(a, ea)
    # Rows run downward: the front is clockwise in the picture, and its volume negative.
    if wp.abs(volume) < _FLAT or (volume > 0.0 and not shows_back):
        return
    ea = ea / volume
    eb = eb / volume
    ec = ec / volume
    total = ea + eb + ec  # the inverse depth
    number = wp.uint64(t + 1)
    last = wp.float32(x1 - x0)
    nearest = 1.0 / near
    farthest = 1.0 / camera.far
    for y in range(y0, y1 + 1):
        fy = wp.float32(y - y0)
        ra = ea[1] * fy + ea[2]
        rb = eb[1] * fy + eb[2]
        rc = ec[1] * fy + ec[2]
        rt = total[1] * fy + total[2]
        low = wp.float32(0.0)
        high = last
        if last > _SHORT:  # a long thin triangle fills little of its rectangle
            low = wp.max(
                wp.max(low, _enter(ea[0], ra)), wp.max(_enter(eb[0], rb), _enter(ec[0], rc))
            )
            high = wp.min(
                wp.min(last, _leave(ea[0], ra)), wp.min(_leave(eb[0], rb), _leave(ec[0], rc))
            )
        # a place that is no whole number of 32 bits may become any
        begin = wp.clamp(x0 + wp.int32(low), x0, x1 + 1)
        end = wp.clamp(x0 + wp.int32(high), x0 - 1, x1)
        for x in range(begin, end + 1):
            fx = wp.float32(x - x0)
            inverse = total[0] * fx + rt
            least = wp.min(ea[0] * fx + ra, wp.min(eb[0] * fx + rb, ec[0] * fx + rc))
            if least >= _EDGE * inverse and inverse <= nearest and inverse >= farthest:
                key = (wp.uint64(wp.cast(inverse, wp.uint32)) << wp.uint64(32)) | number
                wp.atomic_max(keys, y * camera.width + x, key)


@wp.func
def _get_first(place: wp.float32, size: wp.int32) -> wp.int32:
    """Find the first pixel whose centre is not before a position [pixels]."""
    return wp.int32(wp.ceil(wp.clamp(place - 0.5, 0.0, wp.float32(size))))


@wp.func
def _get_last(place: wp.float32, size: wp.int32) -> wp.int32:
    """Find the last pixel whose centre is not behind a position [pixels]."""
    return wp.int32(wp.floor(wp.clamp(place - 0.5, -1.0, wp.float32(size - 1))))


@wp.func
def _enter(slope: wp.float32, value: wp.float32) -> wp.float32:
    """Find the column where a row enters an edge, less one pixel."""
    return wp.where(slope > 0.0, -value / slope - 1.0, -1.0)


@wp.func
def _leave(slope: wp.float32, value: wp.float32) -> wp.float32:
    """Find the column where a row leaves an edge, plus one pixel."""
    return wp.where(slope < 0.0, -value / slope + 1.0, 1.0e6)


@wp.func
def get_triangle(key: wp.uint64) -> wp.int32:
    """Return the number of the triangle that a pixel shows; -1 for none."""
    return wp.int32(key & wp.uint64(0xFFFFFFFF)) - 1


@wp.func
def trace(camera: Camera, pixel: wp.int32) -> wp.vec3:
    """Compute the ray through a pixel's centre, of depth 1 along the optical axis, world frame."""
    ray = wp.vec3(
        (wp.float32(pixel % camera.width) + 0.5 - camera.centre_x) / camera.focal,
        (wp.float32(pixel // camera.width) + 0.5 - camera.centre_y) / camera.focal,
        1.0,
    )
    return wp.transpose(camera.rotation) * ray


@wp.kernel
def locate_pixels(
    camera: Camera,
    first: wp.int32,
    geometry: Geometry,
    looks: Looks,
    keys: wp.array(dtype=wp.uint64),
    points: wp.array(dtype=wp.vec3),
    segments: wp.array(dtype=wp.int32),
):
    """Write segments and positions of pixels that show a triangle from `first` on, no shadow."""
    i = wp.tid()
    t = get_triangle(keys[i])
    if t < first:
        return
    segment = looks.materials[geometry.material[t]].segment
    if segment < 0:
        return
    segments[i] = segment
    inverse = wp.cast(wp.uint32(keys[i] >> wp.uint64(32)), wp.float32)
    points[i] = camera.position + trace(camera, i) / inverse
