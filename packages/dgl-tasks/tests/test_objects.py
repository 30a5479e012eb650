"""Props in scenes: where they are drawn, what cloth feels of them, what the cameras see of them."""

import dataclasses

import gymnasium
import numpy as np
import pytest

import dgl_tasks
from dgl_assets.materials import sample_floor_material
from dgl_assets.props import PROP_KINDS, PlatformParameters
from dgl_physics.sapien_bridge import convert_shape
from dgl_tasks.declaration import PropPlacement
from dgl_tasks.perception import CLOUD_SIZE, get_object_cloud, take_picture
from dgl_tasks.scene import MAT, FloorLook, paint_floor, sample_floor_look

GARMENT = "Tops_LongSleeve/001294"
FOLD = dgl_tasks.get_task("FoldTops-v1")
HEIGHT = 0.15
WITH_TABLE = dataclasses.replace(
    FOLD,
    x_range=(0.0, 0.0),
    y_range=(0.8, 0.8),
    settle_frames=25,
    props=(
        # the garment's middle comes to lie on it
        PropPlacement(
            name="block",
            prop=PlatformParameters(height=HEIGHT),
            position=(0.0, 0.8, 0.0),
            x_range=(-0.02, 0.02),
            friction=0.8,
            is_solid_to_robot=False,
        ),
        PropPlacement(name="bar", prop="hanger", position=(0.0, 1.5, 0.0), y_range=(-0.05, 0.05)),
        # all kinds of shapes, out of reach
        PropPlacement(name="stand", prop="hat_stand", position=(3.0, 3.0, 0.0)),
        PropPlacement(name="coat_hanger", prop="coat_hanger", position=(3.0, 4.0, 0.0)),
    ),
)


@pytest.fixture(scope="module")
def env():
    made = gymnasium.make(
        "FoldTops-v1",
        task=WITH_TABLE,
        obs_mode="none",
        sim_backend="physx_cpu",
        render_backend="none",
    )
    made.reset(seed=3, options={"garment": GARMENT})
    yield made.unwrapped
    made.close()


def test_props_stand_where_they_were_drawn(env):
    block, bar = env.props["block"], env.props["bar"]
    assert block.pose[:3] == pytest.approx([env.draws["block_x"], 0.8, 0.0], abs=1e-6)
    assert -0.02 <= env.draws["block_x"] <= 0.02
    assert env.draws["block_x"] != 0.0
    assert env.draws["block_y"] == 0.8
    assert bar.get_landmarks()["target"] == pytest.approx([0.0, env.draws["bar_y"], 0.8], abs=1e-6)


def test_cloth_lies_on_a_prop_and_hangs_over_its_edges(env):
    for _ in range(20):
        env.cloth.step()
    particles = env.get_particles()
    x, y = particles[:, 0] - env.draws["block_x"], particles[:, 1] - 0.8
    inside = (np.abs(x) < 0.2) & (np.abs(y) < 0.2)
    assert inside.sum() > 200
    assert particles[inside, 2].min() > HEIGHT - 0.002
    outside = (np.abs(x) > 0.3) | (np.abs(y) > 0.3)
    assert np.quantile(particles[outside, 2], 0.2) < HEIGHT - 0.03
    assert env.props["block"].prop.compute_distance(
        particles - env.props["block"].pose[:3]
    ).min() > -0.004  # fmt: skip


def test_each_prop_has_its_friction(env):
    factors = {b.entity.name: env._get_friction(b) for b in env.cloth.bodies[0]}
    by_name = {env.props[name].entity_name: name for name in env.props}
    assert {by_name[n]: f for n, f in factors.items() if n in by_name} == {
        "block": 0.8,
        "bar": 0.5,
        "stand": 0.5,
        "coat_hanger": 0.5,
    }
    (ground,) = (f for n, f in factors.items() if n.endswith("ground"))
    assert ground == FOLD.ground_friction


def test_states_hold_where_props_are(env):
    before = env.props["bar"].pose
    state = env.get_state_dict()
    env.props["bar"].place((0.4, 1.7, 0.1), yaw=0.5)
    assert env.props["bar"].get_landmarks()["target"] == pytest.approx([0.4, 1.7, 0.9], abs=1e-6)
    env.set_state_dict(state)
    np.testing.assert_allclose(env.props["bar"].pose, before, atol=1e-6)


def test_placing_a_prop_moves_no_draw_of_the_garment(env):
    """The garment and its place are those of the task without props."""
    plain = gymnasium.make(
        "FoldTops-v1",
        task=dataclasses.replace(WITH_TABLE, props=(), settle_frames=2),
        obs_mode="none",
        render_backend="none",
    ).unwrapped
    plain.reset(seed=9)
    env.reset(seed=9)
    assert {key: env.draws[key] for key in plain.draws} == plain.draws
    assert set(env.draws) - set(plain.draws) == {
        f"{name}_{axis}" for name in env.props for axis in "xy"
    }
    plain.close()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"x_range": (0.1, -0.1)}, r"x_range must be \(low, high\)"),
        ({"friction": -1.0}, "friction must be >= 0; got -1.0"),
    ],
)
def test_placements_that_make_no_sense_are_refused(change, message):
    with pytest.raises(ValueError, match=message):
        PropPlacement(name="a", prop="hanger", position=(0, 0, 0), **change)


def test_two_props_of_one_name_are_refused():
    one = PropPlacement(name="a", prop="hanger", position=(0, 0, 0))
    with pytest.raises(ValueError, match="props must have different names"):
        dataclasses.replace(FOLD, props=(one, one))


def test_an_unknown_look_is_refused():
    with pytest.raises(ValueError, match=r"look must be one of \['studio', 'random'\]; got 'pop'"):
        gymnasium.make("FoldTops-v1", look="pop", render_backend="none")


def test_a_floor_shows_its_material_and_the_mat_where_there_is_one():
    material = sample_floor_material(1, kinds=["tiles"])
    plain = FloorLook(material=material, mat=None)
    image = paint_floor(6.0, 512, mat_centre=(0, 0.8), look=plain)
    maps = material.render(256)
    near = image[200:312, 200:312].reshape(-1, 3) / 255.0
    np.testing.assert_allclose((near**2.2).mean(axis=0), maps.mean_colour, rtol=0.08)
    assert near.std(axis=0).max() > 0.01, "grout and tiles"
    matted = paint_floor(6.0, 512, mat_centre=(0, 0.8), look=dataclasses.replace(plain, mat=MAT))
    np.testing.assert_allclose((matted[256, 256] / 255.0) ** 2.2, MAT, atol=0.01)
    # far from the mat, and where its detailed middle meets the rest, both are the same
    far = paint_floor(60.0, 256, mat_centre=(0, 0.8), look=plain)
    np.testing.assert_array_equal(image[5, 5], matted[5, 5])
    row = round((2.95 / 60 + 0.5) * 256)
    np.testing.assert_allclose(image[-5, 256].astype(int), far[row, 128].astype(int), atol=8)


def test_floor_looks_follow_from_their_seed():
    looks = [sample_floor_look([seed, 8]) for seed in range(30)]
    assert looks[3] == sample_floor_look([3, 8])
    assert len({look.material.name for look in looks}) > 10
    assert 5 < sum(look.mat is None for look in looks) < 25


def test_bodies_have_the_shapes_of_the_props(env):
    """Distances to SAPIEN's shapes, as cloth is given them, are those to the prop's own."""
    bodies = {b.entity.name: b for b in env.cloth.bodies[0]}
    for name in ("stand", "coat_hanger", "block"):
        prop = env.props[name]
        shapes = [convert_shape(s) for s in bodies[prop.entity_name].collision_shapes]
        assert len(shapes) == len(prop.prop.shapes)
        for shape, own in zip(shapes, prop.prop.shapes, strict=True):
            assert shape.kind == own.kind
            if shape.kind == "convex":
                assert shape.mesh is not None
                continue
            expected = own.half_size if own.kind == "box" else (own.radius, own.half_length, 0.0)
            np.testing.assert_allclose(shape.size, expected, atol=1e-6)
            np.testing.assert_allclose(shape.pose[:3], own.xyz, atol=1e-6)
            # the local z axis, which a capsule or cylinder lies along
            np.testing.assert_allclose(
                np.abs(turn_z(shape.pose[3:]) @ turn_z(own.wxyz)), 1.0, atol=1e-6
            )


def turn_z(q):
    w, x, y, z = q
    return np.array([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)])


@pytest.mark.slow
@pytest.mark.render
def test_cameras_see_props_and_random_looks_judge_alike():
    """All kinds of props, their clouds, and a look that changes pictures and nothing else."""
    spots = ((0.0, 1.55), (-1.1, 1.0), (-0.75, 1.35), (0.7, 1.5), (1.15, 1.0), (-0.75, 1.8))
    placed = tuple(
        PropPlacement(name=kind, prop=kind, position=(x, y, 0.0))
        for kind, (x, y) in zip(PROP_KINDS, spots, strict=True)
    )
    env = gymnasium.make(
        "FoldTops-v1",
        task=dataclasses.replace(FOLD, settle_frames=2, props=placed),
        look="random",
        obs_mode="none",
        sim_backend="physx_cpu",
        render_backend="cpu",
    ).unwrapped
    seen = {}
    for look, seed in (("studio", 2), ("random", 2), ("random", 4)):
        env._look = look  # as a second environment would have it, which takes longer to make
        env.reset(seed=seed, options={"garment": GARMENT})
        picture = take_picture(env, "environment_camera")
        ids = [env.garment_segment, *(prop.segment for prop in env.props.values())]
        masks = np.array([picture.segments == k for k in ids])
        seen[look, seed] = (picture, masks, env.judge_visible_surface(), dict(env.draws))
        if look == "studio":
            check_clouds(env, picture)
    env.close()
    (plain, masks, verdict, draws), (random, equal, same, others), (third, *_) = seen.values()
    assert (third.rgb != random.rgb).mean() > 0.5, "the floor is drawn anew"
    assert (plain.rgb != random.rgb).mean() > 0.5
    assert masks.any(axis=(1, 2)).sum() >= 6
    np.testing.assert_array_equal(masks, equal)
    np.testing.assert_array_equal(plain.points, random.points)
    assert verdict == same
    assert {k: v for k, v in others.items() if k not in ("floor", "fabric")} == {
        k: v for k, v in draws.items() if k != "fabric"
    }
    assert others["floor"]


def check_clouds(env, picture):
    for name in ("hanger", "hat_stand", "platform", "coat_hanger", "pothook"):
        cloud = get_object_cloud(env, picture, seed=0, names=[name])
        assert cloud.shape == (CLOUD_SIZE, 3)
        prop = env.props[name]
        points = np.concatenate([part.vertices for part in prop.prop.parts]) + prop.pose[:3]
        assert (cloud > points.min(axis=0) - 0.01).all()
        assert (cloud < points.max(axis=0) + 0.01).all()
    assert len(np.unique(picture.segments[np.isin(
        picture.segments, [p.segment for p in env.props.values()])])) >= 5  # fmt: skip
    assert env.garment_segment not in {p.segment for p in env.props.values()}
    cloud = get_object_cloud(env, picture, seed=0, names=["platform"])
    top = cloud[cloud[:, 2] > 0.045]
    assert len(top) > 0.8 * CLOUD_SIZE
    assert np.quantile(np.abs(top[:, 2] - 0.05), 0.95) < 0.004
    with pytest.raises(ValueError, match=r"names must be some of .*got \['sofa'\]"):
        get_object_cloud(env, picture, seed=0, names=["sofa"])
