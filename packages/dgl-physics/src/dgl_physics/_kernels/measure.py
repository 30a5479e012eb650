# type: ignore  # kernels are in the language of Warp
"""Kernels that find intersections of a mesh.

Compiled without fast mathematics: signs of small volumes decide.
"""

import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.func
def volume(a: wp.vec3d, b: wp.vec3d, c: wp.vec3d, d: wp.vec3d):
    """Six times the signed volume of a tetrahedron."""
    return wp.dot(b - a, wp.cross(c - a, d - a))


@wp.func
def to_double(x: wp.vec3):
    return wp.vec3d(wp.float64(x[0]), wp.float64(x[1]), wp.float64(x[2]))


@wp.func
def is_pierced(p: wp.vec3d, q: wp.vec3d, a: wp.vec3d, b: wp.vec3d, c: wp.vec3d):
    """Decide if the segment pq goes through the inside of the triangle abc."""
    zero = wp.float64(0.0)
    if volume(p, a, b, c) * volume(q, a, b, c) >= zero:
        return False
    u = volume(p, q, a, b)
    v = volume(p, q, b, c)
    w = volume(p, q, c, a)
    return (u > zero and v > zero and w > zero) or (u < zero and v < zero and w < zero)


@wp.func
def is_corner(i: wp.int32, face: wp.vec3i):
    return i == face[0] or i == face[1] or i == face[2]


@wp.kernel
def find_crossings(
    mesh: wp.uint64,
    edges: wp.array(dtype=wp.vec2i),
    faces: wp.array(dtype=wp.vec3i),
    position: wp.array(dtype=wp.vec3),
    capacity: wp.int32,
    count: wp.array(dtype=wp.int32),
    found: wp.array(dtype=wp.vec3i),
):
    """List (edge's ends, face) of the edges that pierce a triangle they share no vertex with."""
    e = edges[wp.tid()]
    x = position[e[0]]
    y = position[e[1]]
    p = to_double(x)
    q = to_double(y)
    query = wp.mesh_query_aabb(mesh, wp.min(x, y), wp.max(x, y))
    face = wp.int32(0)
    while wp.mesh_query_aabb_next(query, face):
        t = faces[face]
        if not (is_corner(e[0], t) or is_corner(e[1], t)):
            a = to_double(position[t[0]])
            b = to_double(position[t[1]])
            c = to_double(position[t[2]])
            if is_pierced(p, q, a, b, c):
                slot = wp.atomic_add(count, 0, 1)
                if slot < capacity:
                    found[slot] = wp.vec3i(e[0], e[1], face)
