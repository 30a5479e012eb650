"""Meshes read from SAPIEN's bodies, and shown by them."""

import numpy as np
import pytest
import sapien

from dgl_physics.drawing.mesh import Image, Mesh, SurfaceLook
from dgl_tasks.drawing.bodies import ShownMeshes, read_meshes

pytestmark = pytest.mark.render


@pytest.fixture
def show():
    """Put shapes into a scene and read them."""
    scene = sapien.Scene()

    def read(*shapes):
        component = sapien.render.RenderBodyComponent()
        for shape in shapes:
            component.attach(shape)
        entity = sapien.Entity()
        entity.add_component(component)
        scene.add_entity(entity)
        meshes = read_meshes(entity, 4)
        assert {mesh.segment for mesh in meshes} == {entity.per_scene_id}
        assert {mesh.body for mesh in meshes} == {4}
        return meshes

    return read


def test_a_primitive_has_its_size_its_place_and_its_outside(show):
    half, centre = np.array([0.1, 0.2, 0.3]), np.array([1.0, 2.0, 3.0])
    material = sapien.render.RenderMaterial()
    material.base_color = [0.2, 0.4, 0.6, 1.0]
    material.roughness, material.metallic, material.specular = 0.3, 0.7, 0.5
    box = sapien.render.RenderShapeBox(half.astype(np.float32), material)
    quarter = [np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)]
    box.local_pose = sapien.Pose(centre.astype(np.float32), quarter)
    (mesh,) = show(box)
    turned = half[[1, 0, 2]]
    np.testing.assert_allclose(mesh.vertices.min(axis=0), centre - turned, atol=1e-6)
    np.testing.assert_allclose(mesh.vertices.max(axis=0), centre + turned, atol=1e-6)
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    outward = np.cross(b - a, c - a)
    assert ((a - centre) * outward).sum(axis=1).min() > 0
    assert (mesh.normals[mesh.faces[:, 0]] * outward).sum(axis=1).min() > 0
    surface = mesh.surface
    np.testing.assert_allclose(surface.colour, [0.2, 0.4, 0.6], atol=1e-6)
    assert (surface.roughness, surface.metallic) == pytest.approx((0.3, 0.7))
    assert surface.specular == pytest.approx(0.04)
    assert surface.image is None


@pytest.mark.parametrize(
    ("kind", "sizes", "half"),
    [
        ("Box", ([0.1, 0.2, 0.3],), (0.1, 0.2, 0.3)),
        ("Sphere", (0.25,), (0.25, 0.25, 0.25)),
        ("Capsule", (0.1, 0.4), (0.5, 0.1, 0.1)),
        ("Cylinder", (0.1, 0.4), (0.4, 0.1, 0.1)),
        ("Plane", ([1.0, 2.0, 3.0],), (0.0, 2.0, 3.0)),
    ],
)
def test_primitives_are_as_large_as_they_are(show, kind, sizes, half):
    make = getattr(sapien.render, f"RenderShape{kind}")
    (mesh,) = show(make(*sizes, sapien.render.RenderMaterial()))
    np.testing.assert_allclose(np.abs(mesh.vertices).max(axis=0), half, atol=1e-3)


def test_each_part_has_its_own_image(show):
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], dtype=np.float32)
    shapes = []
    for value, mode in ((50, "edge"), (200, "repeat")):
        material = sapien.render.RenderMaterial()
        material.base_color_texture = sapien.render.RenderTexture2D(
            np.full((8, 4, 4), value, dtype=np.uint8), "R8G8B8A8Unorm", address_mode=mode, srgb=True
        )
        shapes.append(
            sapien.render.RenderShapeTriangleMesh(
                vertices=corners,
                triangles=np.array([[0, 1, 2]], dtype=np.uint32),
                normals=np.tile(np.float32([0, 0, 1]), (3, 1)),
                uvs=corners[:, :2].copy(),
                material=material,
            )
        )
    first, second = show(*shapes)
    np.testing.assert_allclose(first.uvs, corners[:, :2])
    np.testing.assert_array_equal(first.surface.image.pixels, np.full((8, 4, 3), 50))
    np.testing.assert_array_equal(second.surface.image.pixels, np.full((8, 4, 3), 200))
    assert (first.surface.image.is_repeated, second.surface.image.is_repeated) == (False, True)


def test_what_shows_nothing_has_no_meshes():
    assert read_meshes(sapien.Entity(), None) == []


SQUARE = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], dtype=np.float32)
RED_AND_BLUE = np.repeat(np.array([[[200, 20, 20]], [[20, 20, 200]]], np.uint8), 2, axis=1)


@pytest.fixture(scope="module")
def photograph():
    """Take a picture of meshes from 1 m above the origin; made once, as shaders take seconds."""
    sapien.render.set_camera_shader_dir("default")
    scene = sapien.Scene()
    scene.set_ambient_light([1, 1, 1])
    camera = scene.add_camera("above", 32, 32, 1.0, 0.1, 10.0)
    camera.entity.set_pose(sapien.Pose([0, 0, 1], [np.sqrt(0.5), 0, np.sqrt(0.5), 0]))
    shown = ShownMeshes(sapien.Entity())
    scene.add_entity(shown.entity)

    def take(*meshes):
        shown.replace(meshes)
        scene.update_render()
        camera.take_picture()
        return camera.get_picture("Color")[..., :3]

    return take


def make_square(look, *, flip=1):
    return Mesh(
        vertices=SQUARE * np.float32([1, flip, 1]),
        normals=np.tile([0.0, 0.0, flip], (4, 1)),
        faces=np.array([[0, 1, 2], [0, 2, 3]]),
        uvs=(SQUARE[:, :2] + 1) / 2,
        surface=look,
        segment=0,
    )


def test_what_is_shown_is_read_again():
    """Its texture, coordinates and triangles, and nothing of what was shown before."""
    scene, shown = sapien.Scene(), ShownMeshes(sapien.Entity())
    scene.add_entity(shown.entity)
    pixels = np.repeat(RED_AND_BLUE, 32, axis=0)
    square = make_square(SurfaceLook(image=Image(pixels=pixels)))
    for _ in range(2):
        shown.replace([square])
        (mesh,) = read_meshes(shown.entity, None)
        corners, expected = mesh.faces.ravel(), square.faces.ravel()
        np.testing.assert_allclose(mesh.vertices[corners], square.vertices[expected])
        np.testing.assert_allclose(mesh.uvs[corners], square.uvs[expected])
        np.testing.assert_array_equal(mesh.surface.image.pixels[..., :3], pixels)


@pytest.mark.slow
def test_a_texture_lies_as_its_coordinates_say(photograph):
    look = SurfaceLook(image=Image(pixels=np.repeat(RED_AND_BLUE, 32, axis=0)))
    colour = photograph(make_square(look))
    # the picture's up is +x and its left is +y: the texture's second half lies to the left
    left, right = colour[:, 4].mean(axis=0), colour[:, -5].mean(axis=0)
    assert left[2] > 2 * left[0]
    assert right[0] > 2 * right[2]


@pytest.mark.slow
def test_an_inside_is_shown_darker_or_not_at_all(photograph):
    cloth = SurfaceLook(colour=(0.5, 0.5, 0.5), inside_shade=0.9)
    outside = photograph(make_square(cloth)).mean()
    inside = photograph(make_square(cloth, flip=-1)).mean()
    assert 0.8 * outside < inside < outside
    solid = SurfaceLook(colour=(0.5, 0.5, 0.5))
    assert photograph(make_square(solid)).mean() == pytest.approx(outside)
    np.testing.assert_array_equal(photograph(make_square(solid, flip=-1)), photograph())


@pytest.mark.slow
def test_meshes_replace_those_before(photograph):
    look = SurfaceLook(colour=(0.5, 0.5, 0.5))
    first = photograph(make_square(look))
    assert np.abs(photograph() - first).min() > 0.1
    np.testing.assert_array_equal(photograph(make_square(look)), first)
