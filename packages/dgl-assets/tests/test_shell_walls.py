"""Walls behind shells become valid tetrahedra."""

import numpy as np
import pytest

from dgl_assets import make_garment, sample_measures
from dgl_assets.errors import MeshingError
from dgl_assets.garments.gloves.seam_edges import open_seams
from dgl_assets.garments.wall import find_folds


def _make_tube(radius: float) -> tuple[np.ndarray, np.ndarray]:
    around, along = 8, 4
    turn = 2 * np.pi * np.arange(around) / around
    x, y = radius * np.cos(turn), radius * np.sin(turn)
    rows = [np.column_stack([x, y, np.full(around, 0.01 * z)]) for z in range(along)]
    faces = []
    for z in range(along - 1):
        for k in range(around):
            a, b = z * around + k, z * around + (k + 1) % around
            faces += [(a, b, b + around), (a, b + around, a + around)]
    return np.concatenate(rows), np.array(faces)


def test_a_wall_thinner_than_the_radius_fits_and_a_thicker_one_folds():
    vertices, faces = _make_tube(0.01)
    assert len(find_folds(vertices, faces, 0.005)) == 0
    assert len(find_folds(vertices, faces, 0.013)) == len(faces)
    assert len(find_folds(vertices, faces[:, ::-1], 0.013)) == 0  # the wall is outside


def test_a_flat_wall_of_any_winding_fits():
    vertices = np.array([[0, 0, 0], [0.01, 0, 0], [0, 0.01, 0], [0.01, 0.01, 0.0]])
    for faces in ([[0, 1, 2], [1, 3, 2]], [[2, 0, 1], [2, 1, 3]], [[2, 1, 0], [2, 3, 1]]):
        assert len(find_folds(vertices, np.array(faces), 0.003)) == 0


@pytest.mark.parametrize("category", ["Baseball_Cap", "Bowl_Hat", "Glove"])
def test_walls_of_random_shells_fit(category):
    for seed in range(40, 42):
        shell = make_garment(sample_measures(category, seed))
        assert len(find_folds(shell.vertices, shell.faces, shell.wall_thickness)) == 0


def test_a_triangle_between_seams_is_opened():
    """Vertex 3 of each layer is inside; the others are on the common seam."""
    layers = np.array([0, 0, 0, 1, -1])
    upper, lower = [[0, 1, 2], [2, 1, 3]], [[0, 2, 1], [1, 2, 4]]
    opened = open_seams(np.array(upper + lower), layers)
    assert not (layers[opened] == 0).all(axis=1).any()
    assert sorted(map(sorted, opened.tolist())) == [[0, 1, 3], [0, 1, 4], [0, 2, 3], [0, 2, 4]]


def test_a_layer_without_an_inside_is_refused():
    with pytest.raises(MeshingError, match="too narrow for the spacing"):
        open_seams(np.array([[0, 1, 2], [0, 2, 1]]), np.zeros(3))
