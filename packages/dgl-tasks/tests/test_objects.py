"""Objects in scenes: random poses, contact with cloth, and clouds."""

import dataclasses

import gymnasium
import numpy as np
import pytest
from sapien.physx import PhysxArticulationLinkComponent

import dgl_tasks
from dgl_assets.materials import sample_floor_material
from dgl_assets.props import PROP_KINDS, PlatformParameters, TableParameters
from dgl_assets.robots import SIDES
from dgl_physics.sapien_bridge import convert_shape
from dgl_tasks.declaration import HandFriction, SceneObject, Start
from dgl_tasks.objects import compute_frames
from dgl_tasks.perception import CLOUD_SIZE, get_object_cloud
from dgl_tasks.scene_check import check_scene
from dgl_tasks.studio import MAT, FloorLook, paint_floor, sample_floor_look

GARMENT = "Tops_LongSleeve/001294"
FOLD = dgl_tasks.get_task("FoldTops-v1")
HARDLY_SETTLED = dataclasses.replace(FOLD.start, settle_frames=2)
HEIGHT = 0.15
WITH_TABLE = dataclasses.replace(
    FOLD,
    start=Start(y_range=(0.8, 0.8), settle_frames=25),
    hand_friction=HandFriction(fingers=2.0, thumb=0.6),
    objects=(
        # the garment's middle comes to lie on it
        SceneObject(
            name="block",
            prop=PlatformParameters(height=HEIGHT),
            position=(0.0, 0.8, 0.0),
            x_range=(-0.02, 0.02),
            friction=0.8,
            solid_to="hands",
        ),
        SceneObject(name="bar", prop="hanger", position=(0.0, 1.3, 0.0), y_range=(-0.05, 0.04)),
        # all kinds of shapes, behind the robots
        SceneObject(name="stand", prop="hat_stand", position=(1.9, -0.6, 0.0), avoided=True),
        SceneObject(name="coat_hanger", prop="coat_hanger", position=(-1.9, -0.6, 0.0)),
        SceneObject(
            name="table",
            prop=tuple(TableParameters(height=0.5 + 0.01 * k) for k in range(5)),
            position=(0.0, -1.2, 0.0),
            yaw=0.2,
            yaw_range=(-0.1, 0.1),
        ),
    ),
)


@pytest.fixture(scope="module")
def env(coarse_garments):
    made = gymnasium.make(
        "FoldTops-v1",
        task=WITH_TABLE,
        reconfiguration_freq=0,
        obs_mode="none",
        sim_backend="physx_cpu",
        render_backend="none",
    )
    made.reset(seed=3, options={"garment": GARMENT})
    yield made.unwrapped
    made.close()


def test_objects_stand_where_they_were_drawn(env):
    block, bar = env.objects["block"], env.objects["bar"]
    assert block.pose[:3] == pytest.approx([env.draws["block_x"], 0.8, 0.0], abs=1e-6)
    assert -0.02 <= env.draws["block_x"] <= 0.02
    assert env.draws["block_x"] != 0.0
    assert env.draws["block_y"] == 0.8
    assert bar.get_frames()["target"] == pytest.approx([0.0, env.draws["bar_y"], 0.8], abs=1e-6)


def test_an_object_is_one_of_several_props_and_turned(env):
    number, yaw = env.draws["table_prop"], env.draws["table_yaw"]
    table = env.objects["table"]
    assert table.prop.landmarks["target"][2] == pytest.approx(0.5 + 0.01 * number)
    assert 2 * np.arctan2(table.pose[6], table.pose[3]) == pytest.approx(yaw, abs=1e-6)
    assert 0.1 <= yaw <= 0.3
    assert "block_prop" not in env.draws
    computed = compute_frames(WITH_TABLE, env.draws)
    for name, frames in env.get_frames().items():
        for place, position in frames.items():
            assert computed[name][place] == pytest.approx(position, abs=1e-6)
    for wrong in ({"table_prop": 5}, {"table_prop": "1"}, {"table_yaw": None}):
        with pytest.raises(ValueError, match="turn of table and which of its 5 props"):
            compute_frames(WITH_TABLE, env.draws | wrong)


def test_cloth_lies_on_an_object_and_hangs_over_its_edges(env):
    for _ in range(20):
        env.cloth.step()
    particles = env.get_particles()
    x, y = particles[:, 0] - env.draws["block_x"], particles[:, 1] - 0.8
    inside = (np.abs(x) < 0.2) & (np.abs(y) < 0.2)
    assert inside.sum() > 50
    assert particles[inside, 2].min() > HEIGHT - 0.002
    outside = (np.abs(x) > 0.3) | (np.abs(y) > 0.3)
    assert np.quantile(particles[outside, 2], 0.2) < HEIGHT - 0.03
    assert env.objects["block"].prop.compute_distance(
        particles - env.objects["block"].pose[:3]
    ).min() > -0.004  # fmt: skip


def test_each_object_has_its_friction(env):
    factors = {b.entity.name: env._get_friction(b) for b in env.cloth.bodies[0]}
    by_name = {env.objects[name].entity.name: name for name in env.objects}
    assert {by_name[n]: f for n, f in factors.items() if n in by_name} == {
        "block": 0.8,
        "bar": 0.5,
        "stand": 0.5,
        "coat_hanger": 0.5,
        "table": 0.5,
    }
    (ground,) = (f for n, f in factors.items() if n.endswith("ground"))
    assert ground == FOLD.ground_friction


def test_each_part_of_the_hands_has_its_friction(env):
    links = [b for b in env.cloth.bodies[0] if isinstance(b, PhysxArticulationLinkComponent)]
    names = {link._objs[0].name: name for name, link in env.agent.robot.links_map.items()}
    factors = {names[link.name]: env._get_friction(link) for link in links}
    thumbs = {f"{side}_{name}" for side in SIDES for name in env.agent.model.hand.thumb_links}
    assert thumbs & set(factors)
    assert {factors[name] for name in thumbs & set(factors)} == {0.6}
    assert {factors[name] for name in set(factors) - thumbs} == {2.0}


def test_the_force_on_an_object_to_be_avoided_is_measured(env):
    state = env.get_state_dict()
    env.advance(None)
    assert env.measure_touch() == {"stand": 0.0}  # what may be touched is not told
    x, y, z = env.agent.robot.links_map["left_forearm_link"].pose.p[0].tolist()
    stand = env.objects["stand"]
    stand.place((x, y, z - stand.prop.landmarks["target"][2]))
    env.advance(None)
    assert env.measure_touch()["stand"] > 1.0
    env.set_state_dict(state)
    env.advance(None)
    assert env.measure_touch() == {"stand": 0.0}


def test_states_hold_where_objects_are(env):
    before = env.objects["bar"].pose
    state = env.get_state_dict()
    env.objects["bar"].place((0.4, 1.7, 0.1), yaw=0.5)
    assert env.objects["bar"].get_frames()["target"] == pytest.approx([0.4, 1.7, 0.9], abs=1e-6)
    env.set_state_dict(state)
    np.testing.assert_allclose(env.objects["bar"].pose, before, atol=1e-6)


def test_placing_an_object_moves_no_draw_of_the_garment(env, monkeypatch):
    """The garment and its place are those of the task without objects."""
    start = dataclasses.replace(WITH_TABLE.start, settle_frames=2)
    monkeypatch.setattr(env, "_task", dataclasses.replace(WITH_TABLE, start=start))
    plain = gymnasium.make(
        "FoldTops-v1",
        task=dataclasses.replace(WITH_TABLE, objects=(), start=start),
        obs_mode="none",
        render_backend="none",
        reconfiguration_freq=0,
    ).unwrapped
    for made in (plain, env):
        made.reset(seed=9)
    assert {key: env.draws[key] for key in plain.draws} == plain.draws
    assert set(env.draws) - set(plain.draws) == {
        *(f"{name}_{axis}" for name in env.objects for axis in "xy"),
        *("table_yaw", "table_prop"),
    }
    plain.close()


def test_two_objects_of_one_name_are_refused():
    one, other = (SceneObject(name=n, prop="hanger", position=(0, 0, 0)) for n in "ab")
    assert dataclasses.replace(FOLD, objects=(one, other)).objects == (one, other)
    with pytest.raises(ValueError, match=r"different names; got \['a', 'b', 'a'\]"):
        dataclasses.replace(FOLD, objects=(one, other, one))


def place_bars(*places, start=FOLD.start, **changes):
    bars = (
        SceneObject(**{"name": f"bar{k}", "prop": "hanger", "position": (*place, 0.0)} | changes)
        for k, place in enumerate(places)
    )
    return dataclasses.replace(FOLD, objects=tuple(bars), start=start)


@pytest.mark.parametrize(
    ("task", "message"),
    [
        (place_bars((0, 0.9), (0.3, 0.9)), "objects 'bar0' and 'bar1' overlap, or may"),
        (place_bars((0, 0.9), (0, 0.99), y_range=(0.0, 0.1)), "'bar0' and 'bar1' overlap"),
        (place_bars((0, 0.9), (0.03, 1.2), yaw=1.5), "'bar0' and 'bar1' overlap"),
        (place_bars((0, 0.9), (0.03, 1.2), yaw_range=(0, 1.5)), "'bar0' and 'bar1' overlap"),
        (place_bars((0, 0.9), prop=("hanger", "pothook")), "'bar0': its props must have landmarks"),
        (place_bars((0.8, 0.0)), r"object 'bar0' stands in the base of the right .*\(0.8, 0\)"),
        (place_bars((-0.6, -0.4), y_range=(0, 0.4)), "base of the left robot .* or may where"),
        (place_bars((0, 1.6)), r"the target of object 'bar0' must be within 1.6 m .*1.81 m away"),
        (place_bars((0, 1.3), y_range=(0.0, 0.3)), "'bar0' must be within 1.6 m"),
        (
            place_bars((0, 0.9), start=dataclasses.replace(FOLD.start, on="stand.top")),
            r"'stand.top': there is no object 'stand'; there are \['bar0'\]",
        ),
        (
            place_bars((0, 0.9), start=dataclasses.replace(FOLD.start, on="bar0.seat")),
            r"'bar0.seat': bar0 has no frame 'seat'; it has \['left_end', 'right_end', ",
        ),
    ],
)
def test_scenes_that_cannot_be_worked_in_are_refused(task, message):
    with pytest.raises(ValueError, match=f"task FoldTops-v1: .*{message}"):
        check_scene(task)


def test_scenes_that_can_be_worked_in_are_accepted():
    check_scene(WITH_TABLE)
    check_scene(place_bars((0, 0.9), (0, 1.1), y_range=(-0.05, 0.05)))
    check_scene(place_bars((0, 0.9), (0.03, 1.2)))
    check_scene(place_bars((0, 0.9), start=dataclasses.replace(FOLD.start, on="bar0.top")))


def test_an_unknown_look_is_refused():
    with pytest.raises(ValueError, match="look should be 'studio' or 'random'; got 'pop'"):
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


def test_bodies_have_the_shapes_of_the_objects(env):
    """Distances to SAPIEN's shapes, as cloth is given them, are those to the object's own."""
    bodies = {b.entity.name: b for b in env.cloth.bodies[0]}
    for name in ("stand", "coat_hanger", "block"):
        item = env.objects[name]
        shapes = [convert_shape(s) for s in bodies[item.entity.name].collision_shapes]
        assert len(shapes) == len(item.prop.shapes)
        for shape, own in zip(shapes, item.prop.shapes, strict=True):
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
def test_cameras_see_objects_and_random_looks_judge_alike():
    """All kinds of objects, their clouds, and a look that changes pictures and nothing else."""
    spots = {
        "hanger": (0.0, 1.3),
        "coat_hanger": (-1.1, 1.0),
        "pothook": (-0.75, 1.35),
        "platform": (0.7, 1.5),
        "hat_stand": (1.15, 1.0),
        "glove_stand": (1.2, 1.45),
        "table": (-0.75, 1.5),
        "person": (1.6, 0.7),
    }
    assert set(spots) == set(PROP_KINDS)
    placed = tuple(
        SceneObject(name=kind, prop=kind, position=(x, y, 0.0)) for kind, (x, y) in spots.items()
    )
    env = gymnasium.make(
        "FoldTops-v1",
        task=dataclasses.replace(FOLD, start=HARDLY_SETTLED, objects=placed),
        look="random",
        obs_mode="none",
        sim_backend="physx_cpu",
        render_backend="cpu",
    ).unwrapped
    seen = {}
    for look, seed in (("studio", 2), ("random", 2), ("random", 4)):
        env._look = look  # as a second environment would have it, which takes longer to make
        env.reset(seed=seed, options={"garment": GARMENT})
        picture = env.take_picture("environment_camera")
        ids = [env.segments.garment, *env.segments.objects.values()]
        masks = np.array([picture.segments == k for k in ids])
        seen[look, seed] = (picture, masks, env.apply_rule(), dict(env.draws))
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


def see_object(env, picture, name):
    alone = dataclasses.replace(env.segments, objects={name: env.segments.objects[name]})
    return get_object_cloud(picture, alone, seed=0)


def check_clouds(env, picture):
    for name in ("hanger", "hat_stand", "platform", "coat_hanger", "pothook"):
        cloud = see_object(env, picture, name)
        assert cloud.shape == (CLOUD_SIZE, 3)
        item = env.objects[name]
        points = np.concatenate([part.vertices for part in item.prop.parts]) + item.pose[:3]
        assert (cloud > points.min(axis=0) - 0.01).all()
        assert (cloud < points.max(axis=0) + 0.01).all()
    segments = [item.entity.per_scene_id for item in env.objects.values()]
    assert len(np.unique(picture.segments[np.isin(picture.segments, segments)])) >= 5
    assert env.segments.garment not in segments
    cloud = see_object(env, picture, "platform")
    top = cloud[cloud[:, 2] > 0.045]
    assert len(top) > 0.8 * CLOUD_SIZE
    assert np.quantile(np.abs(top[:, 2] - 0.05), 0.95) < 0.004
