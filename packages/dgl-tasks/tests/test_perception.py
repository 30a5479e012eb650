"""Pictures and clouds against the simulation's own particles."""

import pickle
from dataclasses import replace

import gymnasium
import numpy as np
import pytest
from mani_skill.envs.sapien_env import BaseEnv
from scipy.spatial import cKDTree

import dgl_tasks
from dgl_assets.robots import SIDES
from dgl_tasks.driver import Driver
from dgl_tasks.errors import PerceptionError
from dgl_tasks.grasps import wrist_to_grasp
from dgl_tasks.perception import (
    CLOUD_SIZE,
    Picture,
    get_environment_cloud,
    get_garment_cloud,
    get_garment_points,
)
from dgl_tasks.sensing import SENSOR_CAMERAS

pytestmark = pytest.mark.render


@pytest.fixture(scope="module")
def env():
    """One environment at rest: the garment has settled, the arms are at home, beside it."""
    made = gymnasium.make(
        "FoldTops-v1",
        obs_mode="none",
        reward_mode="none",
        sim_backend="physx_cpu",
        render_backend="cpu",
        render_mode="rgb_array",
        reconfiguration_freq=0,
    ).unwrapped
    made.reset(seed=0)
    yield made
    made.close()


@pytest.fixture(scope="module")
def from_above(env):
    return env.take_picture("garment_camera")


@pytest.fixture(scope="module")
def from_afar(env):
    return env.take_picture("environment_camera")


def test_the_garment_cloud_lies_on_the_particles(env, from_above):
    cloud = get_garment_cloud(from_above, env.segments, seed=1)
    assert cloud.shape == (CLOUD_SIZE, 3)
    assert cloud.dtype == np.float32
    particles = env.get_particles()
    assert cKDTree(particles).query(cloud)[0].max() < 0.015
    # and nothing of the garment is missing: it lies open to the camera
    assert cKDTree(cloud[:, :2]).query(particles[:, :2])[0].max() < 0.03


def test_clouds_depend_on_their_seed_alone(env, from_above, from_afar):
    ids = env.segments
    for sample, arguments in (
        (get_garment_cloud, (from_above, ids)),
        (get_environment_cloud, (from_afar, ids, env.task.workspace)),
    ):
        first, again, other = (sample(*arguments, seed=s) for s in (1, 1, 2))
        np.testing.assert_array_equal(first, again)
        assert not np.array_equal(first, other)


def test_two_pictures_of_one_state_are_equal(env, from_above):
    again = env.take_picture("garment_camera")
    np.testing.assert_array_equal(again.rgb, from_above.rgb)
    np.testing.assert_array_equal(again.points, from_above.points)
    np.testing.assert_array_equal(again.segments, from_above.segments)


def test_the_environment_cloud_has_colours_and_lies_in_the_workspace(env, from_afar):
    cloud = get_environment_cloud(from_afar, env.segments, env.task.workspace, seed=1)
    assert cloud.shape == (CLOUD_SIZE, 6)
    assert cloud.dtype == np.float32
    xyz, rgb = cloud[:, :3], cloud[:, 3:]
    low, high = np.array(env.task.workspace.low), np.array(env.task.workspace.high)
    assert np.all((xyz[:, :2] >= low[:2]) & (xyz <= high)[:, :2])
    assert rgb.min() >= 0
    assert rgb.max() <= 1
    assert rgb.std(axis=0).max() > 0.05


def test_the_environment_cloud_is_what_the_robot_works_on(env, from_afar):
    """It has no robot and no ground, but all layers of a garment on the ground."""
    points = from_afar.points.reshape(-1, 3)
    is_robot = np.isin(from_afar.segments.reshape(-1), env.segments.robot)
    assert (is_robot & (points[:, 2] > 0.5)).sum() > 1000  # the camera sees it
    cloud = get_environment_cloud(from_afar, env.segments, env.task.workspace, seed=1)[:, :3]
    particles = env.get_particles()
    assert cKDTree(particles).query(cloud)[0].max() < 0.02
    # one that is no higher than the ground
    lowered = replace(from_afar, points=from_afar.points - np.float32([0, 0, 0.02]))
    flat = get_environment_cloud(lowered, env.segments, env.task.workspace, seed=1)[:, :3]
    seen = lowered.points[from_afar.segments == env.segments.garment]
    assert seen[:, 2].max() < env.task.workspace.low[2]
    assert cKDTree(flat).query(seen)[0].max() < 0.03


def test_the_cloud_of_the_scene_is_all_in_the_workspace_the_robot_included(env, from_afar):
    ids, workspace = env.segments, env.task.workspace
    cloud = get_environment_cloud(from_afar, ids, workspace, kind="scene", seed=1)[:, :3]
    assert len(cloud) == CLOUD_SIZE
    assert np.all((cloud >= np.float32(workspace.low)) & (cloud <= np.float32(workspace.high)))
    points = from_afar.points.reshape(-1, 3)
    nearest = from_afar.segments.reshape(-1)[cKDTree(points).query(cloud)[1]]
    assert np.isin(nearest, ids.robot).mean() > 0.5
    assert (nearest == ids.garment).sum() > 20
    with pytest.raises(ValueError, match="kind should be 'segmented' or 'scene'; got 'all'"):
        get_environment_cloud(from_afar, ids, workspace, kind="all", seed=1)
    below = replace(from_afar, points=from_afar.points - np.float32([0, 0, 5]))
    with pytest.raises(PerceptionError, match="sees nothing inside the workspace"):
        get_environment_cloud(below, ids, workspace, kind="scene", seed=1)


def test_the_environment_says_what_its_clouds_show(env, from_afar, monkeypatch):
    monkeypatch.setattr(env, "cloud", "scene")
    sensed = sense(env, seed=3, step=10)
    shown = get_environment_cloud(
        from_afar, env.segments, env.task.workspace, kind="scene", seed=sensed._cloud_seed
    )
    np.testing.assert_array_equal(sensed.observe().env_point_cloud, shown)


@pytest.mark.parametrize("camera", ["garment_camera", "environment_camera"])
def test_a_pixels_point_projects_back_to_the_pixel(env, camera):
    picture = env.take_picture(camera)
    height, width = picture.segments.shape
    assert picture.rgb.shape == (height, width, 3) == (480, 640, 3)
    assert picture.rgb.dtype == np.uint8
    rng = np.random.default_rng(0)
    for row, column in rng.integers((0, 0), (height, width), size=(50, 2)):
        point = picture.points[row, column]
        if np.isfinite(point).all():
            u, v, _ = env.task.cameras[camera].project(point[None])[0]
            assert (u, v) == pytest.approx((column + 0.5, row + 0.5), abs=0.05)


def test_a_particle_seen_from_above_is_at_its_pixel(env, from_above):
    """The position picture agrees with the simulation, not only with its own intrinsics."""
    particles = env.get_particles()
    top = particles[particles[:, 2] > np.median(particles[:, 2])]
    inner = top[np.argsort(np.linalg.norm(top[:, :2] - top[:, :2].mean(axis=0), axis=1))[:50]]
    for particle in inner:
        u, v, _ = env.task.cameras["garment_camera"].project(particle[None])[0]
        seen = from_above.points[int(v), int(u)]
        assert from_above.segments[int(v), int(u)] == env.segments.garment
        np.testing.assert_allclose(seen[:2], particle[:2], atol=0.006)
        assert abs(seen[2] - particle[2]) < 0.015


class SeenView:
    """The scene with the garment as the camera shows it."""

    def __init__(self, points, truth):
        self.top = self.surface = points
        self.landmarks, self.flat_area, self.frames = (
            truth.landmarks,
            truth.flat_area,
            truth.frames,
        )


def test_camera_and_geometry_judge_alike(env, from_above):
    view = SeenView(get_garment_points(from_above, env.segments), env.view)
    seen, computed = env.task.success(view), env.apply_rule()
    assert seen.box == computed.box
    assert seen.value == pytest.approx(computed.value, abs=0.02)


def test_the_video_camera_gives_a_picture(env):
    frame = env.film()
    assert frame.shape == (480, 640, 3)
    assert frame.dtype == np.uint8
    assert frame.std() > 10


def test_a_picture_follows_the_garment(env):
    """A change of the scene invalidates earlier pictures."""
    before = env.get_particles().copy()
    moved = before + np.float32([0.05, 0.0, 0.0])
    env.cloth.state.set_particles(moved[None])
    env.advance(None)
    points = get_garment_points(env.take_picture("garment_camera"), env.segments)
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    expected = (moved.min(axis=0) + moved.max(axis=0)) / 2
    env.cloth.state.set_particles(before[None])
    env.advance(None)
    np.testing.assert_allclose(middle[:2], expected[:2], atol=0.015)


def test_an_unknown_camera_names_the_known(env):
    with pytest.raises(ValueError, match=r"must be among .*'garment_camera'.*got .*'front'"):
        env.take_picture("front")


def test_a_picture_without_the_garment_is_an_error(env, from_above):
    empty = Picture(
        rgb=from_above.rgb,
        points=np.full_like(from_above.points, np.nan),
        segments=np.zeros_like(from_above.segments),
    )
    with pytest.raises(PerceptionError, match="nothing of the garment"):
        get_garment_cloud(empty, env.segments, seed=0)
    with pytest.raises(PerceptionError, match="nothing but the robot inside the workspace"):
        get_environment_cloud(empty, env.segments, env.task.workspace, seed=0)


def test_a_picture_of_the_robot_alone_is_an_error(env, from_afar):
    robot = env.segments.robot[0]
    segments = np.where(from_afar.segments == env.segments.garment, robot, from_afar.segments)
    hidden = replace(from_afar, segments=segments)
    with pytest.raises(PerceptionError, match="nothing but the robot inside the workspace"):
        get_environment_cloud(hidden, env.segments, env.task.workspace, seed=0)


def sense(env, *, seed, step):
    driver = Driver(env, seed=seed)
    driver.commands = [None] * step
    return driver.sense(*SENSOR_CAMERAS)


def test_what_is_sensed_is_data_and_stays_as_it_was(env):
    sensed = sense(env, seed=3, step=10)
    before = pickle.dumps(sensed)
    env.advance(sensed.joint_state + 0.02)
    assert pickle.dumps(sensed) == before
    env.reset(seed=0)
    with pytest.raises(ValueError, match=r"garment_camera was not asked.*there are \[\]"):
        Driver(env, seed=3).sense().see_garment()


def test_what_is_sensed_is_what_the_cameras_see_and_the_joints_feel(env):
    from_above, from_afar = (
        env.take_picture(name) for name in ("garment_camera", "environment_camera")
    )
    sensed = sense(env, seed=3, step=10)
    seen = sensed.observe()
    np.testing.assert_array_equal(seen.image, from_afar.rgb)
    np.testing.assert_array_equal(seen.joint_state, env.agent.read_joints())
    np.testing.assert_array_equal(seen.ee_pose, env.agent.read_hands())
    assert set(seen.as_arrays()) == {"joint_state", "ee_pose", "image", "env_point_cloud"}
    segments = np.stack([from_above.segments, from_afar.segments])
    np.testing.assert_array_equal(sensed.see_mask(), segments == env.segments.garment)
    np.testing.assert_array_equal(sensed.see_points(), get_garment_points(from_afar, env.segments))
    above = sensed.see_points("garment_camera")
    np.testing.assert_array_equal(above, get_garment_points(from_above, env.segments))
    for side, pose in zip(SIDES, seen.ee_pose, strict=True):
        point = wrist_to_grasp(pose[:3], pose[3:], side)
        np.testing.assert_allclose(sensed.get_grasp_point(side), point, atol=1e-6)
    assert sensed.frames == {}


def test_what_is_sensed_depends_on_seed_and_step_alone(env):
    first, other_step, other_seed = (
        sense(env, seed=seed, step=step) for seed, step in ((3, 10), (3, 11), (4, 10))
    )
    cloud = first.see_garment()
    first.see_mask()
    again = sense(env, seed=3, step=10)
    again.observe()  # what was looked at before changes nothing
    np.testing.assert_array_equal(again.see_garment(), cloud)
    np.testing.assert_array_equal(again.observe().env_point_cloud, first.observe().env_point_cloud)
    for sensed in (other_step, other_seed):
        assert not np.array_equal(sensed.see_garment(), cloud)


def test_observations_of_points_have_clouds_beside_what_maniskill_gives(env, monkeypatch):
    def give_nothing(self, info, apply_texture_transforms):
        return {}

    monkeypatch.setattr(BaseEnv, "_get_obs_with_sensor_data", give_nothing)
    monkeypatch.setattr(env, "_obs_mode", "pointcloud")
    seen, again = (env._get_obs_with_sensor_data({}, True) for _ in range(2))
    assert seen["garment_cloud"].shape == (1, CLOUD_SIZE, 3)
    assert seen["workspace_cloud"].shape == (1, CLOUD_SIZE, 6)
    assert cKDTree(env.get_particles()).query(seen["garment_cloud"][0])[0].max() < 0.015
    for name, cloud in again.items():
        np.testing.assert_array_equal(cloud, seen[name])


@pytest.mark.slow
def test_observations_have_pictures_and_clouds():
    """Of ManiSkill's modes, with the clouds of `dgl_tasks.perception`."""
    task = dgl_tasks.get_task("FoldTops-v1")
    task = replace(task, start=replace(task.start, settle_frames=2))
    options = {"task": task, "reconfiguration_freq": 0, "render_backend": "cpu"}
    made = gymnasium.make("FoldTops-v1", obs_mode="pointcloud", **options)
    seen, _ = made.reset(seed=0)
    base = made.unwrapped
    garment, workspace = seen["garment_cloud"], seen["workspace_cloud"]
    assert garment.shape == (1, CLOUD_SIZE, 3)
    assert workspace.shape == (1, CLOUD_SIZE, 6)
    assert cKDTree(base.get_particles()).query(garment[0])[0].max() < 0.015
    again = base.get_obs()
    np.testing.assert_array_equal(again["garment_cloud"], garment)
    made.close()

    cameras = ("garment_camera", "environment_camera", "left_wrist_camera")
    made = gymnasium.make(
        "FoldTops-v1", obs_mode="rgb+depth+segmentation", cameras=cameras, **options
    )
    seen, _ = made.reset(seed=0)
    base = made.unwrapped
    for camera in ("garment_camera", "environment_camera"):
        data = seen["sensor_data"][camera]
        assert data["rgb"].shape == (1, 480, 640, 3)
        assert data["depth"].shape == data["segmentation"].shape == (1, 480, 640, 1)
        picture = base.take_picture(camera)
        placement = base.task.cameras[camera]
        _assert_like_sapiens(base, placement, picture, {k: v[0].numpy() for k, v in data.items()})
    ours = np.isin(base.take_picture("left_wrist_camera").segments, base.segments.robot)
    theirs = seen["sensor_data"]["left_wrist_camera"]["segmentation"][0, ..., 0].numpy()
    assert ours.mean() > 0.05  # the hand
    assert (ours == np.isin(theirs, base.segments.robot)).mean() > 0.999
    made.close()


def _assert_like_sapiens(env, placement, picture, seen):
    """The picture is SAPIEN's but for a few pixels at edges and a millimetre of depth."""
    is_garment = picture.segments == env.segments.garment
    assert is_garment.sum() > 1000
    named = [
        env.segments.garment,
        *env.segments.robot,
    ]  # SAPIEN's shadows have a segment of their own
    ours, theirs = (
        np.where(np.isin(s, named), s, 0) for s in (picture.segments, seen["segmentation"][..., 0])
    )
    is_same = ours == theirs
    assert is_same.mean() > 0.9999
    difference = np.abs(picture.rgb.astype(int) - seen["rgb"])
    assert difference.mean() < 1.5
    assert difference[is_garment].mean() < 3.0
    axis = placement.transform_camera_to_world[:3, 2]
    depth = 1000 * (picture.points - np.array(placement.position)) @ axis
    error = np.abs(depth - seen["depth"][..., 0])[is_same & (ours > 0)]
    assert np.quantile(error, 0.999) < 1.1
