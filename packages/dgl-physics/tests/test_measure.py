"""Measures against meshes whose answer is known, and against brute force."""

import numpy as np
import pytest

from dgl_physics.measure import compute_strain, find_intersections

TRIANGLE = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], dtype=float)


def two_triangles(needle):
    return np.concatenate([TRIANGLE, needle]), np.array([[0, 1, 2], [3, 4, 5]])


def test_an_edge_through_a_triangle_is_found(device):
    """A thin triangle stands on its tip below the other: two of its edges go through."""
    x, f = two_triangles([[0.2, 0.2, -0.5], [0.2, 0.2, 0.5], [0.25, 0.2, 0.5]])
    assert find_intersections(x, f, device=device).tolist() == [[3, 4, 0], [3, 5, 0]]


@pytest.mark.parametrize(
    "needle",
    [
        [[0.2, 0.2, 0.01], [0.2, 0.2, 0.5], [0.25, 0.2, 0.5]],  # ends above it
        [[0.6, 0.6, -0.5], [0.6, 0.6, 0.5], [0.65, 0.6, 0.5]],  # beside it, inside its box
        [[0.2, 0.2, 0.0], [0.2, 0.2, 0.5], [0.25, 0.2, 0.5]],  # touches it
        [[3, 3, 0], [4, 3, 0], [3, 4, 0]],  # far away, in its plane
    ],
)
def test_an_edge_beside_a_triangle_is_not_found(needle, device):
    assert len(find_intersections(*two_triangles(needle), device=device)) == 0


def test_a_piercing_by_a_micrometre_is_found_and_a_miss_by_one_is_not():
    for z, count in ((-1e-6, 2), (1e-6, 0)):
        x, f = two_triangles([[0.2, 0.2, z], [0.2, 0.2, 0.5], [0.25, 0.2, 0.5]])
        assert len(find_intersections(x, f)) == count


def test_neighbours_do_not_count(sheet):
    """A sheet folded on itself along a row touches only triangles that it shares vertices with."""
    vertices, faces = sheet(0.1, 0.1, 0.0125)
    assert len(find_intersections(vertices, faces)) == 0
    crumpled = vertices + np.random.default_rng(0).normal(0, 1e-3, vertices.shape)
    assert len(find_intersections(crumpled, faces)) == 0


def test_crumpled_meshes_match_brute_force(sheet, device):
    """Exactly what three lines of algebra for every edge and triangle find."""
    vertices, faces = sheet(0.06, 0.06, 0.0125)
    for seed in range(3):
        x = vertices + np.random.default_rng(seed).normal(0, 0.01, vertices.shape)
        x = x.astype(np.float32).astype(float)
        found = find_intersections(x, faces, device=device)
        assert len(found) > 5
        expected = set()
        edges = {tuple(sorted((t[k], t[k - 1]))) for t in faces.tolist() for k in range(3)}
        for p, q in edges:
            for k, t in enumerate(faces.tolist()):
                if p in t or q in t:
                    continue
                a, b, c = x[t]
                matrix = np.column_stack([b - a, c - a, x[p] - x[q]])
                u, v, s = np.linalg.solve(matrix, x[p] - a)
                if u > 0 and v > 0 and u + v < 1 and 0 < s < 1:
                    expected.add((p, q, k))
        assert set(map(tuple, found.tolist())) == expected
        assert found.tolist() == sorted(found.tolist())


def test_a_layer_pushed_through_another_is_found_and_beside_it_not(sheet):
    vertices, faces = sheet(0.1, 0.1, 0.0125)
    both = np.concatenate([faces, faces + len(vertices)])
    apart = np.concatenate([vertices, np.add(vertices, [0.003, 0.002, 0.008])])
    assert len(find_intersections(apart, both)) == 0
    tilted = vertices @ np.array([[0.9, 0, 0.436], [0, 1, 0], [-0.436, 0, 0.9]])
    assert len(find_intersections(np.concatenate([vertices, tilted]), both)) > 5


def test_strain_has_a_sign():
    x = np.array([[0, 0, 0], [0.011, 0, 0], [0.011, 0.009, 0]])
    strain = compute_strain(x, np.array([[0, 1], [1, 2]]), np.array([0.01, 0.01]))
    assert strain == pytest.approx([0.1, -0.1], rel=1e-4)


def test_bad_arrays_are_refused():
    faces = np.array([[0, 1, 2]])
    with pytest.raises(ValueError, match=r"shape \(V, 3\) .* got \(3, 2\)"):
        find_intersections(TRIANGLE[:, :2], faces)
    with pytest.raises(ValueError, match="3 vertices are not finite"):
        find_intersections(np.full((3, 3), np.nan), faces)
    with pytest.raises(ValueError, match=r"index 0\.\.2; got 0\.\.3"):
        find_intersections(TRIANGLE, np.array([[0, 1, 3]]))
