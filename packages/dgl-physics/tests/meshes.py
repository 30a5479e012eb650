"""Closed surfaces to collide with, and what is known of them."""

import numpy as np


def make_box(half):
    """Box of half sizes (3,): vertices (8, 3) and faces (12, 3)."""
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
    faces = [
        [0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
        [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3],
    ]  # fmt: skip
    return signs * half, np.array(faces)


def make_tube(centres, across, upward, radius, sides, *, is_ring):
    """Surface around a line; a ring closes on itself, else both ends are closed by a fan.

    Args:
        centres: Points of the line, (N, 3).
        across: Unit vectors at right angles to it, (N, 3).
        upward: Unit vectors at right angles to both, so that the line goes along across x upward.
        radius: At each point, (N,).
        sides: Vertices around.
        is_ring: Whether the last point is followed by the first.
    """
    n = len(centres)
    angle = np.arange(sides) * 2 * np.pi / sides
    arm = np.cos(angle)[:, None] * across[:, None] + np.sin(angle)[:, None] * upward[:, None]
    vertices = (centres[:, None] + np.reshape(radius, (-1, 1, 1)) * arm).reshape(-1, 3)
    i, j = np.divmod(np.arange((n if is_ring else n - 1) * sides), sides)
    a, b = i * sides + j, i * sides + (j + 1) % sides
    c, d = (i + 1) % n * sides + j, (i + 1) % n * sides + (j + 1) % sides
    faces = [np.column_stack([a, b, d]), np.column_stack([a, d, c])]
    if not is_ring:
        k = np.arange(sides)
        first, last = np.full(sides, n * sides), np.full(sides, n * sides + 1)
        faces.append(np.column_stack([first, (k + 1) % sides, k]))
        end = (n - 1) * sides
        faces.append(np.column_stack([last, end + k, end + (k + 1) % sides]))
        vertices = np.concatenate([vertices, centres[[0, -1]]])
    return vertices, np.concatenate(faces)


def make_torus(major, minor, *, rings=128, sides=24):
    """Torus around z; its corners lie on the surface."""
    t = np.arange(rings) * 2 * np.pi / rings
    radial = np.column_stack([np.cos(t), np.sin(t), 0 * t])
    up = np.tile([0.0, 0.0, 1.0], (rings, 1))
    return make_tube(major * radial, -radial, up, np.full(rings, minor), sides, is_ring=True)


def make_sphere(radius, *, rings=64, sides=96):
    """Sphere; its corners lie on the surface."""
    t = np.linspace(-1, 1, rings + 2)[1:-1] * np.pi / 2
    line = np.column_stack([0 * t, 0 * t, radius * np.sin(t)])
    x, y = np.tile([1.0, 0, 0], (rings, 1)), np.tile([0, 1.0, 0], (rings, 1))
    vertices, faces = make_tube(line, x, y, radius * np.cos(t), sides, is_ring=False)
    vertices[-2:] = [[0, 0, -radius], [0, 0, radius]]
    return vertices, faces


def make_cylinder(radius, half_length, *, sides=96):
    """Cylinder along z."""
    line = np.array([[0, 0, -half_length], [0, 0, half_length]], dtype=float)
    x, y = np.tile([1.0, 0, 0], (2, 1)), np.tile([0, 1.0, 0], (2, 1))
    return make_tube(line, x, y, np.full(2, radius), sides, is_ring=False)


def box_distance(x, half):
    """Signed distance of points (N, 3) from a box."""
    q = np.abs(x) - half
    return np.linalg.norm(np.maximum(q, 0), axis=1) + np.minimum(q.max(axis=1), 0)


def torus_distance(x, major, minor):
    """Signed distance of points (N, 3) from a torus around z."""
    return np.hypot(np.hypot(x[:, 0], x[:, 1]) - major, x[:, 2]) - minor


def sphere_distance(x, radius):
    """Signed distance of points (N, 3) from a sphere."""
    return np.linalg.norm(x, axis=1) - radius
