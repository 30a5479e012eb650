"""Facts about gloves."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from dgl_assets import Garment, GloveParameters, make_garment, sample_measures
from dgl_assets.garments.correspondence import correspond
from dgl_assets.garments.gloves.pattern import DIGITS, GlovePattern
from dgl_assets.garments.meshing import (
    compute_edges,
    compute_smallest_angles,
)
from dgl_assets.importing.topology import find_loops

SEEDS = range(4)


@pytest.fixture(scope="module")
def gloves() -> list[Garment]:
    return [make_garment(sample_measures("Glove", seed)) for seed in SEEDS]


def _measure_edges(glove: Garment) -> np.ndarray:
    edges, _ = compute_edges(glove.faces)
    return np.linalg.norm(glove.vertices[edges[:, 1]] - glove.vertices[edges[:, 0]], axis=1)


def test_a_glove_is_an_oriented_disk_open_at_the_wrist(gloves):
    for glove in gloves:
        edges, counts = compute_edges(glove.faces)
        assert counts.max() == 2
        half_edges = np.concatenate(
            [glove.faces[:, [0, 1]], glove.faces[:, [1, 2]], glove.faces[:, [2, 0]]]
        )
        assert len(np.unique(half_edges, axis=0)) == len(half_edges)
        assert len(glove.vertices) - len(edges) + len(glove.faces) == 1
        (loop,) = find_loops(glove.faces)
        assert np.allclose(glove.canonical[loop, 1], 2)


def test_wrist_and_cuff_follow_the_hand(gloves):
    for glove in gloves:
        middles = glove.canonical[glove.faces].mean(axis=1)
        for layer, side in (("back", 1), ("palm", -1)):
            hand, wrist, cuff = (
                middles[glove.face_panels == glove.panels.index(f"{layer}_{part}")]
                for part in ("hand", "wrist", "cuff")
            )
            assert min(len(wrist), len(cuff)) > 0
            assert hand[:, 1].max() < wrist[:, 1].min()
            assert wrist[:, 1].max() < cuff[:, 1].min()
            assert (side * np.concatenate([hand, wrist, cuff])[:, 2] > 0).all()


def test_triangles_are_even(gloves):
    lengths = np.concatenate([_measure_edges(glove) for glove in gloves])
    angles = np.concatenate(
        [compute_smallest_angles(glove.vertices, glove.faces) for glove in gloves]
    )
    assert np.mean((lengths >= 0.008) & (lengths <= 0.018)) > 0.99
    assert lengths.min() > 0.004
    assert lengths.max() < 0.027
    assert np.mean(np.degrees(angles) >= 20) > 0.99


def test_layers_are_apart_and_meet_at_the_seams(gloves):
    for glove in gloves:
        height, side = glove.vertices[:, 2], glove.canonical[:, 2]
        assert np.array_equal(np.sign(height), side)
        assert 0.012 < glove.extent[2] < 0.05
        assert glove.area > 0


def test_normals_point_outward(gloves):
    for glove in gloves:
        corners = glove.vertices[glove.faces]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        flat = np.abs(normals[:, 2]) > 0.5 * np.linalg.norm(normals, axis=1)
        assert np.array_equal(np.sign(normals[flat, 2]), glove.face_layers[flat])


def test_fingers_point_to_the_robots_and_the_thumb_to_its_side(gloves):
    hands = set()
    for glove in gloves:
        at = {name: glove.vertices[k] for name, k in glove.landmarks.items()}
        sign = {"right": 1, "left": -1}[str(glove.parameters["hand"])]
        hands.add(sign)
        tips = [sign * at[f"{digit}_tip"][0] for digit in DIGITS]
        assert tips == sorted(tips, reverse=True)  # thumb to little finger
        assert at["middle_tip"][1] < at["middle_ring_crotch"][1] < at["wrist_back"][1]
        assert at["wrist_back"][2] > 0 > at["wrist_palm"][2]
        assert at["wrist_thumb_side"][1] == pytest.approx(glove.vertices[:, 1].max(), abs=5e-4)
    assert hands == {1, -1}


def test_a_left_glove_mirrors_a_right_one():
    right = make_garment(GloveParameters())
    left = make_garment(GloveParameters(hand="left"))
    assert np.allclose(left.vertices * [-1, 1, 1], right.vertices, atol=1e-7)
    assert np.array_equal(left.canonical, right.canonical)
    assert np.array_equal(left.faces[:, ::-1], right.faces)


def test_canonical_is_injective_on_each_layer(gloves):
    for glove in gloves:
        corners = glove.canonical[glove.faces].astype(np.float64)
        first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
        areas = (first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]) * glove.face_layers
        areas *= {"right": 1, "left": -1}[str(glove.parameters["hand"])]
        assert areas.min() > 0


@pytest.mark.parametrize("seed", range(2))
def test_maps_invert_each_other(seed):
    rng = np.random.default_rng(seed)
    pattern = GlovePattern(sample_measures("Glove", seed))
    places = np.column_stack([rng.uniform(-1, 1, 200), rng.uniform(0, 2, 200)])
    again = pattern.to_canonical(pattern.to_pattern_palm(places), "palm")
    assert np.allclose(again, places, atol=1e-6)
    for digit in pattern.digits.values():
        t, x = rng.uniform(0, 1.25, 100), rng.uniform(-0.5, 0.5, 100)
        assert np.allclose(digit.find(digit.place(t, x)), [t, x], atol=1e-6)


def test_canonical_is_continuous_at_the_base_of_each_digit():
    pattern = GlovePattern(sample_measures("Glove", 3))
    x = np.linspace(-0.95, 0.95, 20)
    for name, digit in pattern.digits.items():
        base = digit.place(np.zeros(20), x)
        gap = pattern.to_canonical(base, name) - pattern.to_canonical(base, "palm")
        assert np.abs(gap).max() < 0.01


def test_landmarks_correspond_within_half_an_edge(gloves):
    for source, target in itertools.pairwise(gloves):
        names = tuple(source.landmarks)
        assert set(names) == set(target.landmarks)
        ids = np.array([source.landmarks[name] for name in names])
        error = target.vertices[correspond(source, ids, target)] - target.get_landmark_positions(
            names
        )
        assert np.linalg.norm(error, axis=1).max() < 0.0059


def test_a_finger_corresponds_to_the_same_finger(gloves):
    for source, target in itertools.pairwise(gloves):
        for digit in DIGITS:
            faces = source.faces[source.face_panels == source.panels.index(f"back_{digit}")]
            inside = [k for k in np.unique(faces) if source.canonical[k, 2] == 1]
            there = correspond(source, np.array(inside), target)
            panel = target.faces[target.face_panels == target.panels.index(f"back_{digit}")]
            assert np.isin(there, panel).mean() > 0.9


def test_gloves_differ_in_cut_and_not_only_in_size():
    drawn = [sample_measures("Glove", seed) for seed in range(40)]
    for ratios, spread in (
        ([p.cuff_length / p.palm_length for p in drawn], 3.0),
        ([p.middle_length / p.hand_width for p in drawn], 1.25),
        ([p.finger_puff for p in drawn], 1.6),
        ([p.thumb_angle for p in drawn], 1.5),
    ):
        assert max(ratios) / min(ratios) > spread
    assert {p.hand for p in drawn} == {"left", "right"}


def test_spacing_is_followed():
    glove = make_garment(GloveParameters(), spacing=0.006)
    assert np.median(_measure_edges(glove)) == pytest.approx(0.006, rel=0.08)
    assert len(glove.vertices) > 1000


def test_wrong_measures_are_refused(find_unrefused):
    table = [
        ({"hand": "middle"}, "hand must be 'left' or 'right'; got 'middle'"),
        ({"hand_width": 0.2}, r"hand_width must be in .* got 0\.2"),
        ({"cuff_length": float("inf")}, "cuff_length must be a finite number"),
        ({"middle_length": 0.05, "little_ratio": 0.63}, "the little finger, must be at least"),
        ({"thumb_length": 0.045, "thumb_width": 0.038}, r"at least 1\.2 \* thumb_width"),
        ({"thumb_width": 0.042}, r"at most 0\.44 \* palm_length"),
        ({"finger_spread": 0.2, "thumb_angle": 0.5}, "clear of the index finger"),
    ]
    glove = GloveParameters()
    rows = [(lambda c=c: replace(glove, **c), message) for c, message in table]
    rows += [(lambda: make_garment(glove, spacing=0.02), r"spacing must be in .* got 0\.02")]
    assert find_unrefused(rows) == []
