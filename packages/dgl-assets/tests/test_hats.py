"""Facts about baseball caps and bowl hats."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from dgl_assets import (
    BowlHatParameters,
    CapParameters,
    Garment,
    make_garment,
    sample_measures,
)
from dgl_assets.garments.correspondence import correspond
from dgl_assets.garments.hats.oval import compute_oval
from dgl_assets.garments.meshing import (
    compute_edges,
    compute_smallest_angles,
)
from dgl_assets.importing.topology import find_loops

SEEDS = range(5)


@pytest.fixture(scope="module")
def caps() -> list[Garment]:
    return [make_garment(sample_measures("Baseball_Cap", seed)) for seed in SEEDS]


@pytest.fixture(scope="module")
def bowls() -> list[Garment]:
    return [make_garment(sample_measures("Bowl_Hat", seed)) for seed in SEEDS]


@pytest.fixture(params=["caps", "bowls"])
def hats(request) -> list[Garment]:
    return request.getfixturevalue(request.param)


def _measure_edges(hat: Garment) -> np.ndarray:
    edges, _ = compute_edges(hat.faces)
    return np.linalg.norm(hat.vertices[edges[:, 1]] - hat.vertices[edges[:, 0]], axis=1)


def test_a_hat_is_an_oriented_disk_with_one_boundary(hats):
    for hat in hats:
        edges, counts = compute_edges(hat.faces)
        assert counts.max() == 2
        half_edges = np.concatenate(
            [hat.faces[:, [0, 1]], hat.faces[:, [1, 2]], hat.faces[:, [2, 0]]]
        )
        assert len(np.unique(half_edges, axis=0)) == len(half_edges)
        assert len(find_loops(hat.faces)) == 1
        assert len(hat.vertices) - len(edges) + len(hat.faces) == 1
        assert np.array_equal(np.unique(hat.faces), np.arange(len(hat.vertices)))


def test_triangles_are_even(hats):
    lengths = np.concatenate([_measure_edges(hat) for hat in hats])
    angles = np.concatenate([compute_smallest_angles(hat.vertices, hat.faces) for hat in hats])
    assert np.mean((lengths >= 0.008) & (lengths <= 0.018)) > 0.99
    assert lengths.min() > 0.004
    assert lengths.max() < 0.028
    assert np.mean(np.degrees(angles) >= 20) > 0.999


def test_hats_stand_on_the_ground_centred_and_open_downward(hats):
    for hat in hats:
        low, high = hat.vertices.min(axis=0), hat.vertices.max(axis=0)
        assert low[2] == 0
        assert np.allclose((low + high)[:2], 0, atol=1e-6)
        top = hat.vertices[hat.landmarks["crown_top"]]
        assert top[2] > 0.85 * high[2]
        corners = hat.vertices[hat.faces]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        assert normals[:, 2].sum() > 0  # outward is up


def test_the_opening_has_the_girth_of_the_head(bowls):
    for hat in bowls:
        radius = np.linalg.norm(hat.canonical[:, :2], axis=1)
        ring = np.flatnonzero(np.abs(radius - 1) < 1e-5)
        order = ring[np.argsort(np.arctan2(*hat.canonical[ring, :2].T))]
        points = hat.vertices[order][:, :2]
        girth = np.linalg.norm(np.roll(points, -1, axis=0) - points, axis=1).sum()
        assert girth == pytest.approx(hat.parameters["head_girth"], rel=0.005)


def test_oval_has_the_stated_girth_and_ratio():
    angles = np.linspace(0, 2 * np.pi, 2001)
    radius = compute_oval(0.5, 1.2, angles)
    points = radius[:, None] * np.column_stack([np.sin(angles), np.cos(angles)])
    assert np.linalg.norm(np.diff(points, axis=0), axis=1).sum() == pytest.approx(0.5, rel=1e-4)
    assert np.ptp(points[:, 1]) / np.ptp(points[:, 0]) == pytest.approx(1.2, rel=1e-4)


def test_default_cap_is_the_size_of_the_demonstration_cap():
    assert make_garment(CapParameters()).extent == pytest.approx([0.145, 0.213, 0.087], abs=0.012)


def test_the_visor_points_to_the_robots(caps):
    for cap in caps:
        at = {name: cap.vertices[k] for name, k in cap.landmarks.items()}
        assert at["brim_tip"][1] == pytest.approx(cap.vertices[:, 1].min(), abs=1e-6)
        assert at["brim_tip"][1] < at["brim"][1] < at["front"][1] < at["back"][1]
        assert at["left_visor_end"][0] < 0 < at["right_visor_end"][0]
        share = (at["brim"][1] - cap.vertices[:, 1].min()) / cap.extent[1]
        assert 0.1 < share < 0.3  # the paper's demonstration point is at 0.23


def test_seams_lie_between_panels(caps):
    for cap in caps:
        count = len(cap.panels)
        assert count in (6, 7)
        assert np.array_equal(np.unique(cap.face_panels), np.arange(count))
        for index in range(count):
            panel = cap.faces[cap.face_panels == index]
            assert len(find_loops(panel)) == 1


def test_canonical_is_injective(hats):
    for hat in hats:
        corners = hat.canonical[hat.faces].astype(np.float64)
        first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
        areas = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]
        assert areas.min() > 0


def test_landmarks_correspond_within_half_an_edge(hats):
    for source, target in itertools.pairwise(hats):
        names = tuple(source.landmarks)
        assert set(names) == set(target.landmarks)
        ids = np.array([source.landmarks[name] for name in names])
        error = target.vertices[correspond(source, ids, target)] - target.get_landmark_positions(
            names
        )
        assert np.linalg.norm(error, axis=1).max() < 0.0055


def test_hats_differ_in_cut_and_not_only_in_size():
    bowls = [sample_measures("Bowl_Hat", seed) for seed in range(40)]
    caps = [sample_measures("Baseball_Cap", seed) for seed in range(40)]
    for ratios, spread in (
        ([p.brim_width / p.crown_height for p in bowls], 3.0),
        ([p.crown_exponent for p in bowls], 2.0),
        ([p.crown_height / p.head_girth for p in caps], 1.5),
        ([p.visor_length / p.head_girth for p in caps], 1.4),
    ):
        assert max(ratios) / min(ratios) > spread
    assert {p.panel_count for p in caps} == {5, 6}


def test_the_same_measures_give_the_same_cap():
    first, second = make_garment(CapParameters()), make_garment(CapParameters())
    assert np.array_equal(first.vertices, second.vertices)
    assert np.array_equal(first.faces, second.faces)


def test_spacing_is_followed():
    for spacing, hat in (
        (0.008, make_garment(CapParameters(), spacing=0.008)),
        (0.014, make_garment(BowlHatParameters(), spacing=0.014)),
    ):
        assert np.median(_measure_edges(hat)) == pytest.approx(spacing, rel=0.08)


def test_wrong_measures_are_refused(find_unrefused):
    cap, hat = CapParameters(), BowlHatParameters()
    table = [
        (cap, {"crown_height": 0.3}, r"crown_height must be in .* got 0\.3"),
        (cap, {"panel_count": 4}, r"panel_count must be one of \(5, 6\); got 4"),
        (cap, {"visor_length": float("nan")}, "visor_length must be a finite number"),
        (cap, {"front_rise": 0.029}, "front_rise must be at most"),
        (CapParameters(head_girth=0.4), {"visor_length": 0.07}, "visor_length must be at most"),
        (hat, {"brim_width": 0.0}, "brim_width must be in"),
        (hat, {"brim_slope": 1.0, "brim_curve": 0.5}, r"at most the limit \[rad\] \(1\.3\)"),
        (hat, {"brim_slope": -0.4, "brim_curve": -0.5}, r"at least the limit \[rad\] \(-0\.7\)"),
        (hat, {"side_curl": 0.045}, "size of side_curl must be at most"),
        (hat, {"wave_height": 0.012, "brim_width": 0.05}, r"size of 4 \* wave_height"),
        (BowlHatParameters(crown_height=0.06), {"top_dent": 0.02}, "top_dent must be at most"),
    ]
    rows = [(lambda p=p, c=c: replace(p, **c), message) for p, c, message in table]
    message = r"spacing must be in .* got 0\.02"
    rows += [(lambda: make_garment(cap, spacing=0.02), message)]
    rows += [(lambda: make_garment(hat, spacing=0.02), message)]
    assert find_unrefused(rows) == []
