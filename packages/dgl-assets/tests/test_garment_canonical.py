"""Canonical coordinates and correspondence between tops."""

import dataclasses
import itertools

import numpy as np
import pytest

from dgl_assets import Garment, TopParameters, correspond, make_top, sample_top
from dgl_assets.garments.tops.pattern import V_ARMPIT, TopPattern


@pytest.fixture(scope="module")
def tops() -> list[Garment]:
    return [make_top(sample_top(100 + seed)) for seed in range(12)]


def test_canonical_is_injective_on_each_layer(tops):
    """No triangle is turned over, so the map of a layer with one boundary is one to one."""
    for top in tops:
        corners = top.canonical[top.faces].astype(np.float64)
        first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
        areas = (first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]) * top.face_layers
        assert areas.min() > 1e-5
        for side in (1, -1):
            places = top.canonical[top.canonical[:, 2] * side >= 0, :2]
            assert len(np.unique(places, axis=0)) == len(places)


def test_canonical_covers_the_stated_range(tops):
    for top in tops:
        u, v, side = top.canonical.T
        assert u.min() == -2
        assert u.max() == 2
        assert v.min() == 0
        assert set(side) == {-1, 0, 1}
        on_sleeve = np.abs(u) > 1
        assert np.all((v[on_sleeve] >= V_ARMPIT - 1e-6) & (v[on_sleeve] <= 1 + 1e-6))


@pytest.mark.parametrize("layer", [1, -1])
@pytest.mark.parametrize("seed", range(6))
def test_maps_invert_each_other(seed, layer):
    rng = np.random.default_rng(seed)
    pattern = TopPattern(sample_top(seed))
    body = np.stack([rng.uniform(-1, 1, 300), rng.uniform(0, 0.8, 300)], axis=1)
    sleeve = np.stack([rng.uniform(1, 2, 300), rng.uniform(V_ARMPIT, 1, 300)], axis=1)
    for part, canonical in (
        ("body", body),
        ("right_sleeve", sleeve),
        ("left_sleeve", sleeve * [-1, 1]),
    ):
        points = pattern.to_pattern(canonical, layer=layer)
        again = pattern.to_canonical(points, part=part, layer=layer)
        assert np.allclose(again, canonical, atol=1e-6)


def test_map_is_continuous_across_the_armhole():
    pattern = TopPattern(sample_top(3))
    v = np.linspace(V_ARMPIT, 1, 50)
    for sign in (-1, 1):
        inside = pattern.to_pattern(np.stack([np.full(50, sign * (1 - 1e-9)), v], axis=1), layer=1)
        outside = pattern.to_pattern(np.stack([np.full(50, sign * (1 + 1e-9)), v], axis=1), layer=1)
        assert np.allclose(inside, outside, atol=1e-4)


def test_landmarks_correspond_within_half_an_edge(tops):
    rng = np.random.default_rng(0)
    for _ in range(60):
        source, target = (tops[k] for k in rng.choice(len(tops), 2, replace=False))
        names = tuple(source.landmarks)
        assert names == tuple(target.landmarks)
        ids = correspond(source, np.array([source.landmarks[name] for name in names]), target)
        error = target.vertices[ids] - target.get_landmark_positions(names)
        assert np.linalg.norm(error, axis=1).max() < 0.0065
        points = correspond(source, source.get_landmark_positions(names), target)
        error = points - target.get_landmark_positions(names)
        assert np.linalg.norm(error, axis=1).max() < 0.0065


def test_correspondence_there_and_back_returns(tops):
    rng = np.random.default_rng(1)
    plain = [top for top in tops if top.parameters["collar_height"] == 0]
    for source, target in itertools.pairwise(plain):
        points = source.vertices[rng.integers(len(source.vertices), size=200)]
        back = correspond(target, correspond(source, points, target), source)
        assert np.abs(back - points).max() < 1e-4


def test_correspondence_keeps_the_layer(tops):
    source, target = tops[:2]
    for side in (1, -1):
        inner = np.flatnonzero(source.canonical[:, 2] == side)
        height = correspond(source, source.vertices[inner], target)[:, 2]
        assert np.all(height * side >= 0)


def test_correspondence_ignores_the_resolution():
    parameters = sample_top(5)
    coarse, fine = (make_top(parameters, spacing=spacing) for spacing in (0.016, 0.010))
    moved = correspond(coarse, coarse.vertices, fine) - coarse.vertices
    assert np.linalg.norm(moved[:, :2], axis=1).max() < 0.004


def test_landmarks_are_at_their_tailoring_places(tops):
    for top in tops:
        position = dict(
            zip(top.landmarks, top.get_landmark_positions(tuple(top.landmarks)), strict=True)
        )
        for left, sign in (("left", -1), ("right", 1)):
            x = {
                name: sign * position[f"{left}_{name}"][0]
                for name in ("cuff", "armpit", "neck_side")
            }
            assert x["cuff"] > x["armpit"] > x["neck_side"] > 0
            upper, lower = position[f"{left}_cuff_upper"], position[f"{left}_cuff_lower"]
            width = np.linalg.norm(upper - lower)
            assert width == pytest.approx(top.parameters["cuff_width"], rel=0.02)
            middle = (upper + lower) / 2
            assert 0.008 < np.linalg.norm(position[f"{left}_cuff"] - middle) < 0.05
        chest = position["right_armpit"][0] - position["left_armpit"][0]
        assert chest == pytest.approx(2 * top.parameters["chest_half_width"], rel=1e-3)
        assert top.canonical[top.landmarks["collar"], 2] == -1
        assert top.canonical[top.landmarks["centre"], 2] == 1


def test_the_collar_is_seen_through_a_plain_neck(tops):
    for top in tops:
        if top.parameters["collar_height"] > 0:
            continue
        on_front = (top.canonical[:, 2] == 1) & (np.abs(top.canonical[:, 0]) < 0.05)
        assert top.vertices[on_front, 1].max() < top.vertices[top.landmarks["collar"], 1]


def test_wrong_places_are_refused(tops):
    source, target = tops[:2]
    with pytest.raises(ValueError, match=r"shape \(N,\) or float points .* got shape \(4, 2\)"):
        correspond(source, np.zeros((4, 2)), target)
    with pytest.raises(ValueError, match=r"vertex ids must be in \[0, .* got -1 to 3"):
        correspond(source, np.array([-1, 3]), target)
    with pytest.raises(ValueError, match=r"within 0\.05 m"):
        correspond(source, np.array([[2.0, 0.0, 0.0]]), target)
    other = dataclasses.replace(target, category="Trousers")
    with pytest.raises(ValueError, match="got Tops_LongSleeve and Trousers"):
        correspond(source, np.array([0]), other)


def test_nothing_corresponds_to_nothing(tops):
    assert correspond(tops[0], np.zeros(0, dtype=int), tops[1]).shape == (0,)
    assert correspond(tops[0], np.zeros((0, 3)), tops[1]).shape == (0, 3)


def test_default_measures_make_a_top():
    assert make_top(TopParameters()).area > 0.5
