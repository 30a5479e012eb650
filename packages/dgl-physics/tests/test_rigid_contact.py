"""Cloth and rigid shapes: friction, adhesion, impulses, no tunnelling."""

import numpy as np
import pytest

from dgl_physics import ClothMaterial, ModelBuilder, Shape

G = 9.81
EDGE = 0.0125
REST = ClothMaterial().rest_offset


def slope_gravity(tangent):
    """Gravity as it is on a slope along +x of this tangent, seen from the slope."""
    angle = np.arctan(tangent)
    return (float(G * np.sin(angle)), 0.0, float(-G * np.cos(angle)))


def slide(run, sheet, *, friction, tangent, frames, device="cpu", shape_friction=1.0):
    """Displacement and velocity along a slope after some frames."""
    builder = ModelBuilder(1)
    material = ClothMaterial(friction=friction, adhesion=0.0, drag=0.0)
    vertices, faces = sheet(0.08, 0.08, EDGE, height=REST)
    builder.add_garment(vertices, faces, material=material)
    builder.add_ground(friction=shape_friction)
    r = run(builder, device=device, gravity=slope_gravity(tangent)).step(frames)
    return (r.x - vertices)[:, 0], r.v[:, 0]


@pytest.mark.parametrize("friction", [0.3, 1.0])
def test_cloth_sticks_below_the_friction_angle(run, sheet, device, friction):
    moved, _ = slide(
        run, sheet, friction=friction, tangent=0.8 * friction, frames=120, device=device
    )
    assert np.abs(moved).max() < 1e-5  # over 2 s: no creep


@pytest.mark.parametrize("friction", [0.3, 1.0])
def test_cloth_slides_above_the_friction_angle(run, sheet, device, friction):
    frames, tangent = 30, 1.2 * friction
    moved, speed = slide(
        run, sheet, friction=friction, tangent=tangent, frames=frames, device=device
    )
    angle = np.arctan(tangent)
    acceleration = G * (np.sin(angle) - friction * np.cos(angle))
    assert speed == pytest.approx(acceleration * frames / 60, rel=0.1)
    assert moved == pytest.approx(0.5 * acceleration * (frames / 60) ** 2, rel=0.1)


def test_without_friction_cloth_slides_freely(run, sheet):
    _, speed = slide(run, sheet, friction=0.0, tangent=0.1, frames=30)
    assert speed == pytest.approx(slope_gravity(0.1)[0] * 0.5, rel=0.01)


def test_a_shape_scales_the_friction(run, sheet):
    slips, _ = slide(run, sheet, friction=1.0, tangent=0.5, frames=30, shape_friction=0.4)
    sticks, _ = slide(run, sheet, friction=1.0, tangent=0.5, frames=30, shape_friction=0.6)
    assert slips.min() > 0.05
    assert np.abs(sticks).max() < 1e-5


def hold_under_ceiling(run, sheet, *, adhesion, device="cpu", **material):
    """Measure the fall of a patch from a ceiling in 1 s, from within its reach."""
    builder = ModelBuilder(1)
    material = {"adhesion_radius": 0.004, "adhesion": adhesion, "drag": 5.0} | material
    start = -REST - 0.5 * material["adhesion_radius"]
    vertices, faces = sheet(0.08, 0.08, EDGE, height=start)
    builder.add_garment(vertices, faces, material=ClothMaterial(**material))
    pose = np.array([0, 0, 0.1, 1, 0, 0, 0])
    builder.add_shape(Shape(kind="box", size=(0.5, 0.5, 0.1), pose=pose))
    r = run(builder, device=device).step(60)
    return -(r.x[:, 2] - start)


def weight_of_particle():
    """Weight of a particle inside the sheet [N]."""
    return ClothMaterial().area_density * EDGE**2 * np.sqrt(0.75) * G


def test_adhesion_holds_the_weight_that_its_spring_carries(run, sheet, device):
    """The spring holds if its largest force, k r, exceeds the weight."""
    critical = weight_of_particle() / 0.004
    held = hold_under_ceiling(run, sheet, adhesion=1.5 * critical, device=device)
    assert np.abs(held).max() < 0.003
    assert hold_under_ceiling(run, sheet, adhesion=0.7 * critical, device=device).min() > 1.0


def test_adhesion_is_a_spring(run, sheet):
    """At rest the gap is weight / k."""
    k = 2.0 * weight_of_particle() / 0.004
    # limp, as the lighter particles of the border would carry their neighbours otherwise
    fallen = hold_under_ceiling(run, sheet, adhesion=k, bending_stiffness=0.0)
    gap = 0.002 + np.median(fallen)
    assert gap == pytest.approx(weight_of_particle() / k, rel=0.05)


def test_without_adhesion_nothing_hangs(run, sheet):
    assert hold_under_ceiling(run, sheet, adhesion=0.0).min() > 1.0
    assert hold_under_ceiling(run, sheet, adhesion=100.0, adhesion_radius=0.0).min() > 1.0


def test_impulses_are_the_momentum_lost_by_the_cloth(run, sheet, builder, device):
    """Summed over a fall on a box: impulse on the box = weight x time + change of momentum."""
    vertices, faces = sheet(0.1, 0.1, EDGE, height=0.1)
    builder.add_garment(vertices, faces, material=ClothMaterial(drag=0.0))
    pose = np.array([0, 0, -0.05, 1, 0, 0, 0])
    box = builder.add_shape(Shape(kind="box", size=(0.2, 0.2, 0.05), pose=pose))
    r = run(builder, device=device)
    total = np.zeros(6)
    for _ in range(60):
        r.step()
        total += r.state.impulse.numpy()[0, box]
    lost = (r.mass[:, None] * (np.array([0, 0, -G]) * 1.0 - r.v)).sum(axis=0)
    assert r.v == pytest.approx(0, abs=0.01)  # it rests
    assert total[:3] == pytest.approx(lost, abs=0.02 * np.linalg.norm(lost))
    centre = (r.mass[:, None] * r.x).sum(axis=0) / r.mass.sum()
    moment = np.cross(centre * [1, 1, 0], lost)
    assert total[3:] == pytest.approx(moment, abs=0.02 * 0.1 * np.linalg.norm(lost))


def test_unmeasured_shapes_report_no_impulse(run, sheet, builder):
    builder.add_garment(*sheet(0.05, 0.05, EDGE, height=REST))
    builder.add_shape(Shape(kind="plane", is_measured=False))
    assert np.abs(run(builder).step(5).state.impulse.numpy()).max() == 0.0


@pytest.mark.parametrize("radius", [0.008, 0.03])
def test_a_fast_capsule_does_not_tunnel(run, sheet, builder, device, radius):
    """A finger at 1 m/s into a hanging sheet carries it along."""
    vertices, faces = sheet(0.3, 0.3, EDGE)
    vertices = vertices[:, [0, 2, 1]]
    top = np.flatnonzero(vertices[:, 2] > vertices[:, 2].max() - 1e-6)
    # little friction: a sheet that is pinned and sticks to the finger would have to stretch
    builder.add_garment(vertices, faces, pinned=tuple(top), material=ClothMaterial(friction=0.3))
    finger = builder.add_body("finger")
    lying = np.array([0, 0, 0, np.sqrt(0.5), 0, np.sqrt(0.5), 0])  # along x
    builder.add_shape(Shape(kind="capsule", size=(radius, 0.2, 0), pose=lying), body=finger)
    r = run(builder, device=device)
    depth = 0.0
    for k in range(11):
        y, z = -0.1 + k / 60, 0.0
        r.move([[0, y, z, 1, 0, 0, 0]], is_jump=k == 0)
        r.step()
        distance = np.hypot(r.x[:, 1] - y, r.x[:, 2] - z) - radius - REST
        depth = max(depth, -distance.min())
        if y > -radius:
            # in front of the axis: what hangs below the finger may trail behind it
            near = np.abs(r.x[:, 2] - z) < 0.008
            assert near.any()
            assert (r.x[near, 1] > y).all()
    assert depth < 1e-4


@pytest.mark.parametrize(
    ("shape", "distance"),
    [
        (Shape(kind="sphere", size=(0.08, 0, 0)), lambda x: np.linalg.norm(x, axis=1) - 0.08),
        (
            Shape(kind="capsule", size=(0.05, 0.1, 0)),
            lambda x: np.linalg.norm(x - np.clip(x[:, 2:], -0.1, 0.1) * [0, 0, 1], axis=1) - 0.05,
        ),
        (
            Shape(kind="box", size=(0.05, 0.06, 0.07)),
            lambda x: np.linalg.norm(np.maximum(np.abs(x) - [0.05, 0.06, 0.07], 0), axis=1),
        ),
    ],
    ids=["sphere", "capsule", "box"],
)
def test_draped_cloth_does_not_penetrate(run, sheet, builder, shape, distance):
    builder.add_garment(*sheet(0.3, 0.3, EDGE, height=0.16))
    builder.add_shape(shape)
    r = run(builder)
    worst = min(distance(r.step(3).x).min() for _ in range(15))
    assert worst > REST - 1e-4


def test_a_moving_surface_carries_the_cloth_on_it(run, sheet, builder):
    """A tray accelerates and turns: cloth on it keeps its place on the tray.

    Bodies have a constant velocity within a frame. The step of velocity between two frames must
    be within what friction gives in one substep, here 0.014 m/s, for no slip at all.
    """
    vertices, faces = sheet(0.1, 0.1, EDGE, height=REST)
    builder.add_garment(vertices, faces, material=ClothMaterial(adhesion=0.0))
    tray = builder.add_body("tray")
    pose = np.array([0, 0, -0.01, 1, 0, 0, 0])
    builder.add_shape(Shape(kind="box", size=(0.2, 0.2, 0.01), pose=pose), body=tray)
    r = run(builder)
    for k in range(61):
        t = k / 60
        x, yaw = 0.5 * 0.6 * t**2, 0.5 * 1.0 * t**2
        r.move([[x, 0, 0, np.cos(yaw / 2), 0, 0, np.sin(yaw / 2)]], is_jump=k == 0)
        r.step()
    turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    expected = vertices[:, :2] @ turn.T + [x, 0]
    assert np.abs(r.x[:, :2] - expected).max() < 1e-3
