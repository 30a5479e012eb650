"""Camera placements, rays, cropping and farthest-point sampling."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dgl_assets.robots import DEFAULT_ROBOT
from dgl_tasks.cameras import (
    WRIST_CAMERAS,
    CameraPlacement,
    Workspace,
    build_wrist_camera,
    farthest_point_sample,
    is_in_workspace,
    look_at,
    place_wrist_camera,
)
from dgl_tasks.layouts import FLING_CAMERAS, FOLD_CAMERAS
from dgl_tasks.rotations import to_quaternion, to_rotation


def _ground_point(camera, u, v):
    """Intersect the ray of a pixel with the ground."""
    ray = np.linalg.inv(camera.intrinsics) @ (u, v, 1.0)
    T = camera.transform_camera_to_world
    direction = T[:3, :3] @ ray
    return T[:3, 3] - direction * T[2, 3] / direction[2]


def test_fold_cameras_match_the_specification():
    garment, environment = FOLD_CAMERAS["garment_camera"], FOLD_CAMERAS["environment_camera"]
    assert np.degrees(garment.horizontal_fov) == pytest.approx(23.7, abs=0.05)
    np.testing.assert_allclose(_ground_point(garment, 320, 240), (0, 1, 0), atol=1e-9)
    np.testing.assert_allclose(_ground_point(environment, 320, 240), (0, 0.54, 0), atol=5e-3)
    # At 6.75 m the picture is 2.83 x 2.12 m.
    size = _ground_point(garment, 640, 0) - _ground_point(garment, 0, 480)
    np.testing.assert_allclose(size, (2.83, 2.12, 0), atol=0.01)


def test_flings_are_seen_by_the_same_cameras_but_from_farther_away():
    assert set(FLING_CAMERAS) == set(FOLD_CAMERAS)
    same = {name for name in FOLD_CAMERAS if FLING_CAMERAS[name] == FOLD_CAMERAS[name]}
    assert same == {"garment_camera", "video_camera"}
    near, far = (cameras["environment_camera"] for cameras in (FOLD_CAMERAS, FLING_CAMERAS))
    np.testing.assert_array_equal(far.quaternion, near.quaternion)
    assert np.linalg.norm(far.position) > np.linalg.norm(near.position) + 1


def test_garment_camera_has_world_y_up_in_the_picture():
    R = to_rotation(FOLD_CAMERAS["garment_camera"].quaternion).as_matrix()
    np.testing.assert_allclose(R[:, 0], (0, 0, -1), atol=1e-9)
    np.testing.assert_allclose(R[:, 2], (0, 1, 0), atol=1e-9)


def test_look_at_points_the_axis_at_the_target():
    eye, target = (1.0, 2.0, 1.5), (-0.2, 0.3, 0.1)
    camera = CameraPlacement(name="c", position=eye, euler_deg=look_at(eye, target))
    axis = to_rotation(camera.quaternion).as_matrix()[:, 0]
    wanted = np.subtract(target, eye) / np.linalg.norm(np.subtract(target, eye))
    np.testing.assert_allclose(axis, wanted, atol=1e-12)
    with pytest.raises(ValueError, match="straight above"):
        look_at((0, 0, 1), (0, 0, 0))


def test_wrist_cameras_look_at_the_grasp_points_and_move_with_their_hands():
    rng, still = np.random.default_rng(0), np.array([0.0, 0, 0, 1, 0, 0, 0])
    for name, side in WRIST_CAMERAS.items():
        turn = Rotation.random(random_state=rng)
        pose = np.array([*rng.uniform(-1, 1, 3), *to_quaternion(turn)])
        camera = place_wrist_camera(side, pose, DEFAULT_ROBOT)
        grasp = pose[:3] + turn.apply(DEFAULT_ROBOT.get_grasp_offset(side))
        knuckles = grasp - turn.apply([0.03, 0, 0])
        (at, behind) = camera.project(np.stack([grasp, knuckles]))
        np.testing.assert_allclose(at, (320, 240, np.hypot(0.2, 0.16)), atol=1e-6)
        assert behind[0] == pytest.approx(320)  # the fingers point up in the picture
        assert behind[1] > 250
        axes = place_wrist_camera(side, still, DEFAULT_ROBOT).axes
        np.testing.assert_allclose(turn.apply(axes), camera.axes, atol=1e-12)
        # ManiSkill's: along +x, up is +z, on the link
        built = build_wrist_camera(name, DEFAULT_ROBOT, None)
        local = to_rotation(built.pose.q[0].numpy())
        np.testing.assert_allclose((turn * local).apply([1, 0, 0]), camera.axes[2], atol=1e-6)
        np.testing.assert_allclose((turn * local).apply([0, 0, -1]), camera.axes[1], atol=1e-6)
        eye = pose[:3] + turn.apply(built.pose.p[0].numpy())
        np.testing.assert_allclose(eye, camera.position, atol=1e-6)


def test_bad_cameras_and_workspaces_are_refused():
    with pytest.raises(ValueError, match="640x0"):
        CameraPlacement(name="c", position=(0, 0, 1), euler_deg=(0, 90, 0), height=0)
    with pytest.raises(ValueError, match="horizontal_fov"):
        CameraPlacement(name="c", position=(0, 0, 1), euler_deg=(0, 90, 0), horizontal_fov=4.0)
    with pytest.raises(ValueError, match="near"):
        CameraPlacement(name="c", position=(0, 0, 1), euler_deg=(0, 90, 0), near=2.0, far=1.0)
    with pytest.raises(ValueError, match="below high"):
        Workspace(low=(0, 0, 0), high=(1, 0, 1))


@pytest.mark.parametrize("name", sorted(FOLD_CAMERAS))
def test_rays_meet_the_ground_at_their_pixels(name):
    camera = FOLD_CAMERAS[name]
    ray = camera.compute_rays()[400, 300]
    point = np.array(camera.position) - ray * camera.position[2] / ray[2]
    np.testing.assert_allclose(point, _ground_point(camera, 300.5, 400.5), atol=1e-9)
    np.testing.assert_allclose(camera.project(point[None])[0, :2], (300.5, 400.5), atol=1e-9)


def test_crop_keeps_the_faces_of_the_box_and_the_colours():
    box = Workspace(low=(0, 0, 0.005), high=(1, 1, 1))
    cloud = np.array(
        [[0, 0, 0.005, 7], [1, 1, 1, 8], [0.5, 0.5, 0.0049, 9], [1.001, 0, 0.5, 9], [np.nan] * 4]
    )
    np.testing.assert_array_equal(cloud[is_in_workspace(cloud[:, :3], box), 3], [7, 8])
    assert is_in_workspace(np.zeros((0, 3)), box).shape == (0,)
    with pytest.raises(ValueError, match=r"\(N, 3\)"):
        is_in_workspace(np.zeros((5, 2)), box)


def _sheet(count, seed=0):
    xy = np.random.default_rng(seed).uniform(-0.5, 0.5, (count, 2))
    return np.column_stack([xy, 0.02 * np.sin(9 * xy[:, 0])])


def _farthest_by_definition(points, count, first):
    chosen, nearest = [first], np.linalg.norm(points - points[first], axis=1)
    while len(chosen) < count:
        chosen.append(int(nearest.argmax()))
        nearest = np.minimum(nearest, np.linalg.norm(points - points[chosen[-1]], axis=1))
    return np.array(chosen)


@pytest.mark.parametrize(("size", "count"), [(20, 15), (500, 200), (20_000, 2048)])
def test_clouds_are_sampled_by_definition(size, count):
    points = _sheet(size)
    chosen = farthest_point_sample(points, count, seed=4)
    np.testing.assert_array_equal(chosen, _farthest_by_definition(points, count, chosen[0]))


def test_sampling_follows_its_seed():
    points = _sheet(20_000)
    chosen = farthest_point_sample(points, 300, seed=0)
    np.testing.assert_array_equal(chosen, farthest_point_sample(points, 300, seed=0))
    assert (chosen != farthest_point_sample(points, 300, seed=1)).any()


def test_sampling_survives_few_points_and_duplicates():
    points = np.vstack([_sheet(10), _sheet(10)])
    assert len(farthest_point_sample(points, 20, seed=0)) == 20
    filled = farthest_point_sample(_sheet(5), 8, seed=0)
    assert set(filled[:5]) == set(range(5))
    assert len(filled) == 8
    covered = points[farthest_point_sample(points, 15, seed=0)]
    assert len(np.unique(covered, axis=0)) == 10
    assert farthest_point_sample(_sheet(1), 1, seed=0).tolist() == [0]


def test_sampling_refuses_what_it_cannot_cover():
    with pytest.raises(ValueError, match=r"\(0, 3\)"):
        farthest_point_sample(np.zeros((0, 3)), 5, seed=0)
    with pytest.raises(ValueError, match="finite"):
        farthest_point_sample(np.full((9, 3), np.nan), 5, seed=0)
