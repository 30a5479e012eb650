"""Cloth on cloth: layers stay in order, friction and adhesion between particles."""

import numpy as np
import pytest

from dgl_physics import ClothMaterial, ModelBuilder
from dgl_physics import topology

EDGE = 0.0125
THICKNESS = ClothMaterial().thickness


def turned(vertices, angle):
    c, s = np.cos(angle), np.sin(angle)
    return vertices @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])


def distance_over_surface(points, vertices, faces):
    """Height of points over the mesh below or above them, NaN beside it; shape (N,)."""
    height = np.full(len(points), np.nan)
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    d0, d1 = b - a, c - a
    det = d0[:, 0] * d1[:, 1] - d0[:, 1] * d1[:, 0]
    for k, p in enumerate(points):
        q = p - a
        u = (q[:, 0] * d1[:, 1] - q[:, 1] * d1[:, 0]) / det
        v = (d0[:, 0] * q[:, 1] - d0[:, 1] * q[:, 0]) / det
        inside = (u >= 0) & (v >= 0) & (u + v <= 1)
        if inside.any():
            height[k] = (q[inside, 2] - u[inside] * d0[inside, 2] - v[inside] * d1[inside, 2]).min()
    return height


def test_two_dropped_layers_stay_in_order(run, sheet, builder):
    """The upper layer comes to rest on the lower: no particle of one is below the other."""
    upper, faces = sheet(0.2, 0.2, EDGE, height=0.08)
    lower, _ = sheet(0.2, 0.2, EDGE, height=0.03)
    builder.add_garment(turned(lower, 0.3), faces)
    builder.add_garment(upper, faces)
    builder.add_ground()
    r = run(builder).step(120)
    lower, upper = r.x[: len(lower)], r.x[len(lower) :]
    # particles keep apart, not triangles: one in the middle of a triangle of this edge is held
    # by its corners at this height
    least = np.sqrt(THICKNESS**2 - EDGE**2 / 3)
    height = distance_over_surface(upper, lower, faces)
    assert np.nanmin(height) > 0.5 * least
    assert np.nanmax(distance_over_surface(lower, upper, faces)) < -0.5 * least
    assert np.abs(r.v).max() < 0.02


def test_a_sheet_dropped_on_its_edge_does_not_pass_through_itself(run, sheet, builder):
    """Particles that are no neighbours in the mesh keep their distance in a crumpled heap."""
    vertices, faces = sheet(0.3, 0.3, EDGE)
    vertices = vertices[:, [0, 2, 1]] + [0, 0, 0.17]
    vertices[:, 1] = 0.01 * np.sin(30 * vertices[:, 2])
    builder.add_garment(vertices, faces)
    builder.add_ground()
    r = run(builder).step(90)
    gap = np.linalg.norm(r.x[:, None] - r.x[None], axis=2)
    gap[np.diag_indices(len(gap))] = 1
    edges = topology.compute_edges(faces)
    gap[edges[:, 0], edges[:, 1]] = gap[edges[:, 1], edges[:, 0]] = 1
    assert r.x[:, 2].max() < 0.2  # it did fall in a heap
    assert gap.min() > 0.5 * THICKNESS


def lie_on_cloth(run, sheet, *, friction, scale, tangent, frames=60):
    """How far a patch slides down a slope of fixed cloth."""
    builder = ModelBuilder(1)
    material = ClothMaterial(
        friction=friction, particle_friction_scale=scale, adhesion=0.0, drag=0.0
    )
    lower, lower_faces = sheet(0.3, 0.15, 0.006)
    upper, faces = sheet(0.08, 0.08, EDGE, height=THICKNESS)
    builder.add_garment(lower, lower_faces, pinned=tuple(range(len(lower))), material=material)
    builder.add_garment(turned(upper, 0.35), faces, material=material)
    angle = np.arctan(tangent)
    gravity = (float(9.81 * np.sin(angle)), 0.0, float(-9.81 * np.cos(angle)))
    r = run(builder, gravity=gravity)
    start = r.x[len(lower) :]
    r.step(frames)
    return (r.x[len(lower) :] - start)[:, 0]


def test_friction_scale_holds_a_patch_on_cloth(run, sheet):
    assert np.abs(lie_on_cloth(run, sheet, friction=1.0, scale=0.5, tangent=0.3)).max() < 0.002
    assert lie_on_cloth(run, sheet, friction=1.0, scale=0.0, tangent=0.3, frames=20).min() > 0.02
    # the scale is relative to the friction of the material
    assert lie_on_cloth(run, sheet, friction=0.0, scale=0.5, tangent=0.3, frames=20).min() > 0.02


def test_steep_slopes_overcome_friction_between_particles(run, sheet):
    moved = lie_on_cloth(run, sheet, friction=1.0, scale=0.2, tangent=1.0, frames=20)
    assert moved.min() > 0.02


def hang_below_cloth(run, sheet, *, adhesion, scale):
    """How far a patch falls from fixed cloth above it within half a second."""
    builder = ModelBuilder(1)
    material = ClothMaterial(adhesion=adhesion, particle_adhesion_scale=scale, drag=5.0)
    upper, upper_faces = sheet(0.15, 0.15, 0.006)
    lower, faces = sheet(0.08, 0.08, EDGE, height=-THICKNESS - 0.001)
    builder.add_garment(upper, upper_faces, pinned=tuple(range(len(upper))), material=material)
    builder.add_garment(turned(lower, 0.35), faces, material=material)
    r = run(builder).step(30)
    return -THICKNESS - r.x[len(upper) :, 2]


def test_adhesion_scale_holds_a_patch_under_cloth(run, sheet):
    assert hang_below_cloth(run, sheet, adhesion=0.2, scale=1.0).max() < 0.004
    assert hang_below_cloth(run, sheet, adhesion=0.2, scale=0.05).min() > 0.5
    assert hang_below_cloth(run, sheet, adhesion=0.2, scale=0.0).min() > 0.5
    assert hang_below_cloth(run, sheet, adhesion=0.0, scale=1.0).min() > 0.5


@pytest.mark.parametrize("layers", [2, 4])
def test_a_pile_keeps_its_height(run, sheet, builder, layers):
    """The layers of a pile rest on each other, and come to rest."""
    for k in range(layers):
        vertices, faces = sheet(0.15, 0.15, EDGE, height=0.004 + k * THICKNESS)
        builder.add_garment(vertices, faces)
    builder.add_ground()
    r = run(builder).step(60)
    n = len(vertices)
    means = np.array([r.x[k * n : (k + 1) * n, 2].mean() for k in range(layers)])
    assert np.diff(means) == pytest.approx(THICKNESS, rel=0.1)
    assert np.abs(r.v).max() < 0.02
