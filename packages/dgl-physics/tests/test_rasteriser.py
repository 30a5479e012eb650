"""Pictures of meshes against what geometry and the formulas of light say."""

from dataclasses import replace

import numpy as np
import pytest

from dgl_physics.drawing.camera import PinholeCamera
from dgl_physics.drawing.light import Studio, blur_dome
from dgl_physics.drawing.mesh import SHADOW, Image, Mesh, SurfaceLook
from dgl_physics.drawing.rasteriser import Rasteriser, weigh_corners

FOV = 0.414  # [rad]
RIGHT, DOWN = (1.0, 0.0, 0.0), (0.0, 0.0, -1.0)
SINE, COSINE = np.sin(0.35), np.cos(0.35)
ABOVE = PinholeCamera(
    position=(0.0, 0.0, 3.0),
    axes=(RIGHT, (0.0, -1.0, 0.0), DOWN),
    width=96,
    height=80,
    horizontal_fov=FOV,
)
ASIDE = replace(
    ABOVE,
    position=(0.0, -4.0, 1.5),
    axes=(RIGHT, (0.0, -float(SINE), -float(COSINE)), (0.0, float(COSINE), -float(SINE))),
)
FLOOR, BOX = 3, 7


def shine(sine):
    """A dome that is brighter above."""
    return (0.2 + 0.1 * sine)[..., None] * np.array([1.0, 0.9, 0.8])


STUDIO = Studio(direction=(0.3, 0.1, -1.0), colour=(2.0, 1.8, 1.6), dome=shine, shade=0.5)
IDENTITY = np.array([[0.0, 0, 0, 1, 0, 0, 0]])


def make_square(half=0.3, height=0.0, *, segment=FLOOR, body=None, surface=None):
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * half
    return Mesh(
        vertices=np.column_stack([corners, np.full(4, height)]),
        normals=np.tile([0.0, 0.0, 1.0], (4, 1)),
        faces=np.array([[0, 1, 2], [0, 2, 3]]),
        surface=surface or SurfaceLook(colour=(0.5, 0.4, 0.3)),
        segment=segment,
        body=body,
        uvs=corners / half / 2 + 0.5,
    )


def make_box(half, *, body=0):
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * half
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    faces = np.concatenate([[[q[0], q[1], q[2]], [q[0], q[2], q[3]]] for q in quads])
    return Mesh(
        vertices=corners,
        normals=corners / np.linalg.norm(half),
        faces=faces,
        surface=SurfaceLook(colour=(0.2, 0.2, 0.8)),
        segment=BOX,
        body=body,
    )


def aim(camera, u, v):
    """Way through a place of the picture [pixels], of depth 1, world frame."""
    T, K = camera.transform_camera_to_world, camera.intrinsics
    return T[:3, :3] @ [(u - K[0, 2]) / K[0, 0], (v - K[1, 2]) / K[1, 1], 1.0]


def test_a_box_is_where_and_as_large_as_it_is():
    half = np.array([0.2, 0.15, 0.1])
    drawn = Rasteriser([make_square(5.0), make_box(half)], STUDIO)
    pose = np.array([[0.1, -0.05, 0.3, np.cos(0.2), 0.0, 0.0, np.sin(0.2)]])
    drawn.set_poses(pose)
    picture = drawn.draw_picture(ABOVE)
    is_box = picture.segments == BOX
    assert set(np.unique(picture.segments)) == {FLOOR, BOX}
    np.testing.assert_allclose(picture.points[is_box][:, 2], 0.4, atol=1e-5)
    np.testing.assert_allclose(picture.points[~is_box][:, 2], 0.0, atol=1e-5)
    c, s = np.cos(0.4), np.sin(0.4)
    local = (picture.points[is_box][:, :2] - pose[0, :2]) @ np.array([[c, -s], [s, c]])
    assert (np.abs(local) <= half[:2] + 1e-5).all()
    pixel = 2.6 / ABOVE.intrinsics[0, 0]  # on the top of the box [m]
    assert is_box.sum() * pixel**2 == pytest.approx(0.4 * 0.3, rel=0.03)


@pytest.mark.parametrize("camera", [ABOVE, ASIDE], ids=["above", "aside"])
def test_a_pixels_point_lies_on_its_ray(camera):
    drawn = Rasteriser([make_square(50.0), make_box(np.array([0.3, 0.3, 0.3]))], STUDIO)
    drawn.set_poses(IDENTITY)
    picture = drawn.draw_picture(camera)
    for row, column in np.random.default_rng(0).integers((0, 0), (80, 96), (60, 2)):
        ray = aim(camera, column + 0.5, row + 0.5)
        offset = picture.points[row, column] - camera.position
        np.testing.assert_allclose(np.cross(offset, ray), 0.0, atol=2e-4)


def test_ground_that_reaches_behind_the_camera_is_seen_up_to_the_horizon():
    level = replace(ASIDE, axes=(RIGHT, DOWN, (0.0, 1.0, 0.0)), far=1e6)
    picture = Rasteriser([make_square(5000.0)], STUDIO).draw_picture(level)
    rows = np.arange(80) + 0.5
    is_below = rows - 40 > 1.5 / 5000 * level.intrinsics[1, 1]
    assert (picture.segments[is_below] == FLOOR).all()
    assert (picture.segments[~is_below] == 0).all()
    assert np.isnan(picture.points[~is_below]).all()
    near = picture.points[50:]
    np.testing.assert_allclose(near[..., 2], 0.0, atol=1e-3)


def test_meshes_nearer_or_farther_than_the_planes_are_hidden():
    camera = replace(ABOVE, near=1.0, far=2.5)
    heights = {11: 2.1, 12: 1.9, 13: 0.6, 14: 0.4}  # at 0.9, 1.1, 2.4 and 2.6 m
    for segment, height in heights.items():
        picture = Rasteriser([make_square(0.1, height, segment=segment)], STUDIO)
        seen = picture.draw_picture(camera).segments
        assert (seen == segment).any() == (segment in (12, 13))


def test_wrong_shapes_and_fixed_meshes_are_refused():
    drawn = Rasteriser([make_square(), make_box(np.ones(3))], STUDIO)
    with pytest.raises(ValueError, match=r"poses must have shape \(1, 7\); got \(2, 7\)"):
        drawn.set_poses(np.zeros((2, 7)))
    with pytest.raises(ValueError, match=r"vertices must have shape \(8, 3\); got \(4, 3\)"):
        drawn.set_vertices(1, np.zeros((4, 3)))
    with pytest.raises(ValueError, match="mesh must be one that moves; got 0"):
        drawn.set_vertices(0, np.zeros((4, 3)))


def test_the_nearest_is_seen_in_whatever_order_and_whatever_stands_still():
    low, high = (make_square(0.4, z, segment=segment) for z, segment in ((0.1, 11), (0.2, 12)))
    pictures = []
    for meshes in ([low, high], [high, low]):
        for body in ((None, None), (0, None), (None, 0), (0, 0)):
            drawn = Rasteriser(
                [replace(m, body=b) for m, b in zip(meshes, body, strict=True)], STUDIO
            )
            drawn.set_poses(IDENTITY[: 1 if 0 in body else 0])
            pictures.append(drawn.draw_picture(ABOVE))
    for picture in pictures:
        np.testing.assert_array_equal(picture.segments, pictures[0].segments)
        np.testing.assert_array_equal(picture.rgb, pictures[0].rgb)
    assert pictures[0].segments[40, 48] == 12


def test_neighbouring_triangles_leave_no_crack():
    rng = np.random.default_rng(3)
    side = 40
    grid = np.stack(np.meshgrid(np.arange(side), np.arange(side)), axis=-1).reshape(-1, 2)
    i = (np.arange(side - 1)[:, None] * side + np.arange(side - 1)).reshape(-1)
    faces = np.concatenate(
        [np.stack([i, i + 1, i + side + 1], 1), np.stack([i, i + side + 1, i + side], 1)]
    )
    for _ in range(5):
        flat = (grid + rng.uniform(-0.3, 0.3, grid.shape)) / (side - 1) * 2 - 1
        mesh = Mesh(
            vertices=np.column_stack([flat, rng.uniform(0.0, 0.02, len(flat))]),
            normals=np.tile([0.0, 0.0, 1.0], (len(flat), 1)),
            faces=faces,
            surface=SurfaceLook(),
            segment=5,
        )
        assert (Rasteriser([mesh], STUDIO).draw_picture(ABOVE).segments == 5).all()


def test_a_matt_plane_shows_its_colour_times_the_light():
    albedo = np.array([0.5, 0.4, 0.3])
    rgb = Rasteriser([make_square(5.0)], STUDIO).draw(ABOVE)
    sine = 1.0 / np.linalg.norm(STUDIO.direction)
    dome = blur_dome(STUDIO, 1.0)[-1]
    expected = 255 * (albedo * (np.array(STUDIO.colour) * sine / np.pi + dome)) ** (1 / 2.2)
    np.testing.assert_allclose(rgb.reshape(-1, 3) - expected, 0.0, atol=1.0)


def test_a_rough_mirror_sees_the_mean_of_a_dome_that_is_the_same_everywhere():
    even = replace(STUDIO, dome=lambda sine: np.full((*np.shape(sine), 3), 0.25))
    for roughness in (0.0, 0.4, 1.0):
        np.testing.assert_allclose(blur_dome(even, roughness), 0.25, rtol=1e-6)
    blurred = [blur_dome(STUDIO, r)[:, 0] for r in (0.0, 0.3, 0.6, 1.0)]
    spreads = [np.ptp(b) for b in blurred]
    assert spreads == sorted(spreads, reverse=True)
    np.testing.assert_allclose([b[32] for b in blurred], 0.2, atol=1e-6)


def test_a_highlight_is_where_the_lamp_is_mirrored():
    """And sharper on a smoother surface."""
    camera = replace(ABOVE, horizontal_fov=1.0)
    mirrored = camera.position[2] * np.array(
        [0.3, 0.1]
    )  # of a lamp that shines along (0.3, 0.1, -1)
    sizes = []
    for roughness in (0.3, 0.5):
        surface = SurfaceLook(colour=(0.0, 0.0, 0.0), roughness=roughness, specular=0.04)
        rgb = Rasteriser([make_square(5.0, surface=surface)], STUDIO).draw(camera)
        light = (rgb[..., 0] / 255.0) ** 2.2
        row, column = np.unravel_index(light.argmax(), light.shape)
        ray = aim(camera, column + 0.5, row + 0.5)
        place = ray[:2] * camera.position[2] / -ray[2]
        np.testing.assert_allclose(place, -mirrored, atol=0.3 * roughness)
        sizes.append((light > light.max() / 2).sum())
    assert sizes[0] < sizes[1]


def test_backs_are_hidden_or_darker():
    top = make_square()
    turned = replace(top, faces=top.faces[:, ::-1], normals=-top.normals)
    assert (Rasteriser([turned], STUDIO).draw_picture(ABOVE).segments == 0).all()
    shown = replace(turned, surface=replace(top.surface, inside_shade=0.5))
    front, back = (Rasteriser([mesh], STUDIO).draw(ABOVE)[40, 48] / 255.0 for mesh in (top, shown))
    np.testing.assert_allclose((back / front) ** 2.2, 0.5, atol=0.02)


def test_an_image_lies_as_its_coordinates_say():
    pixels = np.zeros((64, 64, 3), dtype=np.uint8)
    pixels[:32, :, 0] = 200  # v < 1/2, at small y: below in the picture
    pixels[:, 32:, 1] = 200  # u > 1/2, at large x: to the right
    surface = SurfaceLook(image=Image(pixels=pixels, is_repeated=False))
    rgb = Rasteriser([make_square(0.4, surface=surface)], STUDIO).draw(ABOVE).astype(int)
    corner = {(r, c): rgb[40 + 20 * r, 48 + 20 * c] for r in (-1, 1) for c in (-1, 1)}
    for (r, c), colour in corner.items():
        assert (colour[0] > 100) == (r > 0)
        assert (colour[1] > 100) == (c > 0)


def test_a_fine_pattern_from_afar_is_its_mean():
    """By values in the texture, as SAPIEN does, and without patterns of its own."""
    checks = np.indices((256, 256)).sum(axis=0) % 2
    image = Image(pixels=np.repeat(255 * checks[..., None], 3, axis=2).astype(np.uint8))
    mesh = make_square(5.0, surface=SurfaceLook(image=image))
    mesh = replace(mesh, uvs=mesh.uvs * 20.0)
    grey = make_square(5.0, surface=SurfaceLook(colour=(0.216, 0.216, 0.216)))  # sRGB 128
    seen, mean = (Rasteriser([m], STUDIO).draw(ABOVE).astype(int) for m in (mesh, grey))
    assert np.abs(seen - mean).max() <= 3
    assert len(image.build_levels()) == 9


def test_a_shadow_only_darkens_the_pixels_behind_it():
    floor = make_square(5.0)
    shadow = make_square(0.2, 0.001, segment=SHADOW, body=0)
    post = make_square(0.1, 0.3, segment=BOX)
    plain, dark = (Rasteriser([*meshes, floor, post], STUDIO) for meshes in ((), (shadow,)))
    dark.set_poses(IDENTITY)
    before, after = plain.draw_picture(ABOVE), dark.draw_picture(ABOVE)
    np.testing.assert_array_equal(before.segments, after.segments)
    np.testing.assert_array_equal(before.points, after.points)
    is_dark = (after.rgb != before.rgb).any(axis=2)
    assert not is_dark[before.segments == BOX].any()
    place = before.points[is_dark]
    assert np.abs(place[:, :2]).max() <= 0.2
    ratio = (after.rgb[is_dark] / before.rgb[is_dark]) ** 2.2
    np.testing.assert_allclose(ratio, STUDIO.shade, atol=0.02)


def test_moving_meshes_are_drawn_at_their_poses_and_pictures_are_kept():
    drawn = Rasteriser([make_square(5.0), make_box(np.full(3, 0.1))], STUDIO)
    drawn.set_poses(IDENTITY)
    first = drawn.draw_picture(ABOVE)
    kept = first.rgb.copy()
    drawn.set_poses(np.array([[0.2, 0.0, 0.0, 1, 0, 0, 0]]))
    second = drawn.draw_picture(ABOVE)
    shift = second.points[second.segments == BOX].mean(0) - first.points[
        first.segments == BOX
    ].mean(0)
    np.testing.assert_allclose(shift, [0.2, 0.0, 0.0], atol=0.01)
    np.testing.assert_array_equal(first.rgb, kept)
    drawn.set_vertices(1, make_box(np.full(3, 0.05)).vertices)
    assert (drawn.draw_picture(ABOVE).segments == BOX).sum() < 0.3 * (second.segments == BOX).sum()


def test_pixels_know_their_triangles_whatever_moves():
    floor, box = make_square(5.0), make_box(np.array([0.2, 0.15, 0.1]))
    shadow = make_square(0.4, 0.001, segment=SHADOW)
    for meshes in ([floor, box], [box, floor]):
        drawn = Rasteriser(meshes)
        pose = np.array([[0.1, -0.05, 0.3, np.cos(0.2), 0.0, 0.0, np.sin(0.2)]])
        drawn.set_poses(pose)
        seen, picture = drawn.find_triangles(ASIDE), drawn.draw_picture(ASIDE)
        np.testing.assert_array_equal(seen.points, picture.points)
        segments = np.array([mesh.segment for mesh in meshes])
        np.testing.assert_array_equal(segments[seen.meshes], picture.segments)
        for number, mesh in enumerate(meshes):
            is_own = seen.meshes == number
            corners = mesh.vertices[mesh.faces[seen.faces[is_own]]]
            if mesh is box:
                c, s = np.cos(0.4), np.sin(0.4)
                corners = corners @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) + pose[0, :3]
            weights = weigh_corners(corners, seen.points[is_own])
            assert weights.min() >= 0.0
            np.testing.assert_allclose(
                (weights[..., None] * corners).sum(axis=1), seen.points[is_own], atol=2e-5
            )
    hidden = Rasteriser([floor, shadow]).find_triangles(ABOVE)
    assert (hidden.meshes[40, 48], hidden.faces[40, 48]) == (-1, -1)
    assert np.isnan(hidden.points[40, 48]).all()
    assert (Rasteriser([shadow]).find_triangles(ABOVE).meshes == -1).all()


def test_a_camera_is_aimed_and_projects_as_it_draws():
    towards = np.array([0.3, -1.0, 0.8])
    camera = PinholeCamera.aim(
        [0.1, 0.2, 0.3], towards, [1.0, 0.3, 0.0], distance=8.0, half_width=0.5, size=(60, 40)
    )
    (place,) = camera.project(np.array([[0.1, 0.2, 0.3]]))
    np.testing.assert_allclose(place, [30.0, 20.0, 8.0])
    axes = np.array(camera.axes)
    np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-12)
    assert axes[1, 2] < 0.0  # down in the picture is down in the world
    picture = Rasteriser([make_square(5.0)]).draw_picture(camera)
    rows, columns = np.indices((40, 60)) + 0.5
    projected = camera.project(picture.points.reshape(-1, 3).astype(float))
    np.testing.assert_allclose(projected[:, 0], columns.ravel(), atol=0.01)
    np.testing.assert_allclose(projected[:, 1], rows.ravel(), atol=0.01)
    on_rays = np.array(camera.position) + projected[:, 2:] * camera.compute_rays().reshape(-1, 3)
    np.testing.assert_allclose(on_rays, picture.points.reshape(-1, 3), atol=1e-4)
    for change, message in (
        ({"width": 0}, "width and height"),
        ({"near": 9.0, "far": 1.0}, "near"),
    ):
        with pytest.raises(ValueError, match=message):
            replace(camera, **change)
