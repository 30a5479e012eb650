"""The visible surface of meshes whose areas are known."""

import numpy as np
import pytest

from dgl_tasks.coverage import sample_visible_surface
from dgl_tasks.success import compute_box_share

QUAD = np.array([[0, 1, 2], [0, 2, 3]])


def rectangle(x0, y0, x1, y1, z=0.0):
    return np.array([(x0, y0, z), (x1, y0, z), (x1, y1, z), (x0, y1, z)])


def turn(vertices, degrees):
    a = np.radians(degrees)
    R = np.array([[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1]])
    return vertices @ R.T


@pytest.mark.parametrize("degrees", [0, 30, 45, 200])
@pytest.mark.parametrize("cell", [0.01, 0.005])
def test_the_covered_area_is_that_of_the_square(degrees, cell):
    """Cells on the border count whole: at most about one cell along half the outline is added."""
    points = sample_visible_surface(turn(rectangle(0, 0, 0.4, 0.3), degrees), QUAD, cell=cell)
    area = len(points) * cell**2
    assert 0.12 - 1e-9 <= area <= 0.12 + 1.4 * cell
    np.testing.assert_allclose(points[:, 2], 0.0, atol=1e-12)


def test_each_covered_cell_gives_one_point():
    points = sample_visible_surface(turn(rectangle(0, 0, 0.3, 0.3), 20), QUAD)
    cells = np.floor(points[:, :2] / 0.005).astype(int)
    assert len(np.unique(cells, axis=0)) == len(points)


@pytest.mark.parametrize("upper_first", [False, True])
def test_of_overlapping_layers_the_top_one_is_seen(upper_first):
    lower, upper = rectangle(0, 0, 0.4, 0.4), rectangle(0.1, 0.1, 0.3, 0.3, z=0.02)
    layers = [upper, lower] if upper_first else [lower, upper]
    points = sample_visible_surface(np.concatenate(layers), np.concatenate([QUAD, QUAD + 4]))
    is_within = np.all((points[:, :2] > 0.105) & (points[:, :2] < 0.295), axis=1)
    is_beside = np.any((points[:, :2] < 0.095) | (points[:, :2] > 0.305), axis=1)
    np.testing.assert_allclose(points[is_within, 2], 0.02, atol=1e-12)
    np.testing.assert_allclose(points[is_beside, 2], 0.0, atol=1e-12)


def test_hidden_cloth_does_not_count():
    """A stack of three layers looks like one of them."""
    flat = rectangle(0, 0, 0.2, 0.2)
    stack = np.concatenate([rectangle(0, 0, 0.2, 0.2, z) for z in (0.0, 0.01, 0.02)])
    faces = np.concatenate([QUAD, QUAD + 4, QUAD + 8])
    assert len(sample_visible_surface(stack, faces)) == len(sample_visible_surface(flat, QUAD))


@pytest.mark.parametrize("degrees", [0, 35])
def test_the_share_in_a_box_is_the_share_of_the_area(degrees):
    # a right triangle cut by the line x = a: the part beyond it is similar to the whole
    triangle = np.array([(0, 0, 0), (0.5, 0, 0), (0, 0.5, 0.0)])
    points = turn(sample_visible_surface(turn(triangle, degrees), QUAD[:1]), -degrees)
    for a in (0.1, 0.25, 0.4):
        share = compute_box_share(points, (-1, -1, a, 1))
        assert share == pytest.approx(1 - (1 - a / 0.5) ** 2, abs=0.015)


def test_fine_and_coarse_meshes_of_one_surface_look_the_same():
    n = 40
    x, y = np.meshgrid(np.linspace(0, 0.4, n + 1), np.linspace(0, 0.4, n + 1), indexing="ij")
    vertices = np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3)
    corner = (np.arange(n)[:, None] * (n + 1) + np.arange(n)).ravel()
    quads = corner[:, None] + np.array([0, n + 1, n + 2, 1])
    faces = quads[:, QUAD].reshape(-1, 3)
    fine = sample_visible_surface(vertices, faces)
    coarse = sample_visible_surface(rectangle(0, 0, 0.4, 0.4), QUAD)
    assert len(fine) == pytest.approx(len(coarse), rel=0.03)


@pytest.mark.parametrize("cell", [0.0, -0.01, np.nan])
def test_a_cell_without_size_is_refused(cell):
    with pytest.raises(ValueError, match="cell must be positive"):
        sample_visible_surface(rectangle(0, 0, 1, 1), QUAD, cell=cell)
