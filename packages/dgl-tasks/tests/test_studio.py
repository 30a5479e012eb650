"""The studio: its floor, its shadows by geometry, and what the film's camera sees of it."""

import dataclasses
import importlib.util
from pathlib import Path

import gymnasium
import numpy as np
import pytest

import dgl_tasks
from dgl_tasks.layouts import FOLD_CAMERAS
from dgl_tasks.shadows import outline, project
from dgl_tasks.studio import (
    DOME_PATH,
    FLOOR,
    MAT,
    MAT_SIZE,
    paint_floor,
    sample_studio_fabric,
)

CENTRE = (0.0, 0.8)
MAKE_DOME = Path(__file__).parents[3] / "scripts" / "make_dome.py"


def _linear(image):
    return (image / 255.0) ** 2.2


def _colour_at(image, side, x, y):
    row, column = (int((v / side + 0.5) * len(image)) for v in (y, x))
    return _linear(image[row, column])


def test_floor_has_the_mat_in_its_middle_and_darker_feet():
    image = paint_floor(6.0, 512, mat_centre=CENTRE, pedestals=((0.8, 0.0),))
    assert image.shape == (512, 512, 3)
    assert image.dtype == np.uint8
    np.testing.assert_allclose(_colour_at(image, 6.0, 0, 0), MAT, atol=0.01)
    just_inside, just_outside = MAT_SIZE[0] / 2 - 0.1, MAT_SIZE[0] / 2 + 0.1
    np.testing.assert_allclose(_colour_at(image, 6.0, just_inside, 0), MAT, atol=0.01)
    np.testing.assert_allclose(_colour_at(image, 6.0, just_outside, 0), FLOOR, atol=0.01)
    foot, clear = _colour_at(image, 6.0, 0.8, -0.8), _colour_at(image, 6.0, -0.8, -0.8)
    assert (foot < 0.6 * clear).all()


def test_a_floor_is_painted_once_and_cannot_be_written_to():
    image = paint_floor(6.0, 64, mat_centre=CENTRE)
    assert paint_floor(6.0, 64, mat_centre=CENTRE) is image
    with pytest.raises(ValueError, match="read-only"):
        image[0, 0] = 0


def test_near_and_far_floor_agree_where_they_meet():
    near = paint_floor(6.0, 512, mat_centre=CENTRE)
    far = paint_floor(60.0, 512, mat_centre=CENTRE)
    for x, y in ((2.9, 0.0), (-2.9, 1.0), (0.5, 2.9), (2.9, -2.9)):
        np.testing.assert_allclose(
            _colour_at(near, 6.0, x, y), _colour_at(far, 60.0, x, y), atol=0.02
        )


def test_the_file_of_the_dome_is_made_of_its_present_colours():
    data = DOME_PATH.read_bytes()
    # KTX 2: from byte 80 on offset and length of each level, the sharpest first
    offset, length = np.frombuffer(data, "<u8", count=2, offset=80)
    sharpest = np.frombuffer(data, np.uint8, count=length, offset=offset)
    spec = importlib.util.spec_from_file_location("make_dome", MAKE_DOME)
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    faces = script.paint_dome()
    order = [faces[name] for name in ("side", "side", "top", "bottom", "side", "side")]
    np.testing.assert_array_equal(
        sharpest.reshape(6, 256, 256, 4)[..., :3], order, "run scripts/make_dome.py"
    )


def test_studio_fabrics_are_told_from_floor_and_mat():
    fabrics = [sample_studio_fabric([seed, 7]) for seed in range(150)]
    assert len({f.weave for f in fabrics}) >= 6
    for fabric in fabrics:
        yarn = np.array(fabric.colours[0]) / 255.0
        for ground in (FLOOR, MAT):
            assert np.abs(yarn - np.array(ground) ** (1 / 2.2)).max() > 0.1, fabric.name


def test_points_move_along_the_light_and_stay_below_the_ground():
    slope = np.array([-0.5, 0.25])  # the light goes (0.5, -0.25, -1)
    points = np.array([[0.0, 0.0, 0.0], [1.0, 2.0, 0.4], [1.0, 2.0, -0.4]])
    np.testing.assert_allclose(project(points, slope), [[0, 0], [1.2, 1.9], [1, 2]])


def test_shadow_of_a_ball_is_the_ellipse_of_its_tangent_rays():
    slope, radius = np.array([-0.5, 0.25]), 0.3
    (polygon,) = outline(np.zeros((1, 8, 2)), np.array([radius]), slope)
    # A ray of the light through each corner touches the ball about the origin.
    direction = np.array([*(-slope), -1.0])
    direction /= np.linalg.norm(direction)
    corners = np.column_stack([polygon, np.zeros(len(polygon))])
    along = corners @ direction
    distance = np.linalg.norm(corners - along[:, None] * direction, axis=1)
    np.testing.assert_allclose(distance, radius, atol=1e-12)


def test_shadow_of_a_box_from_straight_above_is_its_footprint():
    corners = np.array([[x, y] for x in (-1, 1) for y in (-2, 2) for _ in range(2)], dtype=float)
    (polygon,) = outline(corners[None], np.zeros(1), np.zeros(2))
    assert {tuple(p) for p in polygon} == {(-1, -2), (-1, 2), (1, -2), (1, 2)}
    x, y = polygon.T
    area = 0.5 * (x * np.roll(y, -1) - y * np.roll(x, -1)).sum()
    assert area == pytest.approx(8.0), "counter-clockwise, nothing missing"


@pytest.mark.parametrize(
    "point",
    [
        (1.42, 0.51, 0.55),  # fingertips of a parked hand, both sides
        (-1.42, 0.51, 0.55),
        (0.8, 0.0, 1.3),  # elbows raised
        (-0.8, 0.0, 1.3),
        (-0.65, 0.7, 0.0),  # cuffs of a large garment that lies at the ends of its range
        (0.65, 0.7, 0.0),
        (0.0, 1.35, 0.0),
    ],
)
def test_film_shows_the_whole_work(point):
    camera = FOLD_CAMERAS["video_camera"]
    x, y, z = (np.linalg.inv(camera.transform_camera_to_world) @ [*point, 1.0])[:3]
    u, v, w = camera.intrinsics @ [x, y, z]
    assert w > 0
    assert 0 < u / w < camera.width
    assert 0 < v / w < camera.height


def test_scene_without_pictures_has_ground_and_records_its_fabric(coarse_garments):
    task = dgl_tasks.get_task("FoldTops-v1")
    hardly_settled = dataclasses.replace(task.start, settle_frames=2)
    env = gymnasium.make(
        "FoldTops-v1",
        task=dataclasses.replace(task, start=hardly_settled),
        obs_mode="state",
        render_backend="none",
        sim_backend="physx_cpu",
    )
    env.reset(seed=5)
    first = env.unwrapped.draws["fabric"]
    assert not env.unwrapped.scene.can_render()
    assert env.unwrapped.ground.name == "ground"
    assert first == env.unwrapped.fabric.name
    position = env.unwrapped.draws["x"]
    env.reset(seed=6)
    assert env.unwrapped.draws["x"] != position
    env.reset(seed=5, options={"garment": env.unwrapped._garment_ids[-1]})
    assert env.unwrapped.draws["fabric"] == first, "an option changes only what it names"
    env.close()
