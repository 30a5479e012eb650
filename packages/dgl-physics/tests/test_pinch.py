"""A pinch lifts cloth by friction alone, and one finger lifts nothing."""

import numpy as np
import pytest

from dgl_physics import ClothMaterial, ModelBuilder, Shape

EDGE = 0.0125
HALF = 0.01  # half of a finger's thickness [m]
LYING = np.array([0, 0, 0, np.sqrt(0.5), 0, np.sqrt(0.5), 0])  # axis along x
SHAPES = {
    "boxes": Shape(kind="box", size=(0.02, HALF, 0.02)),
    "capsules": Shape(kind="capsule", size=(HALF, 0.015, 0), pose=LYING),
}


def pinch(
    run,
    sheet,
    *,
    shape,
    device="cpu",
    width=0.1,
    length=0.15,
    squeeze=0.002,
    frames=120,
    **material,
):
    """Close two fingers on a hanging two-layer sheet, lift it by 0.3 m at 0.6 m/s, and hold it.

    Returns:
        The run, the indices of the particles between the fingers, and where these were relative
        to the fingers after the lift and in each frame of the hold, shape (frames + 1, N, 3).
    """
    material = ClothMaterial(**material)
    builder = ModelBuilder(1)
    vertices, faces = sheet(width, length, EDGE)
    vertices = vertices[:, [0, 2, 1]]
    vertices[:, 2] += 0.03 - vertices[:, 2].max()  # the fingers close 3 cm below its top
    for side in (-0.5, 0.5):
        layer = np.add(vertices, [0, side * material.thickness, 0])
        builder.add_garment(layer, faces, material=material)
    for name in ("left", "right"):
        builder.add_shape(shape, body=builder.add_body(name))
    r = run(builder, device=device)
    closed = 0.5 * material.thickness + material.rest_offset + HALF - squeeze
    r.state.set_gravity_scale(0.0)  # until the fingers have closed

    def move(lift, opening, *, is_jump=False):
        poses = [[0, s * (closed + opening), lift, 1, 0, 0, 0] for s in (-1, 1)]
        r.move(poses, is_jump=is_jump)
        r.step()

    for k in range(11):
        move(0.0, 0.01 * (1 - k / 10), is_jump=k == 0)
    r.state.set_gravity_scale(1.0)
    inner = np.flatnonzero((np.abs(r.x[:, 0]) < 0.02) & (np.abs(r.x[:, 2]) < 0.007))
    for k in range(30):
        move(0.3 * (k + 1) / 30, 0.0)
    path = [r.x[inner]]
    for _ in range(frames):
        move(0.3, 0.0)
        path.append(r.x[inner])
    return r, inner, np.array(path) - [0, 0, 0.3]


def check_hold(run, sheet, **options):
    r, inner, path = pinch(run, sheet, **options)
    assert len(inner) >= 4
    creep = np.linalg.norm(path[-1] - path[0], axis=1)
    assert creep.max() < 0.002
    assert np.abs(path[-1, :, 2]).max() < 0.02  # the same particles are still between the fingers
    assert np.abs(r.v).max() < 0.1


@pytest.mark.parametrize("name", SHAPES)
def test_friction_lifts_and_holds(run, sheet, device, name):
    """6 g on six particles, with the friction of the original, which stands for not slipping."""
    check_hold(run, sheet, shape=SHAPES[name], device=device, friction=25.0)


@pytest.mark.parametrize("name", ["boxes", "capsules"])
def test_a_real_friction_lifts_and_holds(run, sheet, name):
    check_hold(run, sheet, shape=SHAPES[name], friction=1.0)


@pytest.mark.parametrize("name", SHAPES)
def test_without_friction_and_adhesion_it_falls(run, sheet, name):
    r, _, _ = pinch(run, sheet, shape=SHAPES[name], friction=0.0, adhesion=0.0)
    assert r.x[:, 2].max() < -1.0


@pytest.mark.parametrize("name", SHAPES)
def test_one_finger_lifts_nothing(run, sheet, builder, name):
    """A finger presses on a sheet on the ground and goes up, at the default material."""
    vertices, faces = sheet(0.2, 0.2, EDGE, height=0.004)
    builder.add_garment(vertices, faces)
    builder.add_ground()
    builder.add_shape(SHAPES[name], body=builder.add_body("finger"))
    r = run(builder)
    low = 0.004 + 0.004 + (0.02 if name == "boxes" else HALF) - 0.002
    for k in range(41):
        z = low + 0.05 * max(0, 10 - k) / 10 + 0.3 * max(0, k - 20) / 20
        r.move([[0, 0, z, 1, 0, 0, 0]], is_jump=k == 0)
        r.step()
    assert np.abs(r.x - vertices).max() < 0.003


@pytest.mark.parametrize(("lift", "holds"), [(0.02, True), (0.1, False)])
def test_cloth_pulled_beyond_three_times_its_length_slips(run, sheet, lift, holds):
    """Lift a strip, fixed 7 cm below, with two fingers of the original's friction."""
    material = ClothMaterial(friction=25.0)
    builder = ModelBuilder(1)
    vertices, faces = sheet(0.05, 0.09, EDGE)
    vertices = vertices[:, [0, 2, 1]]
    vertices[:, 2] += 0.02 - vertices[:, 2].max()
    foot = np.flatnonzero(vertices[:, 2] < vertices[:, 2].min() + 1e-6)
    for side in (-0.5, 0.5):
        layer = np.add(vertices, [0, side * material.thickness, 0])
        builder.add_garment(layer, faces, material=material, pinned=foot)
    for name in ("left", "right"):
        builder.add_shape(SHAPES["boxes"], body=builder.add_body(name))
    r = run(builder)
    closed = 0.5 * material.thickness + material.rest_offset + HALF - 0.002
    for k in range(11):
        gap = closed + 0.01 * (1 - k / 10)
        r.move([[0, s * gap, 0, 1, 0, 0, 0] for s in (-1, 1)], is_jump=k == 0)
        r.step()
    inner = np.flatnonzero((np.abs(r.x[:, 0]) < 0.02) & (np.abs(r.x[:, 2]) < 0.007))
    held = r.x[inner]
    assert len(inner) >= 4
    rise = np.linspace(0, lift, max(round(120 * lift), 1) + 1)[1:]  # 0.5 m/s
    for z in [*rise, *[lift] * 60]:
        r.move([[0, s * closed, z, 1, 0, 0, 0] for s in (-1, 1)])
        r.step()
    slip = np.linalg.norm(r.x[inner] - held - [0, 0, lift], axis=1)
    if holds:
        assert slip.max() < 0.005
    else:
        assert slip.min() > lift  # it has gone back
