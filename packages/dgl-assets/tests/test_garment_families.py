"""Facts that hold for the garments of every category."""

import itertools

import numpy as np
import pytest

from dgl_assets import correspond, list_categories
from dgl_assets.garments.meshing import (
    compute_edges,
    compute_smallest_angles,
)
from dgl_assets.importing.topology import find_loops

OPENINGS = {
    "Tops_LongSleeve": 4,  # neck, hem, two cuffs
    "Tops_NoSleeve": 4,  # neck, hem, two armholes
    "Tops_FrontOpen": 3,  # two cuffs, and hem, fronts and neck in one
    "Dress_LongSleeve": 4,
    "Trousers": 3,  # waist, two hems
    "Scarf": 1,
    "Baseball_Cap": 1,
    "Bowl_Hat": 1,
    "Glove": 1,
}
SHELLS = {"Baseball_Cap", "Bowl_Hat", "Glove"}  # of which more is tested in modules of their own
TASK_LANDMARKS = {
    "Tops_LongSleeve": "{}_cuff {}_upper_chest {}_hem {}_shoulder {}_sleeve_joint collar centre",
    "Tops_NoSleeve": "{}_shoulder {}_hem {}_armpit centre collar",
    "Tops_FrontOpen": "{}_lapel {}_opening_top {}_opening_hem {}_cuff collar hem_centre",
    "Dress_LongSleeve": "{}_cuff {}_upper_chest {}_side {}_skirt {}_shoulder {}_neck_side {}_waist",
    "Trousers": "{}_waist {}_hem_outer {}_hem_inner {}_waist_inner {}_waistband centre crotch",
    "Scarf": "{}_end {}_tip centre",
}
each_category = pytest.mark.parametrize("category", sorted(OPENINGS))
each_cloth = pytest.mark.parametrize("category", sorted(set(OPENINGS) - SHELLS))


def _edge_lengths(positions: np.ndarray, edges: np.ndarray) -> np.ndarray:
    return np.linalg.norm(positions[edges[:, 1]] - positions[edges[:, 0]], axis=1)


def _canonical_areas(garment) -> np.ndarray:
    corners = garment.canonical[garment.faces].astype(np.float64)
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    return (first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]) * garment.face_layers


def test_every_category_is_tested():
    assert set(list_categories()) == set(OPENINGS)


@each_category
def test_surface_is_an_oriented_manifold_with_its_openings(families, category):
    for garment in families[category]:
        faces = garment.faces
        half_edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
        assert len(np.unique(half_edges, axis=0)) == len(half_edges)  # neighbours agree
        edges, counts = compute_edges(faces)
        assert counts.max() == 2
        loops = find_loops(faces)
        assert len(loops) == OPENINGS[category]
        # A sphere with so many holes: one piece, no handles.
        assert len(garment.vertices) - len(edges) + len(faces) == 2 - OPENINGS[category]
        # At every vertex the faces form one fan: no two pieces hang together at a point.
        used, face_counts = np.unique(faces, return_counts=True)
        is_open = np.isin(used, np.concatenate(loops))
        assert np.array_equal(used, np.arange(len(garment.vertices)))
        assert np.array_equal(np.bincount(edges.ravel()), face_counts + is_open)


@each_cloth
def test_triangles_are_even(families, category):
    for garment in families[category]:
        edges, _ = compute_edges(garment.faces)
        lengths = _edge_lengths(garment.rest_vertices, edges)
        assert np.mean((lengths > 0.008) & (lengths < 0.018)) > 0.99
        angles = np.degrees(compute_smallest_angles(garment.rest_vertices, garment.faces))
        assert np.mean(angles >= 20) > 0.99
        assert 1500 <= len(garment.vertices) <= 8000


@each_cloth
def test_lying_in_layers_hardly_stretches_the_cloth(families, category):
    for garment in families[category]:
        edges, _ = compute_edges(garment.faces)
        rest = _edge_lengths(garment.rest_vertices, edges)
        strain = _edge_lengths(garment.vertices, edges) / rest - 1
        is_layered = any(name.endswith("_flap") for name in garment.panels)
        is_layered |= garment.parameters.get("opening_top_gap", 0.0) < 0
        assert strain.max() < (0.12 if is_layered else 0.02)
        assert strain.min() > -1e-3
        assert np.quantile(strain, 0.99) < 0.05


@each_cloth
def test_normals_point_outward(families, category):
    for garment in families[category]:
        corners = garment.vertices[garment.faces]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        flaps = [k for k, name in enumerate(garment.panels) if name.endswith("_flap")]
        is_flap = np.isin(garment.face_panels, flaps)
        sign = np.where(is_flap, -1, garment.face_layers)  # a folded leaf lies face down
        assert np.array_equal(np.sign(normals[:, 2]), sign)


@each_cloth
def test_canonical_is_injective_on_each_layer(families, category):
    """No triangle is turned over, and no two vertices of a layer share a place."""
    for garment in families[category]:
        assert _canonical_areas(garment).min() > 0
        for side in (1, -1):
            places = garment.canonical[garment.canonical[:, 2] * side >= 0, :2]
            assert len(np.unique(places, axis=0)) == len(places)


@each_category
def test_landmarks_correspond_within_half_an_edge(families, category):
    garments = families[category]
    for source, target in itertools.permutations(garments, 2):
        names = tuple(source.landmarks)
        assert names == tuple(target.landmarks)
        there = target.get_landmark_positions(names)
        points = correspond(source, source.get_landmark_positions(names), target)
        assert np.linalg.norm(points - there, axis=1).max() < 0.0065
        ids = correspond(source, np.array([source.landmarks[name] for name in names]), target)
        assert np.linalg.norm(target.vertices[ids] - there, axis=1).max() < 0.0065


@each_cloth
def test_landmarks_of_the_tasks_exist_and_are_mirrored(families, category):
    for garment in families[category]:
        for name in TASK_LANDMARKS[category].split():
            if "{}" not in name:
                assert name in garment.landmarks
                continue
            left, right = garment.get_landmark_positions(
                (name.format("left"), name.format("right"))
            )
            if garment.parameters.get("opening_top_gap", 0.0) < 0 and "opening" in name:
                continue  # the fronts overlap
            assert left[0] < right[0]


@each_category
def test_a_point_goes_to_the_other_garment_and_back(families, category):
    """Points that both garments have; others map to an edge and do not return."""
    rng = np.random.default_rng(1)
    for source, target in itertools.pairwise(families[category]):
        points = source.vertices[rng.integers(len(source.vertices), size=150)]
        back = correspond(target, correspond(source, points, target), source)
        error = np.linalg.norm(back - points, axis=1)
        assert np.quantile(error, 0.75) < 0.003


@each_cloth
def test_garments_are_centred_and_neck_or_waist_is_towards_positive_y(families, category):
    for garment in families[category]:
        low, high = garment.vertices.min(axis=0), garment.vertices.max(axis=0)
        assert np.allclose((low + high)[:2], 0, atol=1e-6)
        if category == "Scarf":
            assert np.all(garment.vertices[:, 2] == 0)
            continue
        top = garment.canonical[:, 1] > 0.8
        bottom = garment.canonical[:, 1] < 0.1
        assert garment.vertices[top, 1].mean() > garment.vertices[bottom, 1].mean() + 0.1
        layer = garment.canonical[:, 2]
        height = garment.vertices[:, 2]
        assert np.all(height[layer > 0] > 0)
        assert np.all(height[layer < 0] < 0)


def test_garments_of_a_category_differ_in_cut_and_not_only_in_size(families):
    """Aspect ratios and shares of the filled bounding box do not change with scale."""
    for category, garments in families.items():
        aspect = [g.extent[0] / g.extent[1] for g in garments]
        filled = [g.area / (g.extent[0] * g.extent[1]) for g in garments]
        is_many = len(garments) > 2
        least = (1.04 if category in SHELLS else 1.15) if is_many else 1.0
        assert max(aspect) / min(aspect) > least, category
        assert max(filled) / min(filled) > (1.03 if is_many else 1.0), category


@pytest.mark.parametrize("category", sorted(SHELLS))
def test_shells_have_the_default_spacing_of_their_module(families, category):
    for garment in families[category]:
        edges, _ = compute_edges(garment.faces)
        median = np.median(_edge_lengths(garment.vertices, edges))
        assert 0.0095 < median < 0.0125
        assert garment.wall_thickness == garment.parameters["wall_thickness"]
