"""Imported garments are turned rightly, by their landmarks or by their shape."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest

from dgl_assets import make_garment, sample_measures
from dgl_assets.importing.directions import find_directions
from dgl_assets.importing.keypoints import Keypoints
from dgl_assets.importing.options import GarmentImportOptions
from dgl_assets.importing.placing import place_surface
from dgl_assets.importing.raw import RawMesh

_SPEC = importlib.util.spec_from_file_location("foreign", Path(__file__).parent / "foreign.py")
foreign = importlib.util.module_from_spec(_SPEC)
_SPEC.loader.exec_module(foreign)

COARSE = 0.025


def place(vertices, faces, axes, *, points=None, category=None):
    """Place a garment of known frame in a file with other axes."""
    raw = RawMesh(vertices=vertices @ axes.T, faces=faces)
    options = GarmentImportOptions(category=category, units="m", spacing=COARSE)
    return place_surface(raw, "garment", options, points)


def name_points(vertices, landmarks, axes, names=None) -> Keypoints:
    chosen = {n: v for n, v in landmarks.items() if names is None or n in names}
    return Keypoints(
        names=tuple(chosen),
        positions=(vertices @ axes.T)[list(chosen.values())],
        vertex_ids=np.array(list(chosen.values())),
    )


@pytest.mark.parametrize("seed", range(3, 7))
def test_key_points_turn_worn_tops(seed):
    shape = foreign.make_worn_top(seed)
    points = name_points(shape.vertices, shape.landmarks, foreign.Z_UP)
    placed = place(shape.vertices, shape.faces, foreign.Z_UP, points=points)
    assert placed.frame.rotation == pytest.approx(foreign.Z_UP.T)
    assert "front, left and up are as the names of the landmarks say" in placed.notes


@pytest.mark.parametrize("turn", [(1, -1, -1), (-1, -1, 1), (-1, 1, -1)])
def test_key_points_win_over_the_shape(turn):
    """Names that say the contrary of the shape are followed."""
    shape = foreign.make_worn_top(7)
    points = name_points(shape.vertices, shape.landmarks, np.diag(turn))
    placed = place(shape.vertices, shape.faces, np.eye(3), points=points)
    assert placed.frame.rotation == pytest.approx(np.diag(turn))


def test_left_and_right_alone_tell_the_front():
    shape = foreign.make_worn_top(7)
    names = ("left_cuff", "right_cuff")
    turned = np.diag([-1.0, 1.0, -1.0])
    points = name_points(shape.vertices, shape.landmarks, turned, names)
    placed = place(shape.vertices, shape.faces, np.eye(3), points=points)
    assert placed.frame.rotation == pytest.approx(turned)


def test_neck_and_hem_alone_leave_the_front_to_the_shape():
    shape = foreign.make_worn_top(7)
    points = name_points(shape.vertices, shape.landmarks, np.eye(3), ("collar", "hem_centre"))
    placed = place(shape.vertices, shape.faces, np.eye(3), points=points)
    assert placed.frame.rotation == pytest.approx(np.eye(3))
    assert any("front where the neckline" in note for note in placed.notes)


def test_names_that_contradict_each_other_tell_nothing():
    points = Keypoints(
        names=("left_cuff", "right_cuff", "left_hem", "right_hem", "sleeve"),
        positions=np.array([[-1.0, 0, 0], [1, 0, 0], [1, -1, 0], [-1, -1, 0], [0, 0, 0]]),
        vertex_ids=np.full(5, -1),
    )
    found = find_directions(points)
    assert found.right is None
    assert found.up is None
    assert "contradict" in found.notes[0]
    assert find_directions(None).axes is None


@pytest.mark.parametrize(
    "category",
    ["Tops_LongSleeve", "Tops_NoSleeve", "Tops_FrontOpen", "Dress_LongSleeve", "Trousers"],
)
def test_shape_alone_turns_garments_of_every_category(category):
    """Collars that are folded over, hoods, wide sleeves and dresses with short ones among them."""
    for seed in (3, 7, 8, 10):
        sizes = "all" if seed % 2 else "reach"
        garment = make_garment(sample_measures(category, seed, sizes=sizes), spacing=COARSE)
        faces = garment.faces.astype(np.int64)
        worn = foreign.blow_up(garment)
        for vertices, axes in (
            (worn, foreign.Y_UP),
            (garment.vertices.astype(np.float64), foreign.LIES_Y_UP),
        ):
            placed = place(vertices, faces, axes)
            assert placed.category == category, (seed, placed.notes)
            assert placed.frame.rotation == pytest.approx(axes.T), (seed, placed.notes)
            assert any("front" in note for note in placed.notes)


def test_what_looks_alike_in_front_and_behind_is_called_a_guess():
    vertices, quads = foreign.make_vest()
    faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    notes = place(vertices, faces, np.eye(3)).notes
    assert any("front and back look alike" in note and "mere guess" in note for note in notes)
