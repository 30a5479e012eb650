"""Capsules fitted to shapes: they contain them, and are not much larger."""

import numpy as np
import pytest
import trimesh

from dgl_assets.robots.importing.capsules import (
    clip_triangles,
    enclosing_circle,
    fit_capsule,
    fit_capsules,
)

TURN = trimesh.transformations.rotation_matrix(0.7, (1, 2, 3), (0.1, 0, 0.2))


def _assert_contains(capsules, mesh):
    points = np.concatenate([mesh.vertices, mesh.sample(2000, seed=0)])
    outside = np.min([capsule.measure_distance(points) for capsule in capsules], axis=0)
    assert outside.max() < 1e-7


def test_a_capsule_is_found_again():
    mesh = trimesh.creation.capsule(radius=0.03, height=0.2, count=[48, 48])
    mesh.apply_transform(TURN)
    capsule = fit_capsule(mesh.vertices)
    assert capsule.radius == pytest.approx(0.03, rel=0.01)
    assert capsule.half_length == pytest.approx(0.1, rel=0.02)
    assert abs(capsule.axis @ TURN[:3, 2]) == pytest.approx(1.0, abs=1e-3)
    _assert_contains([capsule], mesh)


def test_a_long_cylinder_gets_its_own_radius():
    mesh = trimesh.creation.cylinder(radius=0.04, height=0.5, sections=64)
    mesh.apply_transform(TURN)
    (capsule,) = fit_capsules(mesh.vertices, mesh.faces, most=1)
    assert capsule.radius == pytest.approx(0.04, rel=0.01)
    assert capsule.volume < 1.15 * mesh.volume + 4 / 3 * np.pi * 0.04**3
    _assert_contains([capsule], mesh)


def test_an_angle_is_divided_into_two_arms():
    """One capsule around an L is mostly empty."""
    arm = trimesh.creation.box(extents=(0.4, 0.04, 0.04))
    other = trimesh.creation.box(extents=(0.04, 0.4, 0.04))
    other.apply_translation((0.18, 0.18, 0))
    mesh = trimesh.util.concatenate([arm, other])
    whole, parts = fit_capsule(mesh.vertices), fit_capsules(mesh.vertices, mesh.faces)
    assert 2 <= len(parts) <= 4
    assert sum(part.volume for part in parts) < 0.25 * whole.volume
    _assert_contains(parts, mesh)


@pytest.mark.parametrize("seed", range(4))
def test_random_bodies_are_contained(seed):
    rng = np.random.default_rng(seed)
    mesh = trimesh.convex.convex_hull(rng.normal(size=(40, 3)) * rng.uniform(0.02, 0.2, 3))
    _assert_contains(fit_capsules(mesh.vertices, mesh.faces), mesh)


def test_flat_and_tiny_bodies_have_a_thickness():
    square = np.array([[0, 0, 0], [0.1, 0, 0], [0.1, 0.1, 0], [0, 0.1, 0]])
    capsules = fit_capsules(square, np.array([[0, 1, 2], [0, 2, 3]]))
    assert min(c.radius for c in capsules) > 0
    point = fit_capsule(np.zeros((3, 3)))
    assert (point.radius, point.half_length) == (5e-4, 1e-4)


def test_the_smallest_circle_is_found():
    rng = np.random.default_rng(5)
    for _ in range(20):
        points = rng.normal(size=(30, 2))
        centre, radius = enclosing_circle(points)
        distance = np.linalg.norm(points - centre, axis=1)
        assert distance.max() <= radius * (1 + 1e-9)
        on_it = points[distance > radius * (1 - 1e-6)] - centre
        # it is the smallest when the points on it do not lie on one side of its centre
        angles = np.sort(np.arctan2(on_it[:, 1], on_it[:, 0]))
        gaps = np.diff(np.append(angles, angles[0] + 2 * np.pi))
        assert len(on_it) >= 2
        assert gaps.max() <= np.pi + 1e-5


def test_clipping_keeps_the_area_of_both_parts():
    mesh = trimesh.creation.icosphere(subdivisions=2, radius=1.0)
    triangles = mesh.vertices[mesh.faces]
    normal = np.array([0.6, 0.0, 0.8])
    parts = [clip_triangles(triangles, sign * normal, sign * 0.3) for sign in (1, -1)]
    area = [trimesh.triangles.area(part).sum() for part in parts]
    assert sum(area) == pytest.approx(mesh.area)
    assert (parts[0] @ normal).max() <= 0.3 + 1e-12
