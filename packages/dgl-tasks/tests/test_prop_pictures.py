"""Pictures of props: where they stand, with their shadows on the ground, and a sheet of them."""

import numpy as np
import pytest

from dgl_assets.props import make_prop
from dgl_tasks.drawing.props import BACKGROUND, draw_prop, draw_prop_sheet


def test_pictures_show_the_prop_where_it_stands():
    prop = make_prop("platform")
    picture, camera = draw_prop(prop, size=(120, 90))
    assert picture.shape == (90, 120, 3)
    paper = picture[0, 0].astype(int)
    is_drawn = np.abs(picture.astype(int) - paper).max(axis=2) > 40
    for name in ("near_left", "near_right", "far_left", "far_right"):
        column, row, _ = camera.project(0.97 * prop.landmarks[name][None])[0]
        assert is_drawn[
            round(row) - 1 : round(row) + 2, round(column) - 1 : round(column) + 2
        ].any()
    columns = np.nonzero(is_drawn)[1]
    assert 0.6 < np.ptp(columns) / 120 < 0.9
    # the lamp is above: the top is brighter than the side towards the viewer
    column, row, _ = camera.project(np.array([[0.0, 0.0, 0.05]]))[0]
    below = camera.project(np.array([[0.0, -0.25, 0.035]]))[0]
    side = picture[int(below[1]), int(below[0])]
    assert picture[int(row), int(column)].mean() > 1.1 * side.mean()


def test_sheet_has_a_cell_for_each_prop():
    sheet = draw_prop_sheet([make_prop("hanger"), make_prop("platform")], columns=2, size=(100, 80))
    assert sheet.shape == (80 + 64 + 40, 240, 3)
    with pytest.raises(ValueError, match="at least one prop"):
        draw_prop_sheet([])


def test_a_shadow_lies_on_the_ground_away_from_the_lamp_and_ends():
    picture, camera = draw_prop(make_prop("hat_stand"), size=(200, 160))
    columns, rows, _ = camera.project(np.array([[0.18, 0.18, 0.0], [-0.18, -0.18, 0.0]])).T
    behind, before = picture[rows.astype(int), columns.astype(int)].astype(int).mean(axis=1)
    assert behind < before - 5
    edge = np.concatenate([picture[[0, -1]].reshape(-1, 3), picture[:, [0, -1]].reshape(-1, 3)])
    assert np.abs(edge.astype(int) - BACKGROUND).max() <= 1
    np.testing.assert_array_equal(draw_prop(make_prop("hat_stand"), size=(200, 160))[0], picture)
