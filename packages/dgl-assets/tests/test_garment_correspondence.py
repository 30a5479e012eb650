"""Correspondence: what it keeps, and points that it refuses."""

import dataclasses

import numpy as np
import pytest

from dgl_assets import Neck, TopParameters, correspond, make_garment


def test_correspondence_keeps_the_layer(families):
    for garments in families.values():
        source, target = garments[:2]
        for side in set(source.canonical[:, 2].tolist()) - {0.0}:
            inner = np.flatnonzero(source.canonical[:, 2] == side)[::7]
            height = correspond(source, source.vertices[inner], target)[:, 2]
            assert np.all(height * side >= 0)


def test_correspondence_ignores_the_resolution():
    coarse, fine = (make_garment(TopParameters(), spacing=spacing) for spacing in (0.020, 0.012))
    moved = correspond(coarse, coarse.vertices, fine) - coarse.vertices
    assert np.linalg.norm(moved[:, :2], axis=1).max() < 0.004


def test_a_point_on_a_leaf_is_told_from_the_front_below_it():
    neck = Neck(finish="fold", height=0.028, spread=0.03, leaf_width=0.06)
    top = make_garment(TopParameters(neck=neck))
    flap = top.panels.index("front_right_collar_flap")
    leaf = np.unique(top.faces[top.face_panels == flap])
    again = correspond(top, top.vertices[leaf], top)
    assert np.abs(again - top.vertices[leaf]).max() < 1e-4
    below = top.vertices[leaf] * [1, 1, 0] + [0, 0, 0.006]
    on_front = top.canonical[leaf, 1] > 0.95
    mapped = correspond(top, below[on_front], top)
    assert np.median(mapped[:, 2]) < 0.01


def test_wrong_points_are_refused(pairs):
    source, target = pairs["Tops_LongSleeve"][:2]
    with pytest.raises(ValueError, match=r"shape \(N,\) or float points .* got shape \(4, 2\)"):
        correspond(source, np.zeros((4, 2)), target)
    with pytest.raises(ValueError, match=r"vertex ids must be in \[0, .* got -1 to 3"):
        correspond(source, np.array([-1, 3]), target)
    with pytest.raises(ValueError, match=r"within 0\.05 m"):
        correspond(source, np.array([[2.0, 0.0, 0.0]]), target)
    other = dataclasses.replace(target, category="Trousers")
    with pytest.raises(ValueError, match="got Tops_LongSleeve and Trousers"):
        correspond(source, np.array([0]), other)


def test_nothing_corresponds_to_nothing(pairs):
    first, second = pairs["Scarf"][:2]
    assert correspond(first, np.zeros(0, dtype=int), second).shape == (0,)
    assert correspond(first, np.zeros((0, 3)), second).shape == (0, 3)


def test_a_shell_has_a_wall_and_a_resting_shape_in_space(pairs):
    sheet = pairs["Scarf"][0]
    rest = np.column_stack([sheet.rest_vertices, np.zeros(len(sheet.vertices))])
    shell = dataclasses.replace(sheet, rest_vertices=rest.astype(np.float32), wall_thickness=0.003)
    assert shell.area == pytest.approx(sheet.area, rel=1e-5)
    with pytest.raises(ValueError, match=r"rest_vertices must have shape \(\d+, 3\)"):
        dataclasses.replace(sheet, wall_thickness=0.003)
    for thickness in (0.0, -0.001, float("nan")):
        with pytest.raises(ValueError, match="wall_thickness must be None or a positive length"):
            dataclasses.replace(shell, wall_thickness=thickness)
