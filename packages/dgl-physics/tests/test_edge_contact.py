"""Rigid shapes do not pass between the particles of cloth."""

import numpy as np
import pytest

from dgl_physics import ClothMaterial, ModelBuilder, Shape, SolidMaterial
from dgl_physics.edge_contact import EdgeContact

EDGE = 0.0125
RADIUS = 0.009  # of a finger's tip [m]


def count_pierced(x, faces, start, end):
    """Count the triangles of particles (V, 3) that a segment passes through."""
    corner, one, two = (x[faces[:, k]] for k in range(3))
    one, two, way, arm = one - corner, two - corner, end - start, start - corner
    across = np.cross(way, two)
    volume = (one * across).sum(axis=1)
    volume = np.where(np.abs(volume) > 1e-15, volume, np.inf)
    u = (arm * across).sum(axis=1) / volume
    turned = np.cross(arm, one)
    v = turned @ way / volume
    t = (two * turned).sum(axis=1) / volume
    return int(((u >= 0) & (v >= 0) & (u + v <= 1) & (t >= 0) & (t <= 1)).sum())


def poke(run, sheet, builder, device, *, beside):
    """Push a finger 5 cm into a sheet held at its rim; returns the triangles around it."""
    vertices, faces = sheet(0.12, 0.12, EDGE)
    rim = np.flatnonzero(np.abs(vertices[:, :2]).max(axis=1) > 0.05)
    builder.add_garment(vertices, faces, pinned=rim)
    finger = Shape(kind="capsule", size=(RADIUS, 0.02, 0))
    builder.add_shape(finger, body=builder.add_body("finger"))
    r = run(builder, device=device)
    for k in range(41):
        height = 0.043 - min(0.005 * k, 0.054)
        r.move([[*beside, height, 1, 0, 0, 0]], is_jump=k == 0)
        r.step()
    axis = np.array([[*beside, height - 0.029], [*beside, height + 0.02]])
    return count_pierced(r.x, faces, *axis)


@pytest.mark.parametrize("beside", [(0.004, 0.003), (0.002, 0.005), (0.0, 0.004)])
def test_a_finger_does_not_pass_between_particles(run, sheet, builder, device, beside, monkeypatch):
    """Contact of particles alone let the triangle before the tip stretch over it."""
    assert poke(run, sheet, builder, device, beside=beside) == 0
    monkeypatch.setattr(EdgeContact, "solve", lambda self, state, dt, inverse_mass, previous: None)
    assert poke(run, sheet, type(builder)(1), device, beside=beside) == 1


def hang_over_needle(run, sheet, builder, device, *, depth, frames, friction=0.0):
    """Lay an edge across a thin bar along x, `depth` under its top, without gravity."""
    vertices, faces = sheet(0.05, 0.05, EDGE)
    material = ClothMaterial(drag=0.0, adhesion=0.0, friction=friction)
    builder.add_garment(vertices, faces, material=material)
    pose = np.array([0, 0, depth - 0.002, 1, 0, 0, 0])
    bar = builder.add_shape(Shape(kind="box", size=(0.1, 0.0012, 0.002), pose=pose))
    r = run(builder, device=device)
    r.state.set_gravity_scale(0.0)
    total = np.zeros(6)
    for _ in range(frames):
        r.step()
        total += r.state.impulse.numpy()[0, bar]
    return r, total


def test_an_old_overlap_is_undone_without_a_throw(run, sheet, builder, device):
    """Edges 1 mm inside a bar leave it at once, slower than `separation_speed`."""
    r, total = hang_over_needle(run, sheet, builder, device, depth=0.001, frames=1)
    assert r.x[:, 2].max() > 0.001  # the ends of the edges have risen
    assert np.abs(r.v).max() < 0.15
    lost = -(r.mass[:, None] * r.v).sum(axis=0)
    assert np.linalg.norm(lost) > 0
    assert total[2] < 0  # the bar is pressed down


def test_a_shape_above_the_middle_of_an_edge_moves_nothing(run, sheet, builder, device):
    """A middle may be as near as a quarter of the rest offset: 1 mm of 4."""
    r, total = hang_over_needle(run, sheet, builder, device, depth=-0.0011, frames=5)
    assert np.abs(r.x[:, 2]).max() < 1e-6
    assert np.abs(total).max() == 0.0


SOLID_EDGE = 0.0125
THIN = 0.002


def press_on_an_edge(run, *, depth, at):
    """Lower a ball of 2 mm onto a clamped felt of 3 mm; returns the run and the ball's height."""
    builder = ModelBuilder()
    x = (np.arange(9) - 4) * SOLID_EDGE
    vertices = np.array([(a, b, 0.0) for a in x for b in x])
    faces = []
    for i in range(8):
        for j in range(8):
            a = 9 * i + j
            faces += [(a, a + 9, a + 1), (a + 1, a + 9, a + 10)]
    rim = np.flatnonzero(np.abs(vertices[:, :2]).max(axis=1) > x[-1] - 1e-6)
    builder.add_solid(
        vertices,
        np.array(faces),
        thickness=0.003,
        material=SolidMaterial(youngs_modulus=2e5, rest_offset=0.003, damping=0.01),
        pinned=tuple(rim),
    )
    body = builder.add_body("ball")
    builder.add_shape(Shape(kind="sphere", size=(THIN, 0.0, 0.0)), body=body)
    r = run(builder, gravity=(0.0, 0.0, 0.0))
    heights = np.linspace(0.005, THIN - depth, 40)
    for k, height in enumerate([*heights, *[heights[-1]] * 20]):
        r.move([[*at, height, 1, 0, 0, 0]], is_jump=k == 0)
        r.step()
    return r, float(heights[-1])


def test_a_thin_thing_does_not_pass_between_the_corners_of_a_solid(run):
    """At the middle of an edge, where no corner is within its reach."""
    middle = (SOLID_EDGE / 2, 0.0)
    reach = THIN + 0.003  # of a corner's contact
    assert reach < SOLID_EDGE / 2
    r, height = press_on_an_edge(run, depth=0.006, at=middle)
    ends = [9 * 4 + 4, 9 * 5 + 4]
    sunk = r.x[ends].mean(axis=0)
    assert np.abs(sunk[:2] - middle).max() < 1e-3
    gap = height - THIN - sunk[2]  # of the ball over the middle of the edge
    assert gap == pytest.approx(0.25 * 0.003, abs=4e-4)
    assert sunk[2] < -0.004  # it is the felt that gives way
    force = r.state.impulse.numpy()[0, 0, 2] * 60
    assert force > 0.05


def test_a_thin_thing_is_stopped_by_a_corner_of_a_solid_as_before(run):
    r, height = press_on_an_edge(run, depth=0.004, at=(0.0, 0.0))
    gap = height - THIN - r.x[9 * 4 + 4, 2]
    assert gap == pytest.approx(0.003, abs=4e-4)
