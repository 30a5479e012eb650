"""Facts about the sewn surface of random tops."""

import numpy as np
import pytest

from dgl_assets import Garment, TopParameters, make_top, sample_top
from dgl_assets.garments.meshing import (
    compute_boundary_loops,
    compute_edges,
    compute_smallest_angles,
)

SEEDS = range(20)


@pytest.fixture(scope="module")
def tops() -> list[Garment]:
    return [make_top(sample_top(seed)) for seed in SEEDS]


def _edge_lengths(positions: np.ndarray, edges: np.ndarray) -> np.ndarray:
    return np.linalg.norm(positions[edges[:, 1]] - positions[edges[:, 0]], axis=1)


def test_surface_is_an_oriented_manifold_with_four_openings(tops):
    for top in tops:
        half_edges = np.concatenate(
            [top.faces[:, [0, 1]], top.faces[:, [1, 2]], top.faces[:, [2, 0]]]
        )
        assert len(np.unique(half_edges, axis=0)) == len(half_edges)  # neighbours agree
        edges, counts = compute_edges(top.faces)
        assert counts.max() == 2
        loops = compute_boundary_loops(top.faces)
        assert len(loops) == 4
        assert len(top.vertices) - len(edges) + len(top.faces) == -2  # a sphere with four holes
        # At every vertex the faces form one fan: no two pieces hang together at a point.
        used, face_counts = np.unique(top.faces, return_counts=True)
        degrees = np.bincount(edges.ravel())
        is_open = np.isin(used, np.concatenate(loops))
        assert np.array_equal(used, np.arange(len(top.vertices)))
        assert np.array_equal(degrees, face_counts + is_open)


def test_openings_are_neck_hem_and_cuffs(tops):
    for top in tops:
        kinds = set()
        for loop in compute_boundary_loops(top.faces):
            u, v, _ = top.canonical[loop].T
            if np.all(v == 0):
                kinds.add("hem")
            elif np.all(u == -2):
                kinds.add("left_cuff")
            elif np.all(u == 2):
                kinds.add("right_cuff")
            elif np.all(np.abs(u) < 0.4201) and np.all(v > 0.8):
                kinds.add("neck")
        assert kinds == {"hem", "left_cuff", "right_cuff", "neck"}


def test_triangles_are_even(tops):
    lengths, angles = [], []
    for top in tops:
        edges, _ = compute_edges(top.faces)
        lengths.append(_edge_lengths(top.rest_vertices, edges))
        angles.append(np.degrees(compute_smallest_angles(top.rest_vertices, top.faces)))
    lengths, angles = np.concatenate(lengths), np.concatenate(angles)
    assert np.mean((lengths > 0.008) & (lengths < 0.018)) > 0.99
    assert lengths.min() > 0.005
    assert lengths.max() < 0.027
    assert np.mean(angles >= 20) > 0.99
    assert angles.min() > 15


def test_the_gap_hardly_stretches_the_cloth(tops):
    for top in tops:
        edges, _ = compute_edges(top.faces)
        rest = _edge_lengths(top.rest_vertices, edges)
        assert np.max(_edge_lengths(top.vertices, edges) / rest) < 1.02


def test_normals_point_outward(tops):
    for top in tops:
        corners = top.vertices[top.faces]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        assert np.array_equal(np.sign(normals[:, 2]), top.face_layers)


def test_layers_lie_apart_and_meet_at_seams(tops):
    for top in tops:
        height, side = top.vertices[:, 2], top.canonical[:, 2]
        assert np.array_equal(np.sign(height), side)
        assert height.max() == pytest.approx(0.006, abs=1e-6)
        assert height.min() == pytest.approx(-0.006, abs=1e-6)


def test_front_neckline_is_deeper_than_the_back(tops):
    for top in tops:
        neck = [
            loop for loop in compute_boundary_loops(top.faces) if top.canonical[loop, 1].min() > 0.8
        ]
        neck = next(loop for loop in neck if np.abs(top.canonical[loop, 0]).max() < 1)
        y, side = top.vertices[neck, 1], top.canonical[neck, 2]
        assert y[side > 0].min() < y[side < 0].min() - 0.005


def test_size_is_that_of_the_demonstration_garments(tops):
    extents = np.array([top.extent for top in tops])
    assert np.all((extents[:, 0] > 0.98) & (extents[:, 0] < 1.17))
    assert np.all((extents[:, 1] > 0.43) & (extents[:, 1] < 0.75))
    counts = np.array([len(top.vertices) for top in tops])
    assert 3500 < np.median(counts) < 5000


def test_tops_differ_in_cut_and_not_only_in_size(tops):
    """Ratios do not change with scale; their spread is the variety of cut."""
    p = [top.parameters for top in tops]
    width = [a["chest_half_width"] / a["body_length"] for a in p]
    taper = [a["cuff_width"] / a["upper_sleeve_width"] for a in p]
    neck = [a["neck_front_depth"] / a["neck_half_width"] for a in p]
    for ratios, spread in ((width, 1.2), (taper, 1.5), (neck, 1.5)):
        assert max(ratios) / min(ratios) > spread


def test_left_is_negative_x_and_the_neck_is_towards_positive_y(tops):
    for top in tops:
        left, right, collar, hem = top.get_landmark_positions(
            ("left_cuff", "right_cuff", "collar", "hem_centre")
        )
        assert left[0] < -0.4 < 0.4 < right[0]
        assert collar[1] > 0.1 > -0.1 > hem[1]
        low, high = top.vertices.min(axis=0), top.vertices.max(axis=0)
        assert np.allclose((low + high)[:2], 0, atol=1e-6)


@pytest.mark.parametrize("spacing", [0.008, 0.02])
def test_spacing_is_followed(spacing):
    top = make_top(TopParameters(collar_height=0.05), spacing=spacing)
    edges, _ = compute_edges(top.faces)
    assert np.median(_edge_lengths(top.rest_vertices, edges)) == pytest.approx(spacing, rel=0.08)
    assert len(compute_boundary_loops(top.faces)) == 4


def test_no_gap_gives_a_flat_garment():
    assert np.all(make_top(TopParameters(), layer_gap=0.0).vertices[:, 2] == 0)


@pytest.mark.parametrize(
    ("name", "value"), [("spacing", 0.003), ("spacing", 0.03), ("layer_gap", -0.01)]
)
def test_options_out_of_range_are_refused(name, value):
    with pytest.raises(ValueError, match=rf"{name} must be in .* got {value}"):
        make_top(TopParameters(), **{name: value})
