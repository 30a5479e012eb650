"""Pictures of a garment show its outside, its texture and its thickness."""

import numpy as np
import pytest

sapien = pytest.importorskip("sapien")

from dgl_physics.sapien_bridge import GarmentVisual  # noqa: E402

pytestmark = pytest.mark.render

SQUARE = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], dtype=np.float32)
UP = np.array([[0, 1, 2], [0, 2, 3]])
CORNERS = (SQUARE[:, :2] + 1) / 2
RED_AND_BLUE = np.repeat(np.array([[[200, 20, 20]], [[20, 20, 200]]], np.uint8), 2, axis=1)


@pytest.fixture(scope="module")
def studio():
    """A scene and its camera, 1 m above the origin; the first picture takes seconds."""
    sapien.render.set_camera_shader_dir("default")
    scene = sapien.Scene()
    scene.set_ambient_light([1, 1, 1])
    camera = scene.add_camera("above", 32, 32, 1.0, 0.1, 10.0)
    camera.entity.set_pose(sapien.Pose([0, 0, 1], [np.sqrt(0.5), 0, np.sqrt(0.5), 0]))
    return scene, camera


@pytest.fixture
def photograph(studio):
    """Take a picture: colour and height of each pixel."""
    scene, camera = studio
    before = set(scene.entities)

    def take():
        scene.update_render()
        camera.take_picture()
        return camera.get_picture("Color")[..., :3], 1.0 + camera.get_picture("Position")[..., 2]

    yield scene, take
    for entity in set(scene.entities) - before:
        scene.remove_entity(entity)


@pytest.mark.slow
def test_texture_lies_as_its_coordinates_say(photograph):
    scene, take = photograph
    visual = GarmentVisual(scene, UP, uvs=CORNERS, texture=np.repeat(RED_AND_BLUE, 32, axis=0))
    visual.update(SQUARE)
    colour, _ = take()
    # The picture's up is +x and its left is +y: the texture's second half lies to the left.
    left, right = colour[:, 4].mean(axis=0), colour[:, -5].mean(axis=0)
    assert left[2] > 2 * left[0]
    assert right[0] > 2 * right[2]


SEAM = np.array([[[0.25, 0.25]] * 3, [[0.75, 0.75]] * 3])
"""Coordinates of triangles that share an edge, and no colour."""
HALVES = np.repeat(np.repeat(RED_AND_BLUE[:, :1], 2, axis=1), 32, axis=0)


def test_a_seam_has_other_coordinates_on_each_side(photograph):
    scene, _ = photograph
    visual = GarmentVisual(scene, UP, uvs=SEAM, texture=HALVES)
    assert len(visual.uvs) == 6
    surface, normals = visual.compute_surface(SQUARE)
    assert surface.shape == normals.shape == (6, 3)
    np.testing.assert_allclose(normals, [[0, 0, 1]] * 6)
    np.testing.assert_allclose(surface[:, 2], surface[0, 2])
    whole = GarmentVisual(scene, UP, uvs=CORNERS[UP], texture=HALVES)
    assert len(whole.uvs) == 4  # nothing is cut where both sides agree
    with pytest.raises(ValueError, match=r"uvs of corners must have shape \(2, 3, 2\)"):
        GarmentVisual(scene, UP, uvs=SEAM[:1], texture=HALVES)


@pytest.mark.slow
def test_a_seam_has_other_colours_on_each_side(photograph):
    scene, take = photograph
    visual = GarmentVisual(scene, UP, uvs=SEAM, texture=HALVES)
    visual.update(SQUARE)
    colour = take()[0].astype(float)
    bluer = colour[..., 2] > colour[..., 0]
    assert 0.3 < bluer.mean() < 0.7


def test_layers_in_one_place_show_their_outsides(photograph):
    scene, _ = photograph
    layers = np.concatenate([SQUARE, SQUARE])
    faces = np.concatenate([UP, UP[:, ::-1] + 4])
    surface, normals = GarmentVisual(scene, faces, thickness=0.01).compute_surface(layers)
    np.testing.assert_allclose(normals[:, 2], [1] * 4 + [-1] * 4)
    np.testing.assert_allclose(surface[:, 2], 0.005 * normals[:, 2], atol=1e-6)


@pytest.mark.slow
def test_of_two_layers_in_one_place_the_outside_is_seen(photograph):
    scene, take = photograph
    layers = np.concatenate([SQUARE, SQUARE])
    faces = np.concatenate([UP, UP[:, ::-1] + 4])
    thickness = 0.01
    visual = GarmentVisual(scene, faces, thickness=thickness)
    visual.update(layers)
    _, height = take()
    np.testing.assert_allclose(height, thickness / 2, atol=1e-4)


@pytest.mark.slow
def test_inside_is_seen_and_darker(photograph):
    scene, take = photograph
    visual = GarmentVisual(scene, UP, colour=(0.5, 0.5, 0.5))
    visual.update(SQUARE)
    outside = take()[0].mean()
    visual.update(SQUARE * np.float32([1, -1, 1]))
    inside = take()[0].mean()
    assert 0.8 * outside < inside < outside


def test_wrong_textures_are_refused(photograph):
    scene, _ = photograph
    with pytest.raises(ValueError, match="must come with uvs"):
        GarmentVisual(scene, UP, texture=RED_AND_BLUE)
    with pytest.raises(ValueError, match=r"dtype uint8; got .* float64"):
        GarmentVisual(scene, UP, uvs=CORNERS, texture=RED_AND_BLUE / 255.0)
    visual = GarmentVisual(scene, UP, uvs=CORNERS, texture=RED_AND_BLUE)
    with pytest.raises(ValueError, match=r"must have shape \(4, 3\); got \(3, 3\)"):
        visual.update(SQUARE[:3])
