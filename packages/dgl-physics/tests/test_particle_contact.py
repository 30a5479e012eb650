"""Cloth on cloth: layers stay in order, friction and adhesion between particles."""

import numpy as np
import pytest

from dgl_physics import ClothMaterial, ModelBuilder, topology

EDGE = 0.0125
THICKNESS = ClothMaterial().thickness
# Particles keep apart, not triangles: one in the middle of a triangle is held by the corners at
# this height.
LEAST = np.sqrt(THICKNESS**2 - EDGE**2 / 3)


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


def drop_two_layers(run, sheet, builder):
    """Heights of each layer over the other, where they overlap, after they came to rest."""
    upper, faces = sheet(0.2, 0.2, EDGE, height=0.08)
    lower, _ = sheet(0.2, 0.2, EDGE, height=0.03)
    builder.add_garment(turned(lower, 0.3), faces)
    builder.add_garment(upper, faces)
    builder.add_ground()
    r = run(builder).step(120)
    lower, upper = r.x[: len(lower)], r.x[len(lower) :]
    assert np.abs(r.v).max() < 0.02
    above = distance_over_surface(upper, lower, faces)
    below = -distance_over_surface(lower, upper, faces)
    return above[np.isfinite(above)], below[np.isfinite(below)]


def test_two_dropped_layers_lie_on_each_other(run, sheet, builder):
    """Not two in a hundred particles are on the wrong side of the other layer."""
    for heights in drop_two_layers(run, sheet, builder):
        assert len(heights) > 200
        assert np.percentile(heights, 2) > 0
        assert np.median(heights) > LEAST


def test_two_dropped_layers_stay_in_order_everywhere(run, sheet, builder):
    for heights in drop_two_layers(run, sheet, builder):
        assert heights.min() > 0.5 * LEAST


def drop_in_a_heap(run, sheet, builder):
    """Distances of the particles in touch that share no edge, in a sheet dropped on its edge."""
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
    return gap[gap < THICKNESS]


def test_most_particles_of_crumpled_cloth_keep_apart(run, sheet, builder):
    gaps = drop_in_a_heap(run, sheet, builder)
    assert len(gaps) > 100
    assert np.median(gaps) > 0.85 * THICKNESS


def test_all_particles_of_crumpled_cloth_keep_apart(run, sheet, builder):
    assert drop_in_a_heap(run, sheet, builder).min() > 0.5 * THICKNESS


def lie_on_cloth(run, sheet, *, friction, scale, tangent, frames=60):
    """Measure the slip of a patch down a slope of fixed cloth."""
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
    # Cloth on cloth creeps by 2 mm/s: see Limitations in docs/physics.md.
    assert np.abs(lie_on_cloth(run, sheet, friction=1.0, scale=0.5, tangent=0.3)).max() < 0.003
    assert lie_on_cloth(run, sheet, friction=1.0, scale=0.0, tangent=0.3, frames=20).min() > 0.02
    # the scale is relative to the friction of the material
    assert lie_on_cloth(run, sheet, friction=0.0, scale=0.5, tangent=0.3, frames=20).min() > 0.02


def test_steep_slopes_overcome_friction_between_particles(run, sheet):
    moved = lie_on_cloth(run, sheet, friction=1.0, scale=0.2, tangent=1.0, frames=20)
    assert moved.min() > 0.02


def hang_below_cloth(run, sheet, *, adhesion, scale):
    """Measure the fall of a patch from fixed cloth above it within half a second."""
    builder = ModelBuilder(1)
    material = ClothMaterial(adhesion=adhesion, particle_adhesion_scale=scale, drag=5.0)
    upper, upper_faces = sheet(0.15, 0.15, EDGE)
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


def pile(run, sheet, layers):
    """Stack sheets on the ground, and let them lie for four seconds."""
    builder = ModelBuilder(1)
    for k in range(layers):
        vertices, faces = sheet(0.15, 0.15, EDGE, height=0.004 + k * THICKNESS)
        builder.add_garment(turned(vertices, 0.3 * k), faces)
    builder.add_ground()
    return run(builder).step(240)


@pytest.mark.parametrize("layers", [2, 4, 8])
def test_a_pile_does_not_collapse(run, sheet, layers):
    """The layers of a pile rest on each other, at least as high as in each other's hollows."""
    heights = pile(run, sheet, layers).x[:, 2].reshape(layers, -1).mean(axis=1)
    assert np.diff(heights).min() > LEAST


@pytest.mark.parametrize(("layers", "creep"), [(2, 1e-4), (4, 5e-4)])
def test_a_pile_comes_to_rest(run, sheet, layers, creep):
    """In one second a particle moves by less than this: cloth on cloth creeps a little."""
    r = pile(run, sheet, layers)
    before = r.x
    assert np.abs(r.v).max() < 0.02
    assert np.abs(r.step(60).x - before).max() < creep


def place_two_layers(run, sheet, *, gap, velocities, **config):
    """Two free sheets above each other, each with its velocity [m/s], without gravity and air."""
    builder = ModelBuilder(1)
    material = ClothMaterial(drag=0.0, adhesion=0.0)
    for k in (0, 1):
        vertices, faces = sheet(0.1, 0.1, EDGE, height=gap * k)
        builder.add_garment(turned(vertices, 0.3 * k), faces, material=material)
    r = run(builder, gravity=(0, 0, 0), **config)
    r.state.set_particles(r.x[None], np.repeat(velocities, len(vertices), axis=0)[None])
    return r, faces


too_fast = pytest.mark.xfail(
    reason="one search a frame finds fast layers late or never: see docs/physics.md"
)


@pytest.mark.parametrize(("speed", "every"), [(0.9, 12), (2.0, 3), (4.0, 3)])
def test_layers_do_not_pass_through_each_other(run, sheet, speed, every):
    r, faces = place_two_layers(
        run, sheet, gap=0.03, velocities=[[0, 0, 0], [0, 0, -speed]], search_every=every
    )
    lower, upper = np.split(r.step(round(0.05 / speed * 60) + 6).x, 2)
    heights = distance_over_surface(upper, lower, faces)
    assert np.isfinite(heights).sum() > 50
    assert np.nanmin(heights) > 0


@pytest.mark.parametrize(("speed", "every"), [(0.5, 12), (0.8, 12), (1.0, 3)])
def test_layers_that_meet_keep_their_momentum(run, sheet, speed, every):
    r, _ = place_two_layers(
        run, sheet, gap=0.03, velocities=[[0, 0, 0], [0, 0, -speed]], search_every=every
    )
    before = (r.mass[:, None] * r.v).sum(axis=0)
    energy = (r.mass[:, None] * r.v**2).sum()
    r.step(round(0.05 / speed * 60) + 6)
    after = (r.mass[:, None] * r.v).sum(axis=0)
    assert (
        r.mass[:, None] * r.v**2
    ).sum() < 0.7 * energy  # they did meet: half is left of what stays together
    assert after == pytest.approx(before, abs=0.01 * np.linalg.norm(before))


def leave_overlap(run, sheet, *, gap, common=(0.0, 0.0, 0.0), **config):
    """Mean velocity of each of two overlapping sheets after 10 frames, less the common one."""
    r, _ = place_two_layers(run, sheet, gap=gap, velocities=[common, common], **config)
    return [half.mean(axis=0) - common for half in np.split(r.step(10).v, 2)]


def test_separation_speed_bounds_how_fast_layers_part(run, sheet):
    """Of a quarter of the thickness; deeper overlaps are left faster, as the cloth is bent too."""
    for speed in (0.1, 1.0):
        low, high = leave_overlap(run, sheet, gap=0.75 * THICKNESS, separation_speed=speed)
        assert 0 < high[2] - low[2] < speed
        assert high[2] + low[2] == pytest.approx(0, abs=0.005)


def test_overlap_is_left_alike_in_moving_cloth(run, sheet):
    resting = leave_overlap(run, sheet, gap=0.75 * THICKNESS)
    moving = leave_overlap(run, sheet, gap=0.75 * THICKNESS, common=(0.0, 0.0, 1.0))
    assert moving == pytest.approx(np.array(resting), abs=0.01)
