"""Meshing and sewing of simple shapes with known answers."""

import numpy as np
import pytest

from dgl_assets import MeshingError
from dgl_assets.garments.meshing import (
    compute_edges,
    compute_segment_distances,
    compute_smallest_angles,
    contains_points,
    mesh_outline,
    resample_polyline,
)
from dgl_assets.garments.sewing import Panel, Seam, sew_panels
from dgl_assets.importing.topology import find_loops

SQUARE = np.array([[0.0, 0.0], [0.2, 0.0], [0.2, 0.2], [0.0, 0.2]])


def _side(start: int, end: int) -> np.ndarray:
    return resample_polyline(SQUARE[[start, end]], 15)


def _outline() -> np.ndarray:
    return np.concatenate([_side(k, (k + 1) % 4)[:-1] for k in range(4)])


def test_a_square_is_filled_exactly():
    outline = _outline()
    points, triangles = mesh_outline(outline, spacing=0.2 / 15, pins=np.array([[0.09, 0.11]]))
    assert np.array_equal(points[: len(outline)], outline)
    assert np.array_equal(points[len(outline)], [0.09, 0.11])
    first = points[triangles[:, 1]] - points[triangles[:, 0]]
    second = points[triangles[:, 2]] - points[triangles[:, 0]]
    areas = (first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]) / 2
    assert areas.min() > 0
    assert areas.sum() == pytest.approx(0.04)
    loops = find_loops(triangles)
    assert len(loops) == 1
    assert set(loops[0]) == set(range(len(outline)))


def test_pins_outside_are_refused():
    with pytest.raises(MeshingError, match=r"pins \[1\] do not"):
        mesh_outline(_outline(), spacing=0.013, pins=np.array([[0.1, 0.1], [0.3, 0.1]]))


def test_an_outline_too_thin_for_its_spacing_is_refused():
    # A vertex of the bottom sees the two horns past the floor of the notch, which is lost.
    notched = np.array(
        [[0.0, 0.0], [0.5, 0.0], [1.0, 0.0], [1.0, 1.0], [0.9, 0.1], [0.1, 0.1], [0.0, 1.0]]
    )
    with pytest.raises(MeshingError, match=r"of 7 segments cannot be filled at spacing 2\.0 m"):
        mesh_outline(notched, spacing=2.0)


def test_points_are_told_inside_from_outside():
    queries = np.array([[0.1, 0.1], [0.3, 0.1], [-0.01, 0.1], [0.1, 0.199], [0.1, 0.201]])
    assert contains_points(SQUARE, queries).tolist() == [True, False, False, True, False]


def test_known_distances_and_angles():
    start, end = np.array([[0.0, 0.0]]), np.array([[1.0, 0.0]])
    queries = np.array([[0.5, 0.3], [2.0, 0.0], [-3.0, 4.0]])
    assert np.allclose(compute_segment_distances(queries, start, end), [0.3, 1.0, 5.0])
    right = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, np.sqrt(3.0)]])
    assert np.degrees(compute_smallest_angles(right, np.array([[0, 1, 2]]))) == pytest.approx(30)


def test_two_squares_sewn_along_two_sides_make_a_tube():
    """An open tube has two boundary loops and Euler characteristic 0."""
    seams = {
        "left": Seam(start="d", end="a", points=_side(3, 0)),
        "right": Seam(start="b", end="c", points=_side(1, 2)),
    }
    for face in ("front", "back"):
        seams[f"{face}_bottom"] = Seam(start="a", end="b", points=_side(0, 1))
        seams[f"{face}_top"] = Seam(start="d", end="c", points=_side(3, 2))
    panels = tuple(
        Panel(
            name=face,
            layer=layer,
            edges=(f"{face}_bottom", "right", f"-{face}_top", "left"),
            pins={},
        )
        for face, layer in (("front", 1), ("back", -1))
    )
    tube = sew_panels(seams, panels, spacing=0.2 / 15)
    edges, counts = compute_edges(tube.faces)
    assert counts.max() == 2
    assert len(find_loops(tube.faces)) == 2
    assert len(tube.flat) - len(edges) + len(tube.faces) == 0
    assert np.all(tube.layers[tube.seams["left"]] == 0)
    assert np.all(tube.layers[tube.seams["front_top"][1:-1]] == 1)
    assert np.all(tube.layers[tube.seams["back_top"][1:-1]] == -1)


def test_edges_that_do_not_join_are_refused():
    seams = {"bottom": Seam(start="a", end="b", points=_side(0, 1))}
    with pytest.raises(ValueError, match=r"names seam top; expected one of \['bottom'\]"):
        sew_panels(
            seams, (Panel(name="p", layer=1, edges=("bottom", "top"), pins={}),), spacing=0.01
        )
    with pytest.raises(ValueError, match="must join end to end"):
        sew_panels(seams, (Panel(name="p", layer=1, edges=("bottom",), pins={}),), spacing=0.01)
