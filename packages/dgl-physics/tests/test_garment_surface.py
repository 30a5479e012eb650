"""The drawn surface of a garment: half its thickness outwards, and cut at seams."""

import numpy as np
import pytest

from dgl_physics.drawing.garment import GarmentSurface

SQUARE = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], dtype=np.float32)
UP = np.array([[0, 1, 2], [0, 2, 3]])
CORNERS = (SQUARE[:, :2] + 1) / 2


def test_a_seam_has_other_coordinates_on_each_side():
    lower, upper = [0.25, 0.25], [0.75, 0.75]
    cut = GarmentSurface(UP, np.array([[lower] * 3, [upper] * 3]))
    assert len(cut.uvs) == 6
    vertices, normals = cut.compute(SQUARE)
    assert vertices.shape == normals.shape == (6, 3)
    np.testing.assert_allclose(normals, [[0, 0, 1]] * 6)
    for triangle, corners, uv in zip(cut.faces, UP, (lower, upper), strict=True):
        np.testing.assert_array_equal(vertices[triangle][:, :2], SQUARE[corners][:, :2])
        np.testing.assert_array_equal(cut.uvs[triangle], [uv] * 3)


def test_where_both_sides_of_a_seam_agree_nothing_is_cut():
    assert len(GarmentSurface(UP, CORNERS[UP]).uvs) == 4
    with pytest.raises(ValueError, match=r"uvs of corners must have shape \(2, 3, 2\)"):
        GarmentSurface(UP, CORNERS[UP][:1])


def test_of_two_layers_in_one_place_the_outer_one_is_above():
    faces = np.concatenate([UP, UP[:, ::-1] + 4])
    surface = GarmentSurface(faces, np.concatenate([CORNERS, CORNERS]))
    vertices, _ = surface.compute(np.concatenate([SQUARE, SQUARE]))
    np.testing.assert_allclose(vertices[:4, 2], 0.002)
    np.testing.assert_allclose(vertices[4:, 2], -0.002)
